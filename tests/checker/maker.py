# ruff: noqa: E741 (l is the letter of the mathematics)
"""A tiny maker of certificates for the tests: a semidefinite program by cvxpy, rounded; nothing is trusted."""

import json
import math
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from persid_check import canonical_model, model_sha256
from persid_check.exact import Matrix
from persid_check.model import model_of
from persid_check.reading import Ball
from persid_check.subject import Subject, groups_of
from persid_check.version_1.claims import lower_bound
from persid_check.version_1.format import GroupProof, Stability
from persid_check.version_1.inequality import assemble

GRID = 2**24


def dyadic(value: Any) -> list[int]:
    """[mantissa, exponent] of an exact dyadic number."""
    numerator, denominator = Fraction(value).limit_denominator(1 << 2000).as_integer_ratio()
    if denominator & (denominator - 1):
        raise ValueError(f"{value} is not dyadic")
    return [numerator, 1 - denominator.bit_length()]


def rounded(value: float) -> Fraction:
    """A dyadic near a float."""
    return Fraction(round(value * GRID), GRID)


def model(
    terms: list[tuple[Any, Any, Any]], A0: Any = None, B: Any = None, *, n: int = 1, b: Any = None, x_ref: Any = None
) -> dict[str, Any]:
    """A model.json object."""
    B = np.ones((n, 1)).tolist() if B is None else B
    return {
        "format": "persid-model-1",
        "states": [f"x{i + 1}" for i in range(n)],
        "inputs": [f"u{i + 1}" for i in range(len(B[0]))],
        "x_ref": x_ref,
        "u_ref": None,
        "A0": A0,
        "terms": [{"f": f, "R": R, "A": A} for f, R, A in terms],
        "B": B,
        "b": b,
        "domain": None,
    }


def file(model_object: dict[str, Any], claim: str, **fields: Any) -> dict[str, Any]:
    """The common fields of a certificate, and the others as given."""
    return {
        "format": "persid-certificate-1",
        "claim": claim,
        "statement": "for people",
        "model_sha256": model_sha256(model_object),
        "model": canonical_model(model_object),
        **fields,
    }


def data(certificate: dict[str, Any]) -> bytes:
    """The bytes of a certificate file."""
    return json.dumps(certificate).encode()


@dataclass(frozen=True)
class Wanted:
    """What to prove: forms of each group as text-free tuples, with constants c and d where a claim needs them."""

    model: dict[str, Any]
    forms: list[list[tuple[Any, ...]]]
    claim: str = "G"
    c: list[list[Any]] = field(default_factory=list)
    d: list[list[Any]] = field(default_factory=list)
    kappa: Any = 0
    point: tuple[list[Any], Any, list[Any]] | None = None
    full: bool = False
    dropped: tuple[int, ...] = ()
    box: list[tuple[Any, Any]] = field(default_factory=list)
    products: bool = True


def make(wanted: Wanted) -> dict[str, Any]:
    """Solve, round, and write the certificate; nothing tells whether the checker will accept it."""
    claim = _solved(_empty(wanted), wanted)
    claim = _with_bounds(claim, wanted)
    return _written(claim, wanted)


def _empty(wanted: Wanted) -> Stability:
    form = canonical_model(wanted.model)
    m = model_of(form)
    subject = Subject(wanted.claim, model_sha256(form), form, m, groups_of(m))
    fractions = [[tuple(Fraction(v) for v in form) for form in forms] for forms in wanted.forms]
    proofs = []
    for g, forms in enumerate(fractions):
        zero = tuple(Fraction(0) for _ in forms)
        c = tuple(None if v is None else Fraction(v) for v in wanted.c[g]) if wanted.c else ()
        d = tuple(None if v is None else Fraction(v) for v in wanted.d[g]) if wanted.d else ()
        pairs = [(k, l, Fraction(0)) for k in range(len(forms)) for l in range(k + 1, len(forms)) if wanted.products]
        proofs.append(GroupProof(tuple(forms), zero, tuple(pairs), c, d))
    point = None
    if wanted.point is not None:
        x, radius, u = wanted.point
        point = Ball(tuple(map(Fraction, x)), Fraction(radius), tuple(map(Fraction, u)))
    rows = tuple((Fraction(0),) * (i + 1 if wanted.full else 1) for i in range(m.n))
    one, zero = Fraction(1), Fraction(0)
    box = tuple((Fraction(lo), Fraction(hi)) for lo, hi in wanted.box)
    return Stability(
        subject, point, rows, not wanted.full, tuple(proofs), wanted.dropped, one, Fraction(wanted.kappa), zero, box,
        zero, zero, {},
    )  # fmt: skip


