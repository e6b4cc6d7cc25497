"""The matrices of the claims, assembled exactly from the model and the multipliers of the file.

z = (x, all channel values), phi_g = N_g z, half the gradient of V is E'z, x' = G z + B u after the shift.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from persid_check.entry import Lower
from persid_check.exact import Matrix, Number, blocks, diagonal, matrix
from persid_check.model import Model
from persid_check.subject import Group
from persid_check.version_1.format import GroupProof, Stability

Square = list[list[Fraction]]


@dataclass(frozen=True)
class Inequality:
    """Q, E, W (claims E and R) and the input columns, for all entries of z."""

    P: Matrix
    G: Matrix
    E: Matrix
    S: Matrix
    Q: Matrix
    W: Matrix
    inputs: Matrix


def assemble(claim: Stability) -> Inequality:
    """Return the matrices of a claim; W belongs to V <= z'W z, with the constants c_k of the file."""
    model, groups, proofs = claim.subject.model, claim.subject.groups, claim.groups
    P = lyapunov_matrix(claim)
    G = model.flow
    E = gradient_matrix(model, groups, P, [density(proof, len(g.members)) for proof, g in _pairs(proofs, groups)])
    S = quadratic_form(model, groups, [_products(proof, len(g.members)) for proof, g in _pairs(proofs, groups)])
    EG = E * G
    W = embedded(P, model)
    if claim.subject.claim in ("E", "R"):
        W = W + quadratic_form(model, groups, [_upper(proof, len(g.members)) for proof, g in _pairs(proofs, groups)])
    return Inequality(P=P, G=G, E=E, S=S, Q=EG + EG.T + S, W=W, inputs=input_columns(claim))


def lyapunov_matrix(claim: Stability) -> Matrix:
    """Return P."""
    if claim.diagonal:
        return diagonal([row[0] for row in claim.P])
    return _symmetric(claim.P)


def gamma_matrix(claim: Stability) -> Matrix:
    """Return Gamma, of the size of the input columns."""
    if isinstance(claim.gamma, Fraction):
        return diagonal([claim.gamma] * input_columns(claim).width)
    return _symmetric(claim.gamma)


def _symmetric(lower: Lower) -> Matrix:
    size = range(len(lower))
    return matrix([[lower[max(i, j)][min(i, j)] for j in size] for i in size], len(size))


def input_columns(claim: Stability) -> Matrix:
    """Return B, with b as one more column where nothing is shifted and b is not zero."""
    model = claim.subject.model
    extra = claim.point is None and any(model.b)
    rows = [(*row, value) if extra else row for row, value in zip(model.B, model.b, strict=True)]
    return matrix(rows, model.m + extra)


def density(proof: GroupProof, members: int) -> list[Fraction]:
    """Return lambda_g = sum mu_k l_k."""
    total = [Fraction(0)] * (1 + members)
    for mu, form in zip(proof.mu, proof.forms, strict=True):
        if mu:
            total = [a + mu * b for a, b in zip(total, form, strict=True)]
    return total


def gradient_matrix(model: Model, groups: Sequence[Group], P: Matrix, densities: Sequence[list[Fraction]]) -> Matrix:
    """Return E, one row for each entry of z: P and sum N_g' lambda_g r_g'."""
    rows = _group_rows(model, groups)
    top = P + rows.T * diagonal([values[0] for values in densities]) * rows
    return blocks([[top], [_channel_rows(model, groups, densities)]])


def quadratic_form(model: Model, groups: Sequence[Group], squares: Sequence[Square]) -> Matrix:
    """Return sum_g N_g' M_g N_g for symmetric M_g over (y, f_1, ...)."""
    rows = _group_rows(model, groups)
    top = rows.T * diagonal([square[0][0] for square in squares]) * rows
    side = _channel_rows(model, groups, [square[0] for square in squares])
    size = len(model.channels)
    corner: list[list[Fraction | int]] = [[0] * size for _ in range(size)]
    for group, square in zip(groups, squares, strict=True):
        for j, (c, _) in enumerate(group.members, start=1):
            for k, (d, _) in enumerate(group.members, start=1):
                corner[c][d] = square[j][k]
    return blocks([[top, side.T], [side, matrix(corner, size)]])


def embedded(P: Matrix, model: Model) -> Matrix:
    """Return P as a quadratic form in z."""
    size = len(model.channels)
    zero = matrix([[0] * size for _ in range(model.n)], size)
    return blocks([[P, zero], [zero.T, matrix([[0] * size for _ in range(size)], size)]])


def _group_rows(model: Model, groups: Sequence[Group]) -> Matrix:
    return matrix([_dense(group.row, model.n) for group in groups], model.n)


def _channel_rows(model: Model, groups: Sequence[Group], coefficients: Sequence[list[Fraction]]) -> Matrix:
    """Return the rows coefficient_c r_g', one for each channel c of group g."""
    rows: list[list[Fraction | int]] = [[] for _ in model.channels]
    for group, values in zip(groups, coefficients, strict=True):
        for j, (c, _) in enumerate(group.members, start=1):
            rows[c] = _dense({i: values[j] * r for i, r in group.row.items()}, model.n)
    return matrix(rows, model.n)


def _dense(row: dict[int, Fraction], n: int) -> list[Fraction | int]:
    line: list[Fraction | int] = [0] * n
    for i, value in row.items():
        line[i] = value
    return line


def _pairs(proofs: Sequence[GroupProof], groups: Sequence[Group]) -> list[tuple[GroupProof, Group]]:
    return list(zip(proofs, groups, strict=True))


def _products(proof: GroupProof, members: int) -> Square:
    """S_g = sum tau (l_k l_l' + l_l l_k') = F'(T + T')F, with the forms as rows of F and T_kl = tau."""
    taus: list[list[Number]] = [[0] * len(proof.forms) for _ in proof.forms]
    for k, q, tau in proof.products:
        taus[k][q] = taus[q][k] = tau
    F = matrix(proof.forms, 1 + members)
    S = F.T * matrix(taus, len(proof.forms)) * F
    return [[S.entry(i, j) for j in range(S.width)] for i in range(S.height)]


def _upper(proof: GroupProof, members: int) -> Square:
    """W_g = sum mu_k c_k (e_0 l_k' + l_k e_0'), from 2 mu_k times the integral <= 2 mu_k c_k y l_k'phi."""
    total = [Fraction(0)] * (1 + members)
    for mu, c, form in zip(proof.mu, proof.integral, proof.forms, strict=False):
        if mu and c:
            total = [a + mu * c * b for a, b in zip(total, form, strict=True)]
    square = [[Fraction(0)] * (1 + members) for _ in total]
    for j, value in enumerate(total):
        square[0][j] += value
        square[j][0] += value
    return square
