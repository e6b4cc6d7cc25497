"""Certificates: from floating-point multipliers to a file of exact numbers that `persid_check` accepts.

A Certificate holds the very bytes that were accepted; nothing else in persid may say that a model is certified.
"""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json, json_object, write_atomically
from persid.certificates import bounds
from persid.certificates import output_bounds as seen
from persid.certificates.acceptance import accepted
from persid.certificates.claims import Claim, claim_of
from persid.certificates.encoding import encode, separated
from persid.errors import ModelError, PersidError
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid.models.sparse import archive
from persid_check import companion
from persid_check.ledger.arrays import filled
from persid_check.model import ALGEBRAIC


@dataclass(frozen=True, eq=False)
class Certificate:
    """A proof that a model is input-to-state stable, accepted by `persid_check` byte for byte.

    `statement` and `steps` are the checker's own words; `claim` is "iss", "rate-and-gain", "practical" (these for all
    initial states) or "region". Files of both formats are read.

    Examples:
        >>> certificate = ps.certify(ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])).certificate
        >>> certificate.scope, certificate.rate is not None
        ('global', True)
    """

    data: bytes
    claim: str
    statement: str
    steps: tuple[str, ...]
    further: tuple[str, ...] = ()
    arrays: bytes | None = None

    def __reduce__(self) -> tuple[type["Certificate"], tuple[object, ...]]:
        fields = self.data, self.claim, self.statement, self.steps, self.further, self.arrays
        return Certificate, fields  # what is read from the bytes is large, and not all of it can be pickled

    @classmethod
    def of(cls, content: Json) -> "Certificate":
        """Return the certificate that a content is, once the checker accepts it; large matrices go to a companion.

        Raises:
            RejectedError: the checker rejects it or finds it malformed; the message gives its reason.
        """
        content, large = separated(content)
        if not large:
            return cls.accept(encode(content))
        arrays = archive(large)
        digest = hashlib.sha256(arrays).hexdigest()
        stored = {"npz": f"certificate-{digest[:16]}.npz", "sha256": digest}
        return cls.accept(encode(content | {"companion": stored}), arrays)

    @classmethod
    def accept(cls, data: bytes, arrays: bytes | None = None) -> "Certificate":
        """Return the certificate that these bytes are, if the checker accepts them as a proof of stability.

        `arrays` are the bytes of the companion that they name, if any.

        Raises:
            RejectedError: the checker rejects them or finds them malformed; the message gives its reason.
        """
        answer = accepted(data, ("iss", "rate-and-gain", "region", "practical"), arrays)
        return cls(data, answer.claim, answer.statement, answer.steps, answer.further, arrays)

    def __repr__(self) -> str:
        return f"Certificate({self.claim}, {len(self.data)} bytes: {self.statement})"

    def _repr_html_(self) -> str:
        from persid.certificates.tables import of_certificate

        return of_certificate(self)

    def save(self, path: str | Path) -> None:
        """Write the accepted bytes, and beside them the companion under the name that they give."""
        if self.arrays is not None:
            write_atomically(Path(path).with_name(self.content["companion"]["npz"]), self.arrays)
        write_atomically(path, self.data)

    @cached_property
    def content(self) -> Json:
        """The certificate as an object, with its model's matrices written out where they stand in the companion."""
        content = json_object(self.data)
        if self.arrays is None:
            return content
        return content | {"model": filled(content["model"], companion.read(self.arrays))}

    @cached_property
    def model(self) -> Any:
        """The model of which the certificate speaks: a PersidskiiModel, or a DescriptorModel."""
        form = self.content["model"]
        return (DescriptorModel if ALGEBRAIC in form else PersidskiiModel).from_canonical(form)

    @cached_property
    def stated(self) -> Claim:
        """What is claimed, in exact numbers, the same for both formats."""
        return claim_of(self.content)

    @property
    def scope(self) -> str:
        """Whether the claim holds for all initial states ("global") or in a region ("regional")."""
        return "regional" if self.claim == "region" else "global"

    @property
    def operating_point(self) -> Float[ndarray, " n"]:
        """The state about which stability is claimed, in the user's units."""
        return self.model.x_ref if self.stated.x is None else np.array(self.stated.x, float)

    @property
    def input(self) -> Float[ndarray, " m"]:
        """The constant input u* for which the operating point is one."""
        return self.model.u_ref if self.stated.u is None else np.array(self.stated.u, float)

    @cached_property
    def P(self) -> Float[ndarray, "k k"]:
        """The matrix of the quadratic part of V, over the states and, of some certificates, values of functions."""
        rows = self.stated.P
        if self.stated.diagonal:
            return np.diag([float(entry) for (entry,) in rows])
        lower = np.array([[float(v) for v in row] + [0.0] * (len(rows) - len(row)) for row in rows])
        return np.asarray(lower + np.tril(lower, -1).T)

    @property
    def rate(self) -> float | None:
        """The decay rate of the state, in 1/s, rounded down; None for claim "iss", which has none."""
        return bounds.rate(self.stated) if self.stated.has_rate else None

    @property
    def contraction(self) -> float | None:
        """The share of the state's bound that one step leaves, sqrt(1 - kappa), rounded up; None in continuous time."""
        if not (self.stated.has_rate and self.model.is_discrete):
            return None
        return bounds.factor(self.stated)

    @property
    def gain(self) -> float | None:
        """The gain sqrt(gamma/(kappa p)) from sup|u - u*| to |x - x*|, rounded up; None for claim "iss".

        None where outputs are bounded, too: states that nobody measured have no unit; see `output_gains`.
        """
        return bounds.above(bounds.gain(self.stated)) if self.stated.has_rate and not self.outputs else None

    @property
    def outputs(self) -> tuple[str, ...]:
        """The names of the outputs that are bounded, each in its own unit; none for a model of states alone."""
        return tuple(output.name for output in self.stated.outputs)

    @property
    def output_gains(self) -> Float[ndarray, " l"] | None:
        """The gain from sup|u - u*| to |y - y*| of every output, rounded up; None without outputs."""
        return np.array([bounds.above(ball) for ball in seen.gains(self.stated)]) if self.outputs else None

    @property
    def feedback_margins(self) -> Float[ndarray, " l"] | None:
        """How strong an unmodelled feedback from one output alone may be: 1/gain of each output, rounded down.

        With u - u* = v + w and |w| <= a sup|y_i - y_i*| so far (or the same for roots of integrals of squares), inputs
        and outputs stay bounded for bounded v where a is smaller; of several outputs at once, where the sum of a_i over
        its margin is below 1. In units of the inputs over those of the output; None where this is not proved.
        """
        return seen.feedback_margins(self.stated) if "feedback" in self.further else None

    @property
    def is_incremental(self) -> bool:
        """Whether the bounds hold between any two solutions, so that every simulation forgets its start."""
        return "incremental" in self.further

    def output_bound(self, x0: object, u_sup: float, t: object) -> Float[ndarray, "N l"]:
        """Return an upper bound of |y_i - y_i*| at times t (s), for every input with sup|u - u*| <= u_sup.

        Raises:
            PersidError: no outputs are bounded, x0 lies outside the certified region, or u_sup exceeds its input bound.
            ModelError: x0, u_sup or t is no state, no size of an input, or no times from 0 on.
        """
        if not self.outputs:
            raise PersidError("the certificate bounds no outputs; certify an OutputModel")
        x0, t = self._start(x0), _times(t)
        self._refuse_inputs(np.asarray(u_sup, float))
        return seen.bound(self.stated, x0, self._joint(float(u_sup)), t)

    @property
    def gains(self) -> Float[ndarray, " m"] | None:
        """The gain from sup|u_l - u_l*| to |x - x*| of each input, rounded up: their parts of the bound add up.

        All equal `gain` unless the certificate was made with gains="each". None for claim "iss".
        """
        if not self.stated.has_rate or self.outputs:
            return None
        found = bounds.gains(self.stated, self.model.m + self.counts_b)
        return np.array([bounds.above(ball) for ball in found[: self.model.m]])

    @property
    def input_bound(self) -> float | None:
        """The admissible sup|u - u*| of a regional claim, rounded down; None for global claims."""
        return bounds.below(self.stated.input_bound) if self.claim == "region" else None

    @property
    def input_bounds(self) -> Float[ndarray, " m"] | None:
        """How far each input alone may go, the others at u*: its sup|u_l - u_l*|, rounded down; None for global claims.

        `bound` says which sizes of several inputs at once are admitted.
        """
        return bounds.input_bounds(self.stated, self.model.m) if self.claim == "region" else None

    @property
    def level(self) -> float | None:
        """The level c of the certified region {V <= c} of a regional claim; None for global claims."""
        return bounds.below(self.stated.level) if self.claim == "region" else None

    @property
    def spread(self) -> float | None:
        """The distance from x* at which the state may stay without inputs: of plants whose deviations have constant
        parts, of claim "practical", where x_ref stands for x*, and where b counts as one more input.

        In state units, rounded up; 0 otherwise. None for claim "iss".
        """
        if not self.stated.has_rate:
            return None
        own = bounds.remaining(self.stated)
        held = bounds.gains(self.stated, self.model.m + 1)[-1] if self.counts_b else 0  # b, an input that is held at 1
        return abs(bounds.above(own + held))

    def overshoot(self, x0: object) -> float:
        """Return sqrt(V(x0)/p), rounded up: without input and `spread` |x(t) - x*| never exceeds it.

        Raises:
            PersidError: the claim has no rate, or x0 lies outside the certified region.
        """
        return bounds.above(bounds.overshoot(self.stated, self._start(x0)))

    def bound(self, x0: object, u_sup: object, t: object) -> Float[ndarray, " N"]:
        """Return an upper bound of |x(t) - x*| at times t (s), for every input with sup|u - u*| <= u_sup.

        In discrete time it is about multiples of dt. Where u_sup is a vector (m,), it bounds each input apart:
        sup|u_l - u_l*| <= u_sup[l]. Rounded outwards, in the
        user's units; where b counts as one more input (no operating point), it is included.

        Raises:
            PersidError: the claim has no rate, x0 lies outside the certified region, or u_sup exceeds its input bound.
            ModelError: x0, u_sup or t is no state, no size of an input, or no times from 0 on.
        """
        x0, t, u_sup = self._start(x0), _times(t), np.asarray(u_sup, float)
        self._refuse_inputs(u_sup)
        if u_sup.ndim:
            return bounds.bound(self.stated, x0, [*u_sup.tolist(), *[1.0] * self.counts_b], t)
        return bounds.bound(self.stated, x0, self._joint(float(u_sup)), t)

    def _joint(self, u_sup: float) -> float:
        """Return the size of all that counts as an input: with b, that of (u - u*, 1)."""
        return float(np.nextafter(np.hypot(u_sup, 1.0), np.inf)) if self.counts_b else u_sup

    def _refuse_inputs(self, u_sup: ndarray) -> None:
        """Refuse what is no size of the inputs, or one that the certificate does not admit."""
        if not (np.isfinite(u_sup).all() and (u_sup >= 0).all()):
            raise ModelError(f"sup|u - u*| = {u_sup} must be finite and at least 0")
        if u_sup.shape not in ((), (self.model.m,)):
            raise ModelError(
                f"u_sup has shape {u_sup.shape}; needed is a number, or one for each of {self.model.m} inputs"
            )
        if not self._admits(u_sup):
            raise PersidError(
                f"sup|u - u*| = {u_sup.tolist()} exceeds what the certificate admits: {self.input_bound:g} for |u - u*|"
            )

    @property
    def counts_b(self) -> bool:
        """Whether the constant b counts as one more input, held at 1."""
        return self.stated.x is None and bool(self.model.b.any())

    def _admits(self, u_sup: ndarray) -> bool:
        """Whether a region stays invariant for inputs of this size: v'Gamma v <= kappa c."""
        if self.input_bound is None:
            return True
        if not u_sup.ndim:
            return bool(u_sup <= self.input_bound)
        room = self.stated.kappa * self.stated.level - self.stated.constant_supply
        return bounds.supply(self.stated.gamma, u_sup.tolist()) <= room

    def _start(self, x0: object) -> ndarray:
        """Return x0 as a state from which the estimate holds."""
        if not self.stated.has_rate:
            raise PersidError("the claim has no rate and no gain; certify gives them (rate-and-gain) where it can")
        start = np.asarray(x0, float)
        if start.shape != (self.model.n,) or not np.isfinite(start).all():
            raise ModelError(f"x0 is {start.tolist()}; needed are {self.model.n} finite numbers")
        if self.claim == "region" and not bounds.is_in_region(self.stated, start):
            raise PersidError(f"x0 = {start.tolist()} is not proved to lie in the certified region")
        return start

    def V(self, x: Float[ndarray, "N n"]) -> Float[ndarray, " N"]:
        """Return the Lyapunov function at states x (N, n): V(x) = z'P z + 2 sum of integrals, z = x - x*.

        Where the proof needs slopes of functions, z also holds their values f_c(x) - f_c(x*).
        """
        channels, point = self.model.channels, self.operating_point
        dx = np.asarray(x, float) - point
        z = np.column_stack([dx, *(self._rise(c, dx) for c in self.stated.inside)])
        total: ndarray = np.einsum("ki,ij,kj->k", z, self.P, z)
        for part in self.stated.parts:
            row = np.zeros(self.model.n)
            row[list(part.row)] = [float(v) for v in part.row.values()]
            density = [float(v) for v in part.density]
            y, at = dx @ row, float(row @ (point - self.model.x_ref))
            total = total + density[0] * y**2
            weighted = zip(density[1:], part.members, strict=True)
            for weight, (c, alpha) in ((w, member) for w, member in weighted if w):  # an integral may be infinite
                f, a = channels.functions[c], float(alpha)
                start = np.array([a * at])
                slope = self._subtracted * f.value(start)
                integral = (f.antiderivative(a * (at + y)) - f.antiderivative(start)) / a - slope * y
                total = total + 2 * weight * integral
        return total

    def _rise(self, c: int, dx: Float[ndarray, "N n"]) -> Float[ndarray, " N"]:
        """Return f_c at x* + dx less its value at x*."""
        channels = self.model.channels
        f, row = channels.functions[c], channels.rows[c]
        at = row @ (self.operating_point - self.model.x_ref)
        return np.asarray(f.value(at + dx @ row) - self._subtracted * f.value(at))

    @property
    def _subtracted(self) -> bool:
        """Whether functions count less their values at x*: not about x_ref itself."""
        return self.stated.x is not None


def _times(t: object) -> Float[ndarray, " N"]:
    times = np.atleast_1d(np.asarray(t, float))
    if not (np.isfinite(times).all() and (times >= 0).all()):
        raise ModelError(f"the times t = {t} must be finite and at least 0")
    return times
