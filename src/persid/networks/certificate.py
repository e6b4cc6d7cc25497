"""Certificates and obstructions of networks, claim L1: the file, its companion of large arrays, and what they say."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray

import persid_check
from persid._dyadics import dyadic, dyadics, exact, rounded, value
from persid._files import Json, json_object, write_atomically
from persid.certificates import bounds
from persid.certificates.acceptance import accepted
from persid.certificates.encoding import encode, heading
from persid.errors import ModelError, RejectedError
from persid.models import sparse as columns
from persid.models.model import PersidskiiModel
from persid.networks.weights import Network, Perron, Weights, find_weights, network
from persid_check.entry import Entry
from persid_check.model import model_of
from persid_check.networks.members import Members, read_members
from persid_check.networks.nodes import nodes_of
from persid_check.networks.table import Table, table_of, table_of_sparse
from persid_check.results import NotProvedError

KINDS = 2000  # different kinds of nodes whose cones are sought


@dataclass(frozen=True, eq=False)
class NetworkCertificate:
    """A proof of claim L1, accepted by `persid_check` byte for byte; `arrays` are the bytes of its companion, if any.

    V(x) = sum w_k |x_k - x*_k| obeys V(t) <= exp(-kappa t) V(0) + sum_l (gains_l) sup|u_l - u_l*|.
    """

    data: bytes
    arrays: bytes | None
    subject: PersidskiiModel
    statement: str
    steps: tuple[str, ...]
    claim: str = "L1"

    @classmethod
    def accept(cls, data: bytes, arrays: bytes | None, model: PersidskiiModel) -> "NetworkCertificate":
        """Return the certificate that these bytes are, if the checker accepts them.

        Raises:
            RejectedError: the checker rejects them or finds them malformed; the message gives its reason.
        """
        answer = accepted(data, ("L1",), arrays)
        return cls(data, arrays, model, answer.statement, answer.steps)

    def __repr__(self) -> str:
        return f"NetworkCertificate({len(self.data)} bytes, {len(self.arrays or b'')} in a companion: {self.statement})"

    def _repr_html_(self) -> str:
        from persid.certificates.tables import of_certificate

        return of_certificate(self)

    def save(self, path: str | Path) -> None:
        """Write the accepted bytes, and beside them the companion under the name that they give."""
        _save(self.content, self.data, self.arrays, path)

    @cached_property
    def content(self) -> Json:
        """The certificate as an object."""
        return json_object(self.data)

    @property
    def model(self) -> PersidskiiModel:
        """The model of which the certificate speaks."""
        return self.subject

    @property
    def scope(self) -> str:
        """Claim L1 is global."""
        return "global"

    @property
    def every_input(self) -> bool:
        """Whether the claim holds about the one equilibrium of every constant input, not about x_ref alone."""
        return bool(self.content["operating_point"] == "every")

    @cached_property
    def operating_point(self) -> Float[ndarray, " n"]:
        """The state about which stability is claimed: x_ref, or the equilibrium at u_ref by Newton's method."""
        return _equilibrium(self.model) if self.every_input else self.model.x_ref

    @cached_property
    def w(self) -> Float[ndarray, " n"]:
        """The weights of V, one a state."""
        listed = self.content["weights"]
        if listed is None:
            return persid_check.companion.read(self.arrays or b"")["w"]
        return np.array([value(pair) for pair in listed])

    @cached_property
    def members(self) -> Members | None:
        """The ellipsoids of coefficients of which the claim speaks; None where it speaks of the model alone."""
        listed = self.content.get("deviations")
        return None if listed is None else read_members(Entry(listed, "deviations"), model_of(self.content["model"]))

    @property
    def further(self) -> tuple[str, ...]:
        """What is said beyond the claim: ("members",) where it is one about every model of a set."""
        return () if self.members is None else ("members",)

    @property
    def rate(self) -> float:
        """The decay rate kappa of V, and so of the state, in 1/s, rounded down."""
        return bounds.below(self._kappa)

    @cached_property
    def gains(self) -> Float[ndarray, " m"]:
        """Gains in the norm V from each sup|u_l - u_l*|: (|B|'w)_l / kappa, rounded up."""
        B, w = np.abs(self.model.B), self.w
        raised = Fraction(1 + (self.model.n + 8) * 2.0**-51)  # more than the rounding errors of the sums
        lost = np.asarray((B != 0).sum(axis=0)) * 2.0**-1000  # more than products lose by underflow
        sums = [Fraction(float(s)) * raised + Fraction(float(tiny)) for s, tiny in zip(B.T @ w, lost, strict=True)]
        if self.members is not None:
            for j in range(self.model.m):
                sums[j] += sum(Fraction(float(w[i])) * size for i, size in self.members.of_input(j))
        return np.array([-bounds.below(-s / self._kappa) for s in sums])

    @property
    def gain(self) -> float:
        """The gain from sup|u - u*| to |x - x*|, both Euclidean, rounded up: |gains| / min w."""
        return float(np.nextafter(math.hypot(*self.gains) / self._least * (1 + 2.0**-40), np.inf))

    input_bound = None
    level = None
    counts_b = False  # about x_ref there is no constant b

    def V(self, x: Float[ndarray, "N n"]) -> Float[ndarray, " N"]:
        """Return the Lyapunov function at states x (N, n): sum w_k |x_k - x*_k|."""
        return np.asarray(np.abs(np.asarray(x, float) - self.operating_point) @ self.w)

    def overshoot(self, x0: object) -> float:
        """Return V(x0) / min w: without input |x(t) - x*| never exceeds it, apart from rounding."""
        x0 = np.asarray(x0, float)
        if x0.shape != (self.model.n,) or not np.isfinite(x0).all():
            raise ModelError(f"x0 must be {self.model.n} finite numbers")
        return float(self.V(x0[None])[0] / self._least * (1 + self.model.n * 2.0**-50))

    def bound(self, x0: object, u_sup: float, t: object) -> Float[ndarray, " N"]:
        """Return an upper bound of |x(t) - x*| at times t (s), for every input with sup|u - u*| <= u_sup.

        Raises:
            ModelError: x0, u_sup or t is no state, no size of an input, or no times from 0 on.
        """
        t = np.atleast_1d(np.asarray(t, float))
        if not (0 <= u_sup < np.inf and (t >= 0).all()):
            raise ModelError(f"sup|u - u*| = {u_sup} and the times t must be finite and at least 0")
        offset = 0.0 if self.every_input else float(np.abs(self.model.b) @ self.w) / self.rate / self._least
        decayed = self.overshoot(x0) * np.exp(-self.rate * t)
        return np.asarray((decayed + self.gain * u_sup + offset) * (1 + self.model.n * 2.0**-50))

    @cached_property
    def _kappa(self) -> Fraction:
        return exact(self.content["kappa"])

    @cached_property
    def _least(self) -> float:
        return float(self.w.min())


