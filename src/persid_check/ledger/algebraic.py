"""Equations of a model with algebraic variables: they have exactly one solution.

Section 11 of the specification (docs/ledger.md): what is asked beyond sections 2 to 7.
"""

from persid_check.definite import proof_of
from persid_check.exact import Matrix
from persid_check.ledger.assembly import equations, flow_matrix, padded, products_of
from persid_check.ledger.values import RISING, Algebraic, Fact, Ledger
from persid_check.results import NotProvedError

CLAIMS = ("iss", "rate-and-gain")


def prove_algebraic(ledger: Ledger, said: Algebraic | None) -> None:
    """Prove what the file says of equations, beside M > 0.

    Raises:
        NotProvedError: a hypothesis of section 11 is not proved.
    """
    if said is None or len(said.equations) != ledger.model.algebraic:
        raise NotProvedError("algebraic", "every equation needs a multiplier, and a proof that it can be solved")
    if ledger.claim not in CLAIMS:
        raise NotProvedError("claim", f"with algebraic variables it is one of {', '.join(CLAIMS)}")
    if ledger.has_slopes:
        raise NotProvedError("P", "with algebraic variables P is over the states, and no fact is about slopes")
    _densities(ledger)
    _solvable(ledger, said)


def _densities(ledger: Ledger) -> None:
    """V is a function of the states: what reads an algebraic variable has no density."""
    for p, point in enumerate(ledger.points):
        if ledger.reads_algebraic(p) and any(mu for _, mu in point.densities):
            raise NotProvedError(f"points[{p}].densities", "its row reads an algebraic variable, which V does not")


def _solvable(ledger: Ledger, said: Algebraic) -> None:
    """The equations have exactly one solution: a form of the difference of two is positive definite."""
    kept = set(_own(ledger))
    if any(j not in kept for row in said.solving for j in row):
        raise NotProvedError("algebraic.solvable.multipliers", "a row reads more than the equations' own variables")
    for i, fact in enumerate(said.products):
        _difference(ledger, fact, kept, f"algebraic.solvable.products[{i}]")
    if proof_of(form_of_differences(ledger, said), said.proof) is None:
        raise NotProvedError("algebraic.solvable", "it is not proved that the equations have exactly one solution")


def form_of_differences(ledger: Ledger, said: Algebraic) -> Matrix:
    """Return 2 sum (n_i'd)(H_i d) less products, over the equations' own variables."""
    flow, kept = flow_matrix(ledger), _own(ledger)
    whole = equations(ledger, flow, said.solving) + padded(-products_of(ledger, said.products), flow.width)
    return whole.kept(kept, kept)


def _own(ledger: Ledger) -> list[int]:
    """Return the algebraic variables, and the channels that read one and stand in an equation."""
    order, n = ledger.model.order, ledger.model.n
    channels = enumerate(ledger.model.channels)
    acting = [n + c for c, each in channels if any(i >= order for i in each.row) and any(each.column[order:])]
    return [*range(order, n), *acting]


def _difference(ledger: Ledger, fact: Fact, own: set[int], where: str) -> None:
    point, n = ledger.points[fact.p], ledger.model.n
    curve = ledger.curves[point.curve]
    for k in (fact.k, fact.l):
        if curve.forms[k].kind not in RISING:
            raise NotProvedError(where, "nondecreasing forms are needed")
        read = {n + c for c, value in zip(point.channels, curve.forms[k].l[1:], strict=True) if value}
        if not read <= own:
            raise NotProvedError(where, "a form reads more than the equations' own variables")
