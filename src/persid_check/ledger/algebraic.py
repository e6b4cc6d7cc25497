"""Equations of a model with algebraic variables: they have one solution, and a region keeps to its strips.

Section 11 of the specification (docs/ledger.md): what is asked beyond sections 2 to 7.
"""

from collections import Counter
from fractions import Fraction

from persid_check.definite import proof_of
from persid_check.exact import Matrix, diagonal, matrix
from persid_check.ledger.assembly import Assembly, equations, flow_matrix, padded, products_of
from persid_check.ledger.values import RISING, Algebraic, Fact, Ledger, Reach, Row
from persid_check.results import NotProvedError
from persid_check.work import spend

CLAIMS = ("iss", "rate-and-gain", "region")
CHORDS = ("value", "difference")  # kinds of facts that hold of functions that go on along chords
_ZERO = Fraction(0)


def prove_algebraic(ledger: Ledger, said: Algebraic | None) -> None:
    """Prove what the file says of equations, beside M > 0 and where a region keeps to its strips.

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
    _changed(ledger)
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
    spend(2 * (1 + len(point.channels)))
    for k in (fact.k, fact.l):
        if curve.forms[k].kind not in RISING:
            raise NotProvedError(where, "nondecreasing forms are needed")
        read = {n + c for c, value in zip(point.channels, curve.forms[k].l[1:], strict=True) if value}
        if not read <= own:
            raise NotProvedError(where, "a form reads more than the equations' own variables")


def _changed(ledger: Ledger) -> None:
    """What is said of points on domains that read algebraic variables holds of functions with chords beyond, too."""
    domains = (ledger.curves[point.curve].domain for point in ledger.points)
    bounded = [p for p, domain in enumerate(domains) if domain is not None and ledger.reads_algebraic(p)]
    times = Counter(c for point in ledger.points for c in point.channels)
    spend(times.total())
    for p in bounded:
        if any(times[c] > 1 for c in ledger.points[p].channels):
            raise NotProvedError(f"points[{p}]", "its row reads an algebraic variable: its channels stand once")
    if any(fact.kind not in CHORDS for fact in ledger.facts if not {fact.p, fact.q}.isdisjoint(bounded)):
        raise NotProvedError("facts", "on domains that read algebraic variables they are of one form or a difference")


def bounded_sides(ledger: Ledger) -> list[tuple[Row, Fraction, Fraction]]:
    """Return the strips whose rows read algebraic variables."""
    return [side for side in ledger.sides if not ledger.is_of_states(side[0])]


def prove_bounds(ledger: Ledger, said: Algebraic, matrices: Assembly) -> None:
    """Prove that in the region every row that reads an algebraic variable stays in its strip.

    Raises:
        NotProvedError: a row may leave it.
    """
    sides = bounded_sides(ledger)
    if len(said.bounds) != len(sides):
        raise NotProvedError("algebraic.bounds", f"{len(said.bounds)} are given; needed are {len(sides)}")
    for i, ((row, lo, hi), reach) in enumerate(zip(sides, said.bounds, strict=True)):
        where = f"algebraic.bounds[{i}]"
        spend(len(reach.facts) + len(row))
        for fact in reach.facts:
            if not all(ledger.curves[ledger.points[fact.p].curve].is_sector(k) for k in (fact.k, fact.l)):
                raise NotProvedError(where, "both forms of a fact must be sector forms")
        if proof_of(form_of_reach(ledger, row, reach, matrices), reach.proof) is None:
            raise NotProvedError(where, "(r'z)^2 <= alpha V + beta |v|^2 is not proved")
        h = min(-lo, hi)
        if h <= 0 or reach.alpha * ledger.level + reach.beta * ledger.input_bound**2 > h * h:
            raise NotProvedError(where, "the row is not proved to stay on its domain, or in its strip")


def form_of_reach(ledger: Ledger, row: Row, reach: Reach, matrices: Assembly) -> Matrix:
    """Return the form alpha x'Pt x + beta |v|^2 - (r'z)^2 less equations and facts, where its rows are not zero."""
    flow = matrices.flow
    spend(flow.width**2)
    r = matrix([[row.get(j, _ZERO) for j in range(flow.width)]], flow.width)
    scaled = diagonal([reach.alpha] * ledger.model.order) * matrices.Pt
    supply = diagonal([_ZERO] * ledger.entries + [reach.beta] * ledger.inputs)
    known = equations(ledger, flow, reach.equations) + padded(products_of(ledger, reach.facts), flow.width)
    form = padded(scaled, flow.width) + supply + -(r.T * r) + -known
    kept = [i for i, row in enumerate(form.flint.table()) if any(value != 0 for value in row)]
    return form.kept(kept, kept)