@dataclass(frozen=True, eq=False)
class NetworkObstruction:
    """A proof, accepted by `persid_check`, that no weights serve with the cones used; stability is not refuted."""

    data: bytes
    arrays: bytes | None
    statement: str

    @classmethod
    def accept(cls, data: bytes, arrays: bytes | None) -> "NetworkObstruction":
        """Return the obstruction that these bytes are.

        Raises:
            RejectedError: the checker does not accept them as one; the message gives its reason.
        """
        return cls(data, arrays, accepted(data, ("L1-infeasible",), arrays).statement)

    def save(self, path: str | Path) -> None:
        """Write the accepted bytes, and beside them the companion under the name that they give."""
        _save(self.content, self.data, self.arrays, path)

    @cached_property
    def content(self) -> Json:
        """The file as an object."""
        return json_object(self.data)


def table(model: PersidskiiModel) -> Table | None:
    """Return a model's coefficients by node; None where an argument row is no positive multiple of a unit vector."""
    try:
        if model.is_large:
            return table_of_sparse(model.compressed().exact)
        return table_of(nodes_of(model_of(model.canonical)))
    except NotProvedError:
        return None


def prove(
    model: PersidskiiModel, net: Network, found: Weights, every: bool, more: Json | None = None
) -> NetworkCertificate:
    """Return the certificate of weights, its numbers rounded, if the checker accepts it; `more` are further fields.

    Raises:
        RejectedError: it does not; the message gives its reason.
    """
    w = rounded(found.w)
    parts = {
        "operating_point": "every" if every else "reference",
        "kinds": [_kind(net, t) for t in range(len(net.cones))],
        "kappa": dyadic(found.kappa * (1 - 2.0**-24), 24),
        **(more or {}),
    }
    statement = "Input-to-state stable, globally, with V = sum w_k |x_k|."
    data, arrays = _file(model, "L1", statement, parts, {"weights": ("w", w)})
    return NetworkCertificate.accept(data, arrays, model)


