"""Witnesses: what refutes input-to-state stability at the nominal input, found here and proved by `persid_check`."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy.linalg as sla
from flint import fmpq, fmpq_mat
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import dyadic, dyadics, rounded
from persid._files import Json, json_object, write_atomically
from persid.certificates.acceptance import accepted
from persid.certificates.encoding import encode, factor, heading
from persid.errors import RejectedError, RoundingError
from persid.lyapunov.operating_points import OperatingPoint, find_operating_point, usual_box
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid_check.refutations.format import POSED

BESIDE = 3  # states beside one of rest at which a second solution of equations is looked for


@dataclass(frozen=True, eq=False)
class Witness:
    """A proof that a model is not input-to-state stable, accepted by `persid_check` byte for byte.

    With algebraic variables it may be a proof that the model is not well-posed instead: `is_about_equations`.

    `sentence` is for people; `statement` and `steps` are the checker's own words.

    Examples:
        >>> verdict = ps.certify(ps.PersidskiiModel(A0=[[1.0]], B=[[1.0]]))
        >>> verdict.witness.save("witness.json")
        >>> ps.check("witness.json").claim
        'refuted'
    """

    data: bytes
    kind: str
    sentence: str
    statement: str
    steps: tuple[str, ...]

    @classmethod
    def accept(cls, data: bytes) -> "Witness":
        """Return the witness that these bytes are.

        Raises:
            RejectedError: the checker does not accept them as one; the message gives its reason.
        """
        answer, content = accepted(data, ("refuted",)), json_object(data)
        return cls(data, content["witness"]["kind"], content["statement"], answer.statement, answer.steps)

    @property
    def is_about_equations(self) -> bool:
        """Whether it says that equations do not tell what their variables are, and nothing about stability."""
        return self.kind in POSED

    def save(self, path: str | Path) -> None:
        """Write the accepted bytes."""
        write_atomically(path, self.data)

    @cached_property
    def content(self) -> Json:
        """The witness file as an object."""
        return json_object(self.data)

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True, eq=False)
class _Candidate:
    kind: str
    fields: Json
    sentence: str


def find_unposed(model: DescriptorModel, u: Float[ndarray, " m"], points: Sequence[OperatingPoint]) -> Witness | None:
    """Return a proof, accepted by the checker, that equations do not tell what their variables are, if one is found."""
    return _first(model, u, _free_direction(model)) or _first(model, u, _two_solutions(model, u, points))


def find_witness(
    model: PersidskiiModel | DescriptorModel, u: Float[ndarray, " m"], points: Sequence[OperatingPoint]
) -> Witness | None:
    """Return the first witness that the checker accepts, cheap ones first; `points` are proved equilibria at u."""
    return _first(model, u, _candidates(model, u, points))


def _first(model: PersidskiiModel | DescriptorModel, u: ndarray, candidates: Iterator[_Candidate]) -> Witness | None:
    for candidate in candidates:
        proof = {"u": dyadics(u), "witness": {"kind": candidate.kind, **candidate.fields}}
        with suppress(RejectedError):
            return Witness.accept(encode({**heading(model, "refuted", candidate.sentence), **proof}))
    return None


def _candidates(
    model: PersidskiiModel | DescriptorModel, u: ndarray, points: Sequence[OperatingPoint]
) -> Iterator[_Candidate]:
    if isinstance(model, DescriptorModel):  # other kinds read rows as derivatives
        yield from _two_equilibria(model.rows, u, points)
        yield from _unstable_with_equations(model, u, points)
        return
    for make in _OF_STEPS if model.is_discrete else _KINDS:
        yield from make(model, u, points)


def _at(model: PersidskiiModel, u: ndarray) -> str:
    return "without input" if not model.m else f"at its nominal input u = {_numbers(u)}"


def _numbers(x: ndarray) -> str:
    shown = ", ".join(f"{v:.4g}" for v in x[:6]) + (", …" if len(x) > 6 else "")
    return shown if len(x) == 1 else f"({shown})"


def _unstable_equilibrium(model: PersidskiiModel, u: ndarray, points: Sequence[OperatingPoint]) -> Iterator[_Candidate]:
    """A quadratic form that grows along the linearisation where the Jacobian has an unstable eigenvalue."""
    for point in points:
        grown = _growth(model.jacobian(point.x), model.is_discrete)
        if grown is not None:
            sentence = f"{_at(model, u)} its equilibrium {_numbers(point.x)} is unstable, so the model is not ISS."
            yield _Candidate(
                "unstable-equilibrium",
                {"point": point.to_dict(with_input=False), **grown},
                sentence[0].upper() + sentence[1:],
            )


def _unstable_with_equations(
    model: DescriptorModel, u: ndarray, points: Sequence[OperatingPoint]
) -> Iterator[_Candidate]:
    """The same of x' by x with the equations solved, and multipliers that need no solution.

    With dw = G dx + e and J_w the slopes of the equations by w, J_w e = 0 along solutions. For the rows

        N (dx, dw) = J_w^-T (e - J_xw'S dx)   is   2 dx'S (J_r dx + J_xw e) + 2 (N d)'(J_w e) = 2 dx'S J_r dx + 2 |e|^2.
    """
    n = model.n
    for point in points:
        J, G = np.asarray(model.rows.jacobian(point.x)), model.following(point.x)
        grown = _growth(model.jacobian(point.x), False)
        if grown is None:
            continue
        S = _symmetric(grown["S"])
        size = float(np.abs(S).max())
        N = rounded(np.linalg.solve(J[n:, n:].T, np.hstack([-size * G - J[:n, n:].T @ S, size * np.eye(len(G))])), 44)
        Y, within = np.vstack([np.hstack([S, np.zeros((n, len(G)))]), N]), np.pad(S, (0, len(G)))
        sigma = 2 * grown["sigma"][0] * 2.0 ** grown["sigma"][1]
        with suppress(RoundingError):
            T = factor(Y.T @ J + J.T @ Y - sigma * within)
            sentence = (
                f"{_at(model.rows, u)} its equilibrium {_numbers(point.x[:n])} is unstable, so the model is not ISS."
            )
            fields = {**grown, "T": T, "multipliers": [dyadics(row) for row in N]}
            yield _Candidate(
                "unstable-equilibrium",
                {"point": point.to_dict(with_input=False), **fields},
                sentence[0].upper() + sentence[1:],
            )


def _symmetric(lower: list[list[list[int]]]) -> Float[ndarray, "n n"]:
    """Return the matrix of lower rows as a file has them."""
    half = np.zeros((len(lower), len(lower)))
    for i, row in enumerate(lower):
        half[i, : i + 1] = [m * 2.0**e for m, e in row]
    return half + np.tril(half, -1).T


def _free_direction(model: DescriptorModel) -> Iterator[_Candidate]:
    """Exact vectors along which no equation changes: the algebraic variables are not told apart."""
    n, channels = model.n, model.channels
    acting = channels.columns[n:].any(axis=0)
    rows = np.vstack([channels.A0[n:, n:], channels.rows[acting][:, n:]])
    for v in _kernel(rows):
        along = _numbers(np.array([float(entry) for entry in v]))
        sentence = f"Its equations do not change along {along} of {', '.join(model.algebraic)}: they do not tell them."
        yield _Candidate("free-direction", {"direction": [[entry, 0] for entry in v]}, sentence)


def _two_solutions(model: DescriptorModel, u: ndarray, points: Sequence[OperatingPoint]) -> Iterator[_Candidate]:
    """Two solutions of the equations at one state: at one of rest, at the reference, and beside them."""
    n, rows = model.n, model.rows
    centre = points[0].x[:n] if points else model.x_ref
    half = (usual_box(rows)[:n, 1] - usual_box(rows)[:n, 0]) / 2
    directions = np.random.default_rng(0).uniform(-1, 1, (BESIDE, n))
    for x in (centre, model.x_ref, *(centre + half * d for d in directions)):
        x = model.x_ref + rounded(x - model.x_ref, 20)
        found = find_operating_point(_held(rows, x), u)
        for first, second in pairwise(found):
            pair = [replace(each, x=np.concatenate([x, each.x[n:]])) for each in (first, second)]
            w, other = (_numbers(each.x[n:]) for each in pair)
            sentence = f"Its equations have several solutions: at x = {_numbers(x)} both {w} and {other}"
            named = f"{sentence} are {', '.join(model.algebraic)}, so the model is not well-posed."
            yield _Candidate("two-solutions", {"points": [each.to_dict(with_input=False) for each in pair]}, named)


def _held(rows: PersidskiiModel, x: Float[ndarray, " n"]) -> PersidskiiModel:
    """Return a model that rests at x with every solution of the equations there."""
    n, channels = len(x), rows.channels
    A0, columns, B, b = rows.channels.A0.copy(), channels.columns.copy(), rows.B.copy(), rows.b.copy()
    A0[:n], columns[:n], B[:n], b[:n] = np.eye(n, rows.n), 0.0, 0.0, rows.x_ref[:n] - x
    terms = [(f, channels.rows[[c]], columns[:, [c]]) for c, f in enumerate(channels.functions) if columns[:, c].any()]
    return PersidskiiModel(A0, terms, B, b=b, x_ref=rows.x_ref, u_ref=rows.u_ref)


def _unstable_linear_part(model: PersidskiiModel, u: ndarray, points: Sequence[OperatingPoint]) -> Iterator[_Candidate]:
    grown = _growth(model.channels.A0, model.is_discrete)
    if grown is not None:
        sentence = "Its functions are bounded and its linear part is unstable: from far out it diverges."
        yield _Candidate("unstable-linear-part", grown, sentence)


def _growth(J: Float[ndarray, "n n"], steps: bool) -> Json | None:
    """Return S, sigma and e with J'S + S J - 2 sigma S near I and e'Se > 0, or None; J may be stable, or not finite.

    In steps it is J'S J - sigma S that is near I, and sigma lies between 1 and the largest |eigenvalue|^2.
    """
    if not np.isfinite(J).all():
        return None
    eigenvalues = np.linalg.eigvals(J)
    largest = float((np.abs(eigenvalues) ** 2 - 1 if steps else eigenvalues.real).max())
    if largest <= 0:
        return None
    for share in (0.5, 0.75, 0.25, 0.9):
        sigma = float(rounded(np.array([share * largest + steps]), 20)[0])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # of a singular equation: S is judged by the checker
                S = _grown(J, sigma, steps)
            S = rounded((S + S.T) / 2 / np.abs(S).max(), 44)
            e = rounded(np.linalg.eigh(S)[1][:, -1], 20)
            T = factor(J.T @ S @ J - sigma * S if steps else J.T @ S + S @ J - 2 * sigma * S)
        except (np.linalg.LinAlgError, RoundingError, ValueError):
            continue
        lower = [dyadics(row[: i + 1]) for i, row in enumerate(S)]
        return {"S": lower, "sigma": dyadic(sigma), "direction": dyadics(e), "T": T}
    return None


def _grown(J: ndarray, sigma: float, steps: bool) -> Float[ndarray, "n n"]:
    """Solve J'S + S J - 2 sigma S = I, or J'S J - sigma S = I."""
    if steps:
        return np.asarray(-sla.solve_discrete_lyapunov(J.T / np.sqrt(sigma), np.eye(len(J)), method="bilinear") / sigma)
    return np.asarray(sla.solve_continuous_lyapunov(J.T - sigma * np.eye(len(J)), np.eye(len(J))))


def _two_equilibria(model: PersidskiiModel, u: ndarray, points: Sequence[OperatingPoint]) -> Iterator[_Candidate]:
    for second in points[1:]:
        first = points[0]
        sentence = (
            f"{_at(model, u)} the model rests at both {_numbers(first.x)} and {_numbers(second.x)}, "
            "so it is not ISS about either."
        )
        pair = [first.to_dict(with_input=False), second.to_dict(with_input=False)]
        yield _Candidate("two-equilibria", {"points": pair}, sentence[0].upper() + sentence[1:])


def _marginal_direction(model: PersidskiiModel, u: ndarray, points: Sequence[OperatingPoint]) -> Iterator[_Candidate]:
    """Exact vectors w with w'A0 = 0, both signs: some constant input may drive w'x to infinity.

    In discrete time w'A0 = w'.
    """
    for w in _left_kernel(model.channels.A0, int(model.is_discrete)):
        for sign in (1, -1):
            direction = [sign * v for v in w]
            if np.any(np.array([float(v) for v in direction]) @ model.B):
                size = max(abs(v) for v in direction)
                sentence = (
                    f"Along w = {_numbers(np.array([float(v) for v in direction]))} it has no linear restoring force: "
                    "a large enough constant input drives w'x to infinity."
                )
                if size < 2**200:
                    yield _Candidate("marginal-direction", {"direction": [[int(v), 0] for v in direction]}, sentence)


def _left_kernel(A0: ndarray, eigenvalue: int) -> Iterator[list[int]]:
    """Yield integer vectors spanning {w : w'A0 = eigenvalue w'}, exactly; nothing for large models."""
    n = len(A0)
    if n > 60 or np.linalg.matrix_rank(A0 - eigenvalue * np.eye(n)) == n:
        return
    exact = [[Fraction(float(v)) - eigenvalue * (i == j) for j, v in enumerate(row)] for i, row in enumerate(A0.T)]
    yield from _kernel(exact)


def _kernel(rows: Sequence[Sequence[Fraction]] | ndarray) -> Iterator[list[int]]:
    """Yield integer vectors spanning what all rows are zero on, exactly."""
    n = len(rows[0])
    entries = [Fraction(v) for row in rows for v in row]
    reduced, rank = fmpq_mat(len(rows), n, [fmpq(v.numerator, v.denominator) for v in entries]).rref()
    pivots = [next(j for j in range(n) if reduced[i, j] != 0) for i in range(rank)]
    for free in (j for j in range(n) if j not in pivots):
        w = [Fraction(0)] * n
        w[free] = Fraction(1)
        for i, pivot in enumerate(pivots):
            entry = reduced[i, free]
            w[pivot] = -Fraction(int(entry.p), int(entry.q))
        scale = int(np.lcm.reduce([v.denominator for v in w], dtype=object))
        yield [int(v * scale) for v in w]


def _cooperative_growth(model: PersidskiiModel, u: ndarray, points: Sequence[OperatingPoint]) -> Iterator[_Candidate]:
    """Starts above an equilibrium, along the direction that grows fastest there and along the diagonal."""
    for point in points[:3]:
        J = model.jacobian(point.x)
        if not np.isfinite(J).all():
            continue
        values, vectors = np.linalg.eig(J)
        perron = np.abs(vectors[:, np.argmax(values.real)].real)
        for direction in (perron, np.ones(model.n)):
            for size in (0.01, 0.1, 1.0, 10.0, 100.0):
                start = rounded(point.x + size * direction / max(direction.max(), 1e-300), 30)
                with np.errstate(all="ignore"):
                    growing = (model.rhs(start, u) > 0).all()
                if growing:
                    sentence = f"It is cooperative, and from {_numbers(start)} on every state grows: it never returns."
                    fields = {"point": point.to_dict(with_input=False), "start": dyadics(start)}
                    yield _Candidate("cooperative-growth", fields, sentence)


def _invariant_line(model: PersidskiiModel, u: ndarray, points: Sequence[OperatingPoint]) -> Iterator[_Candidate]:
    """Lines along a state, the diagonal, or a difference of two states, that the flow does not leave."""
    if model.n > 20:
        return
    units = [np.eye(model.n)[i] for i in range(model.n)]
    for v in [*units, np.ones(model.n), *(units[0] - w for w in units[1:])]:
        for offset in (1.0, -1.0, 4.0, -4.0, 32.0, -32.0):
            with np.errstate(all="ignore"):
                speed = model.rhs(model.x_ref + offset * v, u)
            along = float(speed @ v) / float(v @ v)
            if offset * along >= 0 and np.allclose(speed, along * v, rtol=1e-9, atol=1e-9):
                sentence = f"From x_ref + {offset:g} v, v = {_numbers(v)}, it never returns: the line is invariant."
                yield _Candidate("invariant-line", {"direction": dyadics(v), "offset": dyadic(offset)}, sentence)


Make = Callable[[PersidskiiModel, ndarray, Sequence[OperatingPoint]], Iterator[_Candidate]]
_KINDS: tuple[Make, ...] = (
    _two_equilibria,
    _unstable_equilibrium,
    _marginal_direction,
    _unstable_linear_part,
    _cooperative_growth,
    _invariant_line,
)
_OF_STEPS: tuple[Make, ...] = (_two_equilibria, _unstable_equilibrium, _marginal_direction, _unstable_linear_part)
