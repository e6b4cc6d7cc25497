"""PersidskiiModel: x' = A0 (x - x_ref) + sum A f(R (x - x_ref)) + B (u - u_ref) + b, or x+ - x_ref in place of x'."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse import csc_array

from persid._files import Json, readable, write_atomically
from persid.errors import ModelError
from persid.measurements.trajectories import Trajectories
from persid.models import sparse as columns
from persid.models.arguments import (
    check_kinds,
    clock,
    dimension,
    distinct_names,
    finite_array,
    matrices_of,
    matrix_of,
    plain_model,
    sampled_input,
    term_of,
    unknown_fields,
)
from persid.models.channels import Channels, Term
from persid.models.sparse import Compressed, Sparse
from persid.models.vector_field import VectorField
from persid_check import companion, sparse
from persid_check.canonical import canonical_model, holds_objects
from persid_check.model import sha256_of

FORMAT = "persid-model-1"

DENSE_ENTRIES = 20_000_000  # numbers that a sparse model may take when its matrices are filled in

Input = object  # (N, m) samples, held; or a function of t; or None for u_ref


@dataclass(frozen=True, eq=False)
class PersidskiiModel:
    """A generalized Persidskii model in the user's units; time in s.

    Paper: eq:main_system_Per, eq:change_variable_P_system.

    Matrices of a large network (A0, each A and R, B) may be SciPy sparse ones; they are kept as `csc_array`.
    `domain` is the box of the data, one (lo, hi) per state, or None; `provenance` is never used in a proof.
    With time="discrete" the right side is x+ - x_ref, where x+ is the state one step of `dt` s later.

    Raises:
        ModelError: shapes do not fit, a number is not finite, a function is not of the grammar, or discrete time has no
            step dt > 0 or a sparse matrix.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
        >>> model.rhs(np.array([2.0]), np.array([0.5]))
        array([-9.5])
        >>> ps.PersidskiiModel(A0=[[0.5]], B=[[1.0]], time="discrete", dt=0.1).rhs(np.array([2.0]))
        array([1.])
    """

    A0: Float[ndarray, "n n"] | Sparse
    terms: tuple[Term, ...]
    B: Float[ndarray, "n m"] | Sparse
    b: Float[ndarray, " n"]
    x_ref: Float[ndarray, " n"]
    u_ref: Float[ndarray, " m"]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    domain: Float[ndarray, "n 2"] | None = None
    provenance: Json = field(default_factory=dict)
    time: str = "continuous"
    dt: float | None = None

    def __init__(
        self,
        A0: object = None,
        terms: Sequence[object] = (),
        B: Any = None,
        b: object = None,
        x_ref: object = None,
        u_ref: object = None,
        *,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        domain: object = None,
        provenance: Mapping[str, object] | None = None,
        time: str = "continuous",
        dt: float | int | None = None,
    ) -> None:
        n = dimension(A0, terms, B)
        sparse = any(columns.is_sparse(part) for term in terms for part in matrices_of(term))
        A0 = (csc_array((n, n)) if sparse else np.zeros((n, n))) if A0 is None else A0
        A0 = matrix_of("A0", A0, (n, n))
        B = matrix_of("B", np.zeros((n, 0)) if B is None else B, (n, None))
        m = B.shape[1]
        values = {
            "A0": A0,
            "terms": tuple(term_of(i, term, n) for i, term in enumerate(terms)),
            "B": B,
            "b": finite_array("b", np.zeros(n) if b is None else b, (n,)),
            "x_ref": finite_array("x_ref", np.zeros(n) if x_ref is None else x_ref, (n,)),
            "u_ref": finite_array("u_ref", np.zeros(m) if u_ref is None else u_ref, (m,)),
            "states": distinct_names("states", states, n) if states else tuple(f"x{i + 1}" for i in range(n)),
            "inputs": distinct_names("inputs", inputs or [f"u{i + 1}" for i in range(m)], m),
            "domain": None if domain is None else finite_array("domain", domain, (n, 2)),
            "provenance": dict(provenance or {}),
            "time": time,
            "dt": clock(time, dt, sparse or columns.is_sparse(A0) or columns.is_sparse(B)),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __eq__(self, other: object) -> bool:
        """Whether both are the same model, number for number; provenance does not count."""
        return self.sha256 == other.sha256 if isinstance(other, PersidskiiModel) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sha256)

    def _repr_html_(self) -> str:
        from persid.models.tables import of_model

        return of_model(self)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.inputs)

    @property
    def is_discrete(self) -> bool:
        """Whether time goes in steps of `dt` s."""
        return self.time == "discrete"

    @property
    def is_sparse(self) -> bool:
        """Whether a matrix is a sparse one."""
        found = [self.A0, self.B, *(part for term in self.terms for part in (term.A, term.R))]
        return any(columns.is_sparse(part) for part in found)

    @property
    def is_large(self) -> bool:
        """Whether the arrays of the model stand in a companion of its file."""
        return self.is_sparse and self.n > columns.FILLED_STATES

    def dense(self) -> "PersidskiiModel":
        """Return the model with its matrices filled in; itself where it has no sparse ones.

        Raises:
            ModelError: they are too large to be filled in.
        """
        if not self.is_sparse:
            return self
        size = self.n * (self.n + sum(len(term.f) * (1 + (term.R is not None)) for term in self.terms))
        if size > DENSE_ENTRIES:
            raise ModelError(f"{self.n} states are too many for matrices that are not sparse; certify works on them")
        terms = [(list(term.f), _filled(term.R), _filled(term.A)) for term in self.terms]
        kept = {name: getattr(self, name) for name in ("b", "x_ref", "u_ref", "states", "inputs", "domain")}
        return PersidskiiModel(_filled(self.A0), terms, _filled(self.B), **kept, provenance=self.provenance)

    @cached_property
    def channels(self) -> Channels:
        """The scalar channels, in the order of the terms; terms with f = x are merged into A0."""
        if self.is_sparse:
            return self.dense().channels
        A0, rows, columns, functions = self.A0.copy(), [], [], []
        for term in self.terms:
            R = np.eye(self.n) if term.R is None else term.R
            linear = np.array([f.is_linear for f in term.f])
            A0 += term.A[:, linear] @ R[linear]
            rows.append(R[~linear])
            columns.append(term.A[:, ~linear])
            functions += [f for f in term.f if not f.is_linear]
        empty = np.zeros((0, self.n))
        return Channels(A0, np.vstack([empty, *rows]), np.hstack([empty.T, *columns]), tuple(functions))

    @cached_property
    def field(self) -> VectorField:
        """The right side alone, as one value; in discrete time it is x+ itself, its constant b + x_ref."""
        if self.is_sparse:
            return self.dense().field
        b = self.b + self.x_ref if self.is_discrete else self.b
        return VectorField(
            channels=self.channels,
            B=self.B,
            b=b,
            x_ref=self.x_ref,
            u_ref=self.u_ref,
            states=self.states,
            inputs=self.inputs,
            dt=self.dt,
        )

    def rhs(self, x: Float[ndarray, "*N n"], u: Float[ndarray, "*M m"] | None = None) -> Float[ndarray, "*N n"]:
        """Return x' in state units per s, for one state (n,) or many (N, n); u is one for each, or one for all: u_ref.

        In discrete time it is the state after one step, in state units.
        """
        dx = np.asarray(x, float) - self.x_ref
        dot = dx @ self.A0.T + (self.b + self.x_ref if self.is_discrete else self.b)
        for term in self.terms:
            dot = dot + term.values(dx) @ term.A.T
        return np.asarray(dot if u is None else dot + (np.asarray(u, float) - self.u_ref) @ self.B.T)

    def jacobian(self, x: Float[ndarray, "*N n"]) -> Float[ndarray, "*N n n"] | Sparse:
        """Return the matrix of derivatives of x' by x at one state or many, in 1/s; a sparse model at one, sparse.

        In discrete time they are those of the state after one step.
        """
        dx = np.asarray(x, float) - self.x_ref
        J: Any = self.A0.copy() if self.is_sparse else np.broadcast_to(self.A0, (*dx.shape, self.n)).copy()
        for term in self.terms:
            scaled = term.A * term.derivatives(dx)[..., None, :]
            J = J + (scaled if term.R is None else scaled @ term.R)
        if self.is_sparse:
            J = csc_array(J)
        matrix: ndarray = J
        return matrix

    def simulate(
        self, x0: Any, t: Float[ndarray, " N"], u: Input = None, *, rtol: float = 1e-8, atol: float = 1e-10
    ) -> Trajectories:
        """Integrate from x0 and sample at the times t (s); a run that diverges ends there, with `diverged_at` set.

        A model that is too fast or too stiff to be followed ends with `stopped_at` set; nothing follows from that.

        x0 is one state (n,), or several (k, n), one run each. u is (N, m), held from each sample to the next, or a
        function of t, or None for u_ref; all runs have the same. In discrete time t goes in steps of `dt`, and rtol and
        atol play no part.

        Raises:
            ModelError: x0, t or u has the wrong shape, or t other steps than the model.
        """
        from persid.models.integration import integrate
        from persid.models.recursion import iterate, refuse_other_steps

        if self.is_sparse:
            return self.dense().simulate(x0, t, u, rtol=rtol, atol=atol)
        starts = [finite_array("x0", x, (self.n,)) for x in (x0 if np.ndim(x0) == 2 else [x0])]
        if not starts:
            raise ModelError("x0 holds no state; give one (n,), or several (k, n)")
        t = np.array(t, float)
        given = sampled_input(t, u, self.m)
        if self.dt is not None:
            refuse_other_steps(t, self.dt)
            return Trajectories(tuple(iterate(self.field, x, t, given) for x in starts), self.states, self.inputs)
        return Trajectories(
            tuple(integrate(self.field, x, t, given, rtol, atol) for x in starts), self.states, self.inputs
        )

    def to_callable(self, jit: bool = False) -> Callable[..., ndarray]:
        """Return rhs(t, x, u=None), x' for one state (n,) and input (m,), u = None meaning u_ref, for SciPy's solvers.

        In discrete time it is the state after one step, for a loop of your own.
        With `jit` it is a Numba function, compiled at its first call (about 1 s), that other Numba code may call.

        Raises:
            ImportError: `jit` without Numba; it comes with persid[interop].
        """
        from persid.models.exports.libraries import to_callable

        return to_callable(self.field, jit)

    def to_control(self, name: str | None = None) -> Any:
        """Return a control.NonlinearIOSystem with the model's names and its time; its outputs are the states.

        Raises:
            ImportError: python-control is not installed; it comes with persid[interop].
        """
        from persid.models.exports.libraries import to_control

        return to_control(self.field, name)

    def to_sympy(self, exact: bool = False) -> Any:
        """Return x', or the state after one step, as a sympy.Matrix (n, 1) in symbols named like states and inputs.

        Numbers are SymPy Floats of the same 53 bits, or with `exact` the rational numbers that the binary64 are.

        Raises:
            ImportError: SymPy is not installed; it comes with persid[interop].
        """
        from persid.models.exports.libraries import to_sympy

        return to_sympy(self.field, exact)

    def to_latex(self, digits: int = 4) -> str:
        """Return the equations as one `aligned` environment, numbers rounded to so many significant digits."""
        from persid.models.exports.libraries import to_latex

        return to_latex(self.field, digits)

    def to_casadi(self, name: str = "rhs") -> Any:
        """Return a casadi.Function (x, u) -> x_dot of scalar expressions (SX), to differentiate and optimise with.

        In discrete time its output is x_next.

        Raises:
            ImportError: CasADi is not installed; it comes with persid[interop].
        """
        from persid.models.exports.libraries import to_casadi

        return to_casadi(self.field, name)

    def to_dict(self) -> Json:
        """Return the model as the object of `model.json`."""
        return {
            "format": FORMAT,
            "states": list(self.states),
            "inputs": list(self.inputs),
            "x_ref": self.x_ref.tolist(),
            "u_ref": self.u_ref.tolist(),
            "A0": _listed(self.A0),
            "terms": [_term_dict(term) for term in self.terms],
            "B": _listed(self.B),
            "b": self.b.tolist(),
            "domain": None if self.domain is None else self.domain.tolist(),
            "provenance": self.provenance,
        } | ({"time": self.time, "dt": self.dt} if self.is_discrete else {})

    def compressed(self) -> Compressed:
        """Return the model's object without its numbers, and the arrays of these."""
        matrices = {"A0": self.A0, "B": self.B}
        for t, term in enumerate(self.terms):
            matrices |= {f"terms.{t}.A": term.A} | ({} if term.R is None else {f"terms.{t}.R": term.R})
        vectors = {name: getattr(self, name) for name in ("x_ref", "b") if getattr(self, name).any()}
        default = self.states == tuple(f"x{i + 1}" for i in range(self.n))
        content = {
            "format": FORMAT,
            "states": self.n if default else list(self.states),
            "inputs": list(self.inputs),
            "u_ref": self.u_ref.tolist(),
            "terms": [_texts(term) for term in self.terms],
        }
        return Compressed.of(content, matrices, vectors | ({} if self.domain is None else {"domain": self.domain}))

    @classmethod
    def from_dict(cls, data: object, folder: Path | None = None) -> "PersidskiiModel":
        """Return the model of an object such as `model.json` holds; unknown fields are refused.

        `folder` is where companions of sparse matrices stand.
        """
        if not isinstance(data, Mapping) or data.get("format") != FORMAT:
            raise ModelError(f'a model has "format": "{FORMAT}"')
        unknown_fields(data, _FIELDS, {"states", "B", "terms"})
        if holds_objects(data):
            return cls(**columns.load(data, folder))
        check_kinds(data)
        values: Json = {name: data.get(name) for name in _FIELDS if name not in ("format", "time")}
        values["time"] = data.get("time", "continuous")
        n, m = len(data["states"]), len(data.get("inputs") or [])
        values["B"] = np.zeros((n, m)) if m == 0 else values["B"]
        values["A0"] = np.zeros((n, n)) if values["A0"] is None else values["A0"]
        return cls(**values)

    def save(self, path: str | Path) -> None:
        """Write `model.json`: reading it gives the same binary64 numbers back. Written beside, then renamed.

        The arrays of a large sparse model go to a companion of the same stem, .npz.
        """
        content = self.compressed().save(Path(path), self.provenance) if self.is_large else self.to_dict()
        write_atomically(path, readable(content) + "\n")

    @cached_property
    def sha256(self) -> str:
        """SHA-256 over the canonical JSON of the model (hexadecimal floats, without provenance)."""
        return sha256_of(self.canonical)

    @cached_property
    def canonical(self) -> Json:
        """The form that proofs hold and that is hashed: numbers as hexadecimal floats, of a large model digests.

        `from_canonical` is the way back.
        """
        return self.compressed().exact.form() if self.is_large else canonical_model(self.to_dict())

    @classmethod
    def from_canonical(cls, form: Mapping[str, object], arrays: bytes | None = None) -> "PersidskiiModel":
        """Return the model of a canonical form; of a large one `arrays` are the bytes of the companion."""
        if arrays is None:
            return cls.from_dict(plain_model(dict(form)))
        found = sparse.read_sparse(form, companion.read(arrays))
        return cls(**columns.arguments(found))


_FIELDS = (
    "format", "states", "inputs", "x_ref", "u_ref", "A0", "terms", "B", "b", "domain", "provenance", "time", "dt"
)  # fmt: skip


def _filled(matrix: Any) -> Any:
    return matrix.toarray() if columns.is_sparse(matrix) else matrix


def _listed(matrix: Any) -> Any:
    return columns.triplets(matrix) if columns.is_sparse(matrix) else matrix.tolist()


def _texts(term: Term) -> str | list[str]:
    texts = [f.text for f in term.f]
    return texts[0] if len(set(texts)) == 1 else texts


def _term_dict(term: Term) -> Json:
    return {
        "f": _texts(term),
        "R": None if term.R is None else _listed(term.R),
        "A": _listed(term.A),
    }