def obstruct(model: PersidskiiModel, net: Network, found: Perron) -> NetworkObstruction | None:
    """Return the file of what excludes weights, if the checker accepts it."""
    kinds = [
        {**_kind(net, t), "rays": [[[c, 0] for c in ray] for ray in cone.rays]} for t, cone in enumerate(net.cones)
    ]
    counts = np.array([len(cone.rays) for cone in net.cones])
    choice = np.minimum(found.choice, counts[net.table.kind] - 1)
    statement = "No weights w > 0 serve with these cones; stability is not refuted."
    z = rounded(found.z)
    data, arrays = _file(
        model, "L1-infeasible", statement, {"kinds": kinds}, {"z": ("z", z), "choice": ("choice", choice)}
    )
    try:
        return NetworkObstruction.accept(data, arrays)
    except RejectedError:
        return None


def load(data: bytes, folder: Path) -> NetworkCertificate:
    """Return the certificate of claim L1 that a file holds, whose companion stands in a folder.

    Raises:
        RejectedError: the checker does not accept it.
    """
    content = json_object(data)
    arrays = companion(data, folder)
    answer = accepted(data, ("L1",), arrays)
    model = PersidskiiModel.from_canonical(content["model"], arrays)
    return NetworkCertificate(data, arrays, model, answer.statement, answer.steps)


def companion(data: bytes, folder: Path) -> bytes | None:
    """Return the bytes of the companion that a file names; what is no plain file name is left to the checker."""
    entry = json_object(data).get("companion")
    name = entry.get("npz") if isinstance(entry, dict) else None
    if not (isinstance(name, str) and persid_check.companion.NAME.fullmatch(name)):
        return None
    return (folder / name).read_bytes()


def certify_network(
    model: PersidskiiModel, at_reference: bool, progress: Callable[[str], None]
) -> NetworkCertificate | NetworkObstruction | None:
    """Return a certificate of claim L1; else what excludes it, if that is proved, or None.

    About every equilibrium first, with nondecreasing forms; then with sharper ones about x_ref, if that is the point
    that is asked for and the model has no constant b.
    """
    progress("a weighted l1 norm: the coefficients by node")
    nodes = table(model)
    if nodes is None or len(nodes.kinds) > KINDS:
        return None
    obstruction = None
    for every in (True, False) if at_reference and not model.b.any() else (True,):
        progress(f"a weighted l1 norm: cones of {'nondecreasing' if every else 'sector'} forms")
        net = network(nodes, every)
        progress("a weighted l1 norm: value iteration")
        found = find_weights(net)
        if isinstance(found, Weights):
            progress("a weighted l1 norm: writing and checking")
            try:
                return prove(model, net, found, every)
            except RejectedError:
                continue
        obstruction = obstruct(model, net, found) if isinstance(found, Perron) else None
    return obstruction


def _kind(net: Network, t: int) -> Json:
    functions = [[text, dyadic(float(alpha))] for text, alpha in net.table.kinds[t]]
    return {"functions": functions, "forms": [dyadics(form) for form in net.cones[t].forms]}


def _file(
    model: PersidskiiModel, claim: str, statement: str, parts: Json, vectors: dict[str, tuple[str, ndarray]]
) -> tuple[bytes, bytes | None]:
    """Return the bytes of a file and of its companion; the vectors are listed in the file of a small model."""
    content = {**heading(model, claim, statement), **parts}
    if not model.is_large:
        return encode({**content, **{name: _listed(v) for name, (_, v) in vectors.items()}, "companion": None}), None
    arrays = columns.archive(model.compressed().arrays | dict(vectors.values()))
    digest = hashlib.sha256(arrays).hexdigest()
    stored = {"npz": f"network-{digest[:16]}.npz", "sha256": digest}
    return encode({**content, **dict.fromkeys(vectors), "companion": stored}), arrays


def _listed(values: ndarray) -> list[int] | list[list[int]]:
    return [int(v) for v in values] if values.dtype.kind == "i" else dyadics(values)


def _save(content: Json, data: bytes, arrays: bytes | None, path: str | Path) -> None:
    if arrays is not None:
        write_atomically(Path(path).with_name(content["companion"]["npz"]), arrays)
    write_atomically(path, data)


def _equilibrium(model: PersidskiiModel) -> ndarray:
    """Return the equilibrium at u_ref: x_ref, or what damped Newton steps find (a contraction has one)."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import spsolve

    x = model.x_ref
    for _ in range(100):
        residual = model.rhs(x)
        if not residual.any():
            break
        step, length = spsolve(csc_array(model.jacobian(x)), residual), 1.0
        with np.errstate(all="ignore"):
            while length > 1e-6 and not np.abs(model.rhs(x - length * step)).max() < np.abs(residual).max():
                length /= 2
        if length <= 1e-6:
            break
        x = x - length * step
    return x
