"""Equations of a model with algebraic variables: they have one solution, and a region keeps to its strips.

Section 11 of the specification (docs/ledger.md): what is asked beyond sections 2 to 7.
"""

from collections import Counter
from fractions import Fraction

from persid_check.definite import proof_of
from persid_check.exact import Matrix, diagonal, matrix
from persid_check.ledger.assembly import Assembly, equations, flow_matrix, padded, products_of
from persid_check.ledger.values import RISING, Algebraic, Fact, Ledger, Reach, Row
from persid_check.results import NotProvedError, require
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
    require(ledger.claim in CLAIMS, "claim", f"with algebraic variables it is one of {', '.join(CLAIMS)}")
    message = "with algebraic variables P is over the states, and no fact is about slopes"
    require(not ledger.has_slopes, "P", message)
    _densities(ledger)
    _changed(ledger)
    _solvable(ledger, said)


def _densities(ledger: Ledger) -> None:
    """V is a function of the states: what reads an algebraic variable has no density."""
    for p, point in enumerate(ledger.points):
        of_states = not any(mu for _, mu in point.densities) or not ledger.reads_algebraic(p)
        require(of_states, f"points[{p}].densities", "its row reads an algebraic variable, which V does not")


def _solvable(ledger: Ledger, said: Algebraic) -> None:
    """The equations have exactly one solution: a form of the difference of two is positive definite."""
    kept = set(_own(ledger))
    own, where = all(j in kept for row in said.solving for j in row), "algebraic.solvable"
    require(own, f"{where}.multipliers", "a row reads more than the equations' own variables")
    for i, fact in enumerate(said.products):
        _difference(ledger, fact, kept, f"{where}.products[{i}]")
    proof = proof_of(form_of_differences(ledger, said), said.proof)
    require(proof, where, "it is not proved that the equations have exactly one solution")


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
        require(curve.forms[k].kind in RISING, where, "nondecreasing forms are needed")
        read = {n + c for c, value in zip(point.channels, curve.forms[k].l[1:], strict=True) if value}
        require(read <= own, where, "a form reads more than the equations' own variables")


def _changed(ledger: Ledger) -> None:
    """What is said of points on domains that read algebraic variables holds of functions with chords beyond, too."""
    domains = (ledger.curves[point.curve].domain for point in ledger.points)
    bounded = [p for p, domain in enumerate(domains) if domain is not None and ledger.reads_algebraic(p)]
    times = Counter(c for point in ledger.points for c in point.channels)
    spend(times.total())
    for p in bounded:
        once = all(times[c] == 1 for c in ledger.points[p].channels)
        require(once, f"points[{p}]", "its row reads an algebraic variable: its channels stand once")
    chords = all(fact.kind in CHORDS for fact in ledger.facts if not {fact.p, fact.q}.isdisjoint(bounded))
    require(chords, "facts", "on domains that read algebraic variables they are of one form or a difference")


def bounded_sides(ledger: Ledger) -> list[tuple[Row, Fraction, Fraction]]:
    """Return the strips whose rows read algebraic variables."""
    return [side for side in ledger.sides if not ledger.is_of_states(side[0])]


def prove_bounds(ledger: Ledger, said: Algebraic, matrices: Assembly) -> None:
    """Prove that in the region every row that reads an algebraic variable stays in its strip.

    Raises:
        NotProvedError: a row may leave it.
    """
    sides = bounded_sides(ledger)
    given, wanted = len(said.bounds), len(sides)
    require(given == wanted, "algebraic.bounds", f"{given} are given; needed are {wanted}")
    for i, ((row, lo, hi), reach) in enumerate(zip(sides, said.bounds, strict=True)):
        where = f"algebraic.bounds[{i}]"
        spend(len(reach.facts) + len(row))
        for fact in reach.facts:
            curve = ledger.curves[ledger.points[fact.p].curve]
            sectors = curve.is_sector(fact.k) and curve.is_sector(fact.l)
            require(sectors, where, "both forms of a fact must be sector forms")
        proof = proof_of(form_of_reach(ledger, row, reach, matrices), reach.proof)
        require(proof, where, "(r'z)^2 <= alpha V + beta |v|^2 is not proved")
        h = min(-lo, hi)
        within = h > 0 and reach.alpha * ledger.level + reach.beta * ledger.input_bound**2 <= h * h
        require(within, where, "the row is not proved to stay on its domain, or in its strip")


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
