"""Claim "infeasible": X = L L' >= 0 has a positive product with every generator, so no certificate exists.

A certificate needs Q < 0 on the entries kept, where Q = sum of generators times multipliers >= 0. Then <Q, X> <= 0; but
<F_k, X> > 0 for every generator F_k makes <Q, X> > 0 unless all multipliers vanish, and then Q = 0.
"""

from fractions import Fraction

from persid_check.definite import is_positive_definite
from persid_check.exact import Matrix, matrix
from persid_check.refutations import sentences
from persid_check.refutations.format import Forms, Obstruction
from persid_check.results import NotProvedError
from persid_check.search.prover import prove_continuous
from persid_check.subject import Group


def prove_obstruction(claim: Obstruction) -> tuple[str, tuple[str, ...]]:
    """Return the statement that is proved and the steps of its proof, or raise NotProvedError."""
    model = claim.subject.model
    for c, channel in enumerate(model.channels):
        if not prove_continuous(((channel.program, Fraction(1)),)):
            raise NotProvedError(f"channel {c}", "no proof that its function is continuous on R")
    L = matrix(claim.L, len(claim.L[0]))
    GL = model.flow * L
    _lyapunov_matrix(claim, GL, L.kept(range(model.n), range(L.width)))
    _forms(claim, GL, L)
    return sentences.infeasibility(claim), sentences.infeasibility_steps(claim)


def _lyapunov_matrix(claim: Obstruction, GL: Matrix, states: Matrix) -> None:
    """P_ii for a diagonal P: (G X)_ii > 0; all of P: (G X)_xx + its transpose > 0."""
    GX = GL * states.T
    if claim.full:
        if not is_positive_definite(GX + GX.T, claim.factor):
            raise NotProvedError("proof.P", "(G X)_xx + its transpose is not proved positive definite")
        return
    for i in range(claim.subject.model.n):
        if not GX.entries[i, i] > 0:
            raise NotProvedError("L", f"the product with the generator of P[{i}] is not positive")


def _forms(claim: Obstruction, GL: Matrix, L: Matrix) -> None:
    """mu of each form, tau of each pair of forms of a group, and of each pair (y, form)."""
    n = claim.subject.model.n
    for g, (group, forms) in enumerate(zip(claim.subject.groups, claim.forms, strict=True)):
        U = _rows(group, forms) * L.kept([*group.row, *(n + c for c, _ in group.members)], range(L.width))
        row = matrix([[group.row.get(i, Fraction(0)) for i in range(n)]], n)
        gram, flows = (U * U.T).entries, (row * GL * U.T).entries
        for k in range(1, U.height):
            where = f"groups[{g}].forms[{k - 1}]"
            if not flows[0, k] > 0:
                raise NotProvedError(where, "the product with its Lyapunov generator is not positive")
            if any(not gram[k, m] > 0 for m in range(U.height) if m != k):
                raise NotProvedError(where, "the product with the generator of a pair is not positive")


def _rows(group: Group, forms: Forms) -> Matrix:
    """Return the rows N_g'e_0 (that is y) and N_g'l_k, on the entries of z that the group reads."""
    y = (Fraction(1), *[Fraction(0)] * len(group.members))
    rows = [[*(form[0] * r for r in group.row.values()), *form[1:]] for form in (y, *forms)]
    return matrix(rows, len(group.row) + len(group.members))