def _unknowns(claim: Stability) -> list[tuple[str, int, int]]:
    found = [("P", i, j) for i, row in enumerate(claim.P) for j in range(len(row)) if i not in claim.dropped]
    for g, proof in enumerate(claim.groups):
        found += [("mu", g, k) for k in range(len(proof.forms))]
        found += [("tau", g, k) for k in range(len(proof.products))]
    return found


def _set(claim: Stability, values: list[tuple[tuple[str, int, int], Fraction]]) -> Stability:
    P, groups = [list(row) for row in claim.P], list(claim.groups)
    for (kind, i, j), value in values:
        if kind == "P":
            P[i][j] = value
        elif kind == "mu":
            mu = list(groups[i].mu)
            mu[j] = value
            groups[i] = replace(groups[i], mu=tuple(mu))
        else:
            products = list(groups[i].products)
            products[j] = (*products[j][:2], value)
            groups[i] = replace(groups[i], products=tuple(products))
    return replace(claim, P=tuple(tuple(row) for row in P), groups=tuple(groups))


def _float(part: Matrix) -> np.ndarray:
    return np.array([[float(part.entry(i, j)) for j in range(part.width)] for i in range(part.height)]).reshape(
        part.height, part.width
    )


def _kept(claim: Stability) -> list[int]:
    size = claim.subject.model.n + len(claim.subject.model.channels)
    return [i for i in range(size) if i not in claim.dropped]


def _solved(claim: Stability, wanted: Wanted) -> Stability:
    import cvxpy as cp

    names, kept = _unknowns(claim), _kept(claim)
    states = [i for i in kept if i < claim.subject.model.n]
    losses, bounds = [], []
    for name in names:
        part = _set(claim, [(name, Fraction(1))])
        matrices = assemble(part)
        losses.append((-_float(matrices.Q) - float(claim.kappa) * _float(matrices.W))[np.ix_(kept, kept)])
        P = lower_bound(part, matrices) if wanted.claim == "R" else matrices.P
        bounds.append(_float(P)[np.ix_(states, states)])
    y, t = cp.Variable(len(names)), cp.Variable()
    loss = sum(y[k] * losses[k] for k in range(len(names)))
    constraints = [loss - t * np.eye(len(kept)) >> 0]
    if states:
        bound = sum(y[k] * bounds[k] for k in range(len(names)))
        constraints.append(bound - t * np.eye(len(states)) >> 0)
    multipliers = [k for k, (kind, _, _) in enumerate(names) if kind != "P"]
    if multipliers:
        constraints.append(y[multipliers] >= 0)
    scale = [k for k, (kind, i, j) in enumerate(names) if kind == "mu" or (kind == "P" and (i == j or not wanted.full))]
    problem = cp.Problem(cp.Maximize(t), [*constraints, cp.sum(y[scale]) <= 1, cp.norm_inf(y) <= 100])
    problem.solve(solver=cp.CLARABEL)
    values = [(name, rounded(float(v))) for name, v in zip(names, y.value, strict=True)]
    return _set(claim, [(name, value if name[0] == "P" else max(value, Fraction(0))) for name, value in values])


