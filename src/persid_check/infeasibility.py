"""Claim "infeasible": X = L L' >= 0 has a positive product with every generator, so no certificate exists.

A certificate needs Q < 0 on the entries kept, where Q = sum of generators times multipliers >= 0. Then <Q, X> <= 0; but
<F_k, X> > 0 for every generator F_k makes <Q, X> > 0 unless all multipliers vanish, and then Q = 0.
"""

from fractions import Fraction

from persid_check import sentences
from persid_check.exact import Matrix, is_positive_definite, matrix
from persid_check.format import Infeasibility
from persid_check.inequality import flow_matrix
from persid_check.prover import prove_continuous
from persid_check.results import NotProvedError


def prove_infeasibility(claim: Infeasibility) -> tuple[str, tuple[str, ...]]:
    """Return the statement that is proved and the steps of its proof, or raise NotProvedError."""
    model = claim.subject.model
    for c, channel in enumerate(model.channels):
        if not prove_continuous(((channel.program, Fraction(1)),)):
            raise NotProvedError(f"channel {c}", "no proof that its function is continuous on R")
    L = matrix(claim.L, len(claim.L[0]))
    GL = flow_matrix(model) * L
    _lyapunov_matrix(claim, GL, L.kept(range(model.n), range(L.width)))
    _forms(claim, GL, L)
    return sentences.infeasibility(claim), sentences.infeasibility_steps(claim)


def _lyapunov_matrix(claim: Infeasibility, GL: Matrix, states: Matrix) -> None:
    """P_ii for a diagonal P: (G X)_ii > 0; all of P: (G X)_xx + its transpose > 0."""
    GX = GL * states.T
    if claim.full:
        if not is_positive_definite(GX + GX.T, claim.proof["P"]):
            raise NotProvedError("proof.P", "(G X)_xx + its transpose is not proved positive definite")
        return
    for i in range(claim.subject.model.n):
        if not GX.entries[i, i] > 0:
            raise NotProvedError("L", f"the product with the generator of P[{i}] is not positive")


def _forms(claim: Infeasibility, GL: Matrix, L: Matrix) -> None:
    """mu of each form, tau of each pair of forms of a group, and of each pair (y, form)."""
    rows, places = _rows(claim)
    U = matrix(rows, L.height) * L
    gram = (U * U.T).entries
    flows = (_group_rows(claim) * GL * U.T).entries
    for g, (first, size) in enumerate(places):
        for k in range(first + 1, first + 1 + size):
            where = f"groups[{g}].forms[{k - first - 1}]"
            if not flows[g, k] > 0:
                raise NotProvedError(where, "the product with its Lyapunov generator is not positive")
            for m in range(first, first + 1 + size):
                if m != k and not gram[k, m] > 0:
                    raise NotProvedError(where, "the product with the generator of a pair is not positive")


def _group_rows(claim: Infeasibility) -> Matrix:
    n = claim.subject.model.n
    rows = [[group.row.get(i, Fraction(0)) for i in range(n)] for group in claim.subject.groups]
    return matrix(rows, n)


def _rows(claim: Infeasibility) -> tuple[list[list[Fraction | int]], list[tuple[int, int]]]:
    """For each group the rows N_g'e_0 (that is y) and N_g'l_k, and where they begin."""
    n = claim.subject.model.n
    rows: list[list[Fraction | int]] = []
    places: list[tuple[int, int]] = []
    for group, proof in zip(claim.subject.groups, claim.groups, strict=True):
        size = len(group.members)
        places.append((len(rows), len(proof.forms)))
        for form in ((Fraction(1), *[Fraction(0)] * size), *proof.forms):
            row: list[Fraction | int] = [0] * len(claim.L)
            for i, r in group.row.items():
                row[i] = form[0] * r
            for j, (c, _) in enumerate(group.members, start=1):
                row[n + c] = form[j]
            rows.append(row)
    return rows, places