def _block(claim: Stability) -> np.ndarray:
    matrices, kept = assemble(claim), _kept(claim)
    loss = -_float(matrices.Q) - float(claim.kappa) * _float(matrices.W)
    side = -(_float(matrices.E) @ _float(matrices.inputs))[kept]
    return np.block([[loss[np.ix_(kept, kept)], side], [side.T, float(claim.gamma) * np.eye(side.shape[1])]])


def _with_bounds(claim: Stability, wanted: Wanted) -> Stability:
    """The least power of two for gamma, and p, level and input_bound with some room."""
    for k in range(-10, 60):
        claim = replace(claim, gamma=Fraction(2) ** k)
        if np.linalg.eigvalsh(_block(claim))[0] > 1e-9:
            break
    if wanted.claim in ("E", "R"):
        Pt = _lower(claim)
        claim = replace(claim, p=rounded(0.9 * np.linalg.eigvalsh(Pt)[0]))
    if wanted.claim == "R":
        half = [min(-float(lo), float(hi)) for lo, hi in wanted.box]
        level = 0.9 * min(h**2 / v for h, v in zip(half, np.diag(np.linalg.inv(Pt)), strict=True))
        bound = math.sqrt(0.99 * float(claim.kappa) * level / float(claim.gamma))
        claim = replace(claim, level=rounded(level), input_bound=rounded(bound))
    return claim


def _lower(claim: Stability) -> np.ndarray:
    matrices = assemble(claim)
    states = [i for i in _kept(claim) if i < claim.subject.model.n]
    P = lower_bound(claim, matrices) if claim.subject.claim == "R" else matrices.P
    return _float(P)[np.ix_(states, states)]


def factor(M: np.ndarray) -> list[list[int]]:
    """An inverse Cholesky factor, each row scaled and rounded to 16 bits; the identity where there is none."""
    if not len(M):
        return []
    try:
        T = np.linalg.inv(np.linalg.cholesky(M))
    except np.linalg.LinAlgError:
        T = np.eye(len(M))
    T *= 2**16 / np.abs(T).max(axis=1, keepdims=True)
    return [[round(v) for v in row[: i + 1]] for i, row in enumerate(T.tolist())]


def _written(claim: Stability, wanted: Wanted) -> dict[str, Any]:
    groups = []
    for proof in claim.groups:
        entry: dict[str, Any] = {
            "forms": [[dyadic(v) for v in form] for form in proof.forms],
            "mu": [dyadic(v) for v in proof.mu],
            "products": [[k, l, dyadic(tau)] for k, l, tau in proof.products if tau],
        }
        if wanted.claim in ("E", "R"):
            entry["integral"] = [None if v is None else dyadic(v) for v in proof.integral]
        if wanted.claim == "R":
            entry["quadratic"] = [None if v is None else dyadic(v) for v in proof.quadratic]
        groups.append(entry)
    P = [[dyadic(v) for v in row] for row in claim.P]
    fields: dict[str, Any] = {
        "operating_point": None,
        "P": {"lower": P} if wanted.full else {"diagonal": [row[0] for row in P]},
        "groups": groups,
        "dropped": list(claim.dropped),
        "gamma": dyadic(claim.gamma),
    }  # fmt: skip
    if claim.point is not None:
        x, u = ([dyadic(v) for v in part] for part in (claim.point.x, claim.point.u))
        fields["operating_point"] = {"x": x, "radius": dyadic(claim.point.radius), "u": u}
    lower = _lower(claim)
    if wanted.claim in ("E", "R"):
        fields |= {"kappa": dyadic(claim.kappa), "p": dyadic(claim.p)}
        lower = lower - float(claim.p) * np.eye(len(lower))
    if wanted.claim == "R":
        box = [[dyadic(lo), dyadic(hi)] for lo, hi in claim.box]
        fields |= {"box": box, "level": dyadic(claim.level), "input_bound": dyadic(claim.input_bound)}
    fields["proof"] = {"P": factor(lower), "Q": factor(_block(claim))}
    return file(wanted.model, wanted.claim, **fields)


__all__ = ["Wanted", "data", "dyadic", "factor", "file", "make", "model"]
