"""The one matrix M and the bounds of V, assembled exactly from the model and the multipliers of the file.

zeta = (x, s, v, w, sigma), with algebraic variables (z, s, v). Facts and densities are rows over eta = (y of each
point, s): each costs as much as it has entries; then eta = N zeta, with y_p = r_p'x. Facts about slopes are such rows
over eta', the derivative of eta along the solution, with y_p' = r_p'G zeta. Sections 3 to 5 of the specification.
In discrete time sigma is what the values add in a step, and facts about it are rows over y and s now and afterwards.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from persid_check.entry import Lower
from persid_check.exact import Matrix, beside, blocks, diagonal, matrix, mirrored, placed, scattered, zeros
from persid_check.ledger.identities import form_of_identity
from persid_check.ledger.values import Fact, Ledger, Row
from persid_check.results import NotProvedError
from persid_check.work import spend, spend_products

Eta = Mapping[int, Fraction]  # a row over eta: points first, then channels
Entries = list[tuple[int, int, Fraction]]  # of a sparse matrix: row, column, value
Weighted = tuple[Eta, Eta, Fraction]  # two factors and the multiplier of their product
ENTRIES_OF_A_STEP = 16  # of a matrix of zeros that rows of points are written into
_ZERO, _ONE = Fraction(0), Fraction(1)


@dataclass(frozen=True)
class Assembly:
    """M over zeta; Pt with V >= z'Pt z - below; V <= zeta'W zeta + above; the supply c_0 of the constant facts.

    `flow` is G, with the rows H of equations below it.
    """

    flow: Matrix
    M: Matrix
    P: Matrix
    Pt: Matrix
    gamma: Matrix
    below: Fraction
    above: Fraction
    supply: Fraction


def assemble(ledger: Ledger) -> Assembly:
    """Return the matrices of a certificate."""
    P, gamma, flow = quadratic(ledger), gamma_matrix(ledger), flow_matrix(ledger)
    size, channels = flow.width + len(ledger.inside), len(ledger.model.channels)
    rows, n, order = [point.row for point in ledger.points], ledger.model.n, ledger.model.order
    z = [*range(order), *(n + c for c in ledger.inside)]  # where the entries of z stand in (x, s)
    discrete = ledger.model.is_discrete
    rise = _step_rise(ledger, P, flow, z) if discrete else _rise(_gradient(ledger, P, rows, z), ledger, flow)
    products = _lifted(_over_eta(_weighted(ledger)), rows, n, channels)
    share = _within(-diagonal([ledger.kappa] * P.height) * P, z, size)
    loss = -rise + padded(-products, size) + share + _bounds(ledger, gamma, size)
    if ledger.algebraic is not None:
        loss = loss + -equations(ledger, flow, ledger.algebraic.equations)
    if discrete and (steps := _over_eta(_weighted_steps(ledger))):
        loss = loss + -_lifted(steps, _moments(ledger, flow), size, 0)
    if slopes := _over_eta(_weighted_slopes(ledger)):
        loss = loss + -_lifted(slopes, _rows_along(ledger, flow), flow.width, len(ledger.inside))
    if ledger.identity:
        loss = loss + -form_of_identity(ledger, size)
    below = _lifted(_over_eta(_curvatures(ledger)), rows, n, len(ledger.inside))
    Pt = P + (below.kept(range(order), range(order)) if order < n else below)
    return Assembly(flow, loss, P, Pt, gamma, *_offsets(ledger))


def products_of(ledger: Ledger, facts: Sequence[Fact]) -> Matrix:
    """Return the form 2 sum tau (l_k'Phi)(l_l'Phi) of some facts, over (z, s)."""
    weighted = ((*_factors(ledger, fact), fact.tau) for fact in facts if fact.tau)
    rows = [point.row for point in ledger.points]
    return _lifted(_over_eta(weighted), rows, ledger.model.n, len(ledger.model.channels))


def equations(ledger: Ledger, flow: Matrix, multipliers: Sequence[Row]) -> Matrix:
    """Return the form 2 sum (n_i'zeta)(H_i zeta), which is zero where the equations H zeta = 0 hold (section 11)."""
    order, n = ledger.model.order, ledger.model.n
    half = _dense(multipliers, flow.width).T * flow.kept(range(order, n), range(flow.width))
    return half + half.T


def _rise(gradient: Matrix, ledger: Ledger, flow: Matrix) -> Matrix:
    """Return the form V' = 2 (x, s)'gradient (G zeta, sigma); `gradient` is (x, s) by z."""
    order, k = ledger.model.order, len(ledger.inside)
    flow = flow if order == ledger.model.n else flow.kept(range(order), range(flow.width))
    size = flow.width + k
    half = gradient * beside(flow, diagonal([1] * k))
    half = blocks([[half], [zeros(size - half.height, size)]])
    return half + half.T


def _step_rise(ledger: Ledger, P: Matrix, flow: Matrix, z: Sequence[int]) -> Matrix:
    """Return the form z+'P z+ - z'P z of a step, z+ = (G zeta, s + sigma)."""
    k, size = len(ledger.inside), flow.width + len(ledger.inside)
    later = _dense([{n: _ONE, flow.width + i: _ONE} for i, n in enumerate(z[ledger.model.n :])], size)
    after = blocks([[flow, zeros(flow.height, k)], [later]]) if k else flow
    return after.T * P * after + _within(-P, z, size)


def _within(part: Matrix, z: Sequence[int], size: int) -> Matrix:
    """Return a symmetric form of z as one of zeta, which has so many entries."""
    return placed(placed(part, z, size).T, z, size)


def quadratic(ledger: Ledger) -> Matrix:
    """Return P, of the size of z."""
    return diagonal([row[0] for row in ledger.P]) if ledger.diagonal else symmetric(ledger.P)


def gamma_matrix(ledger: Ledger) -> Matrix:
    """Return Gamma, of the size of v."""
    gamma = ledger.gamma
    return diagonal([gamma] * ledger.inputs) if isinstance(gamma, Fraction) else symmetric(gamma)


def symmetric(lower: Lower) -> Matrix:
    """Return the symmetric matrix of lower rows."""
    size = range(len(lower))
    return matrix([[lower[max(i, j)][min(i, j)] for j in size] for i in size], len(size))


def flow_matrix(ledger: Ledger) -> Matrix:
    """Return G = [A0, all a_c, B, L]: x' = G zeta, in discrete time x+ = G zeta; its last rows may be equations."""
    model = ledger.model
    columns = [row for deviation in ledger.deviations for row in deviation.columns]
    known = [(*row, b) if ledger.counts_b else row for row, b in zip(model.B, model.b, strict=True)]
    unknown = [[column.get(i, _ZERO) for column in columns] for i in range(model.n)]
    return blocks([[model.flow, matrix(known, ledger.inputs), matrix(unknown, len(columns))]])


def _gradient(ledger: Ledger, P: Matrix, rows: Sequence[Row], z: Sequence[int]) -> Matrix:
    """Return half the gradient of V by z, P z and sum r_p lambda_p'Phi_p for x, as a matrix (x, s) by z."""
    first = len(ledger.points)
    heads: Entries = []
    sides: Entries = []
    for p, point in enumerate(ledger.points):
        for k, mu in point.densities:
            for place, value in _row(ledger, p, k).items():
                (heads if place == p else sides).append((place if place == p else place - first, p, mu * value))
    n = ledger.model.n
    top = _dense(rows, n).T * _times_rows(rows, n, heads, first)
    own = blocks([[top], [_times_rows(rows, n, sides, len(ledger.model.channels))]])
    own = own if ledger.model.order == n else own.kept(range(own.height), range(ledger.model.order))
    return placed(P, z, own.height) + blocks([[own, zeros(own.height, len(ledger.inside))]])


def _dense(rows: Sequence[Row], width: int) -> Matrix:
    return scattered(len(rows), width, [(p, i, value) for p, row in enumerate(rows) for i, value in row.items()])


def _times_rows(rows: Sequence[Row], width: int, entries: Entries, height: int) -> Matrix:
    """Return H R for a sparse H of entries (i, p, value), R the rows of points: line i is the sum of value r_p'."""
    total: dict[tuple[int, int], Fraction] = {}
    for i, p, value in entries:
        spend_products(len(rows[p]), rows[p].values(), (value,))
        for k, r in rows[p].items():
            total[i, k] = total.get((i, k), _ZERO) + value * r
    return scattered(height, width, [(*place, value) for place, value in total.items()])


def _rows_along(ledger: Ledger, flow: Matrix) -> list[Row]:
    """Return the rows of y_p' = r_p'G zeta, of the points of facts about slopes; in discrete time of every y_p+."""
    sloped = {fact.p for fact in ledger.facts if fact.kind == "slope"}
    used = range(len(ledger.points)) if ledger.model.is_discrete else sorted(sloped)
    lines = _dense([ledger.points[p].row for p in used], ledger.model.n) * flow
    rows: list[Row] = [{}] * len(ledger.points)
    for i, p in enumerate(used):
        spend(flow.width)
        rows[p] = {j: value for j in range(flow.width) if (value := lines.entry(i, j))}
    return rows


def _row(ledger: Ledger, p: int, k: int) -> Eta:
    """Return form k at point p, l'Phi_p, as a row over eta."""
    point, first = ledger.points[p], len(ledger.points)
    l = ledger.curves[point.curve].forms[k].l  # noqa: E741
    spend(len(l))
    row = {p: l[0]}
    for c, value in zip(point.channels, l[1:], strict=True):
        row[first + c] = row.get(first + c, _ZERO) + value
    return {place: value for place, value in row.items() if value}


def _over_eta(weighted: Iterable[Weighted]) -> dict[tuple[int, int], Fraction]:
    """Return the lower entries of the sum of weight (p q' + q p'), a form over eta."""
    total: dict[tuple[int, int], Fraction] = {}
    for p, q, weight in weighted:
        spend_products(len(p) * len(q), p.values(), q.values(), (weight,))
        for i, a in p.items():
            scaled = weight * a
            for j, b in q.items():
                place = (max(i, j), min(i, j))
                total[place] = total.get(place, _ZERO) + scaled * b
    return {(i, j): 2 * value if i == j else value for (i, j), value in total.items()}


def _weighted(ledger: Ledger) -> Iterator[Weighted]:
    """The factors of facts with tau, and of kappa sum mu c (e_y l' + l e_y')."""
    for fact in ledger.facts:
        if fact.tau and fact.kind not in ("slope", "step"):
            yield *_factors(ledger, fact), fact.tau
    for p, point in enumerate(ledger.points):
        for k, mu in point.densities if ledger.kappa else ():
            upper = ledger.curves[point.curve].forms[k].upper
            if mu and upper is None:
                raise NotProvedError(f"points[{p}].densities", "with kappa > 0 each density needs an upper bound")
            if mu and upper is not None and upper.c:
                yield {p: Fraction(1)}, _row(ledger, p, k), ledger.kappa * mu * upper.c


def _weighted_slopes(ledger: Ledger) -> Iterator[Weighted]:
    """The factors of facts about slopes, over eta': the points, then the values that V reads."""
    for fact in ledger.facts:
        if fact.tau and fact.kind == "slope":
            yield _row_inside(ledger, fact.p, fact.k), _row_inside(ledger, fact.p, fact.l), fact.tau


def _weighted_steps(ledger: Ledger) -> Iterator[Weighted]:
    """The factors of facts about a step, and of what integrals rise in it: g(y+) (y+ - y) less d/2 (g(y+) - g(y))^2."""
    for fact in ledger.facts:
        if fact.tau and fact.kind == "step":
            first, second = (_after(ledger, fact.p, k, fact.q, fact.sign) for k in (fact.k, fact.l))
            yield first, second, fact.tau
    later = len(ledger.points) + len(ledger.inside)
    for p, point in enumerate(ledger.points):
        for k, mu in point.densities:
            if mu:
                yield _after(ledger, p, k, p, 0), {later + p: _ONE, p: -_ONE}, mu
            if mu and ledger.curves[point.curve].squares[k]:
                gap = _after(ledger, p, k, p, -1)
                yield gap, gap, -mu * _lower(ledger, p, k)[0] / 2


def _after(ledger: Ledger, p: int, k: int, q: int, sign: int) -> Eta:
    """Return form k at point p after a step plus `sign` times form k at q now, over y and s now, then afterwards."""
    later = len(ledger.points) + len(ledger.inside)
    now = _row_inside(ledger, q, k) if sign else {}
    return {later + i: v for i, v in _row_inside(ledger, p, k).items()} | {i: sign * v for i, v in now.items()}


def _moments(ledger: Ledger, flow: Matrix) -> list[Row]:
    """Return the rows over zeta of every y and of the values that P reads, now, then after a step."""
    n, W = ledger.model.n, flow.width
    now = [*(point.row for point in ledger.points), *({n + c: _ONE} for c in ledger.inside)]
    values = [{n + c: _ONE, W + i: _ONE} for i, c in enumerate(ledger.inside)]
    return [*now, *_rows_along(ledger, flow), *values]


def _row_inside(ledger: Ledger, p: int, k: int) -> Eta:
    """Return form k at point p, which has to read values inside P alone, as a row over the points and these values."""
    first, row = len(ledger.points), _row(ledger, p, k)
    if any(at >= first and at - first not in ledger.inside_at for at in row):
        raise NotProvedError(f"points[{p}]", f"form {k} reads a channel whose value P does not read")
    return {at if at < first else first + ledger.inside_at[at - first]: value for at, value in row.items()}


def _factors(ledger: Ledger, fact: Fact) -> tuple[Eta, Eta]:
    if fact.kind == "constant":
        product = ledger.curves[ledger.points[fact.p].curve].products[fact.k]
        return _row(ledger, fact.p, product.k), _row(ledger, fact.p, product.q)
    if fact.kind != "difference":
        return _row(ledger, fact.p, fact.k), _row(ledger, fact.q, fact.l)
    return _difference(ledger, fact, fact.k), _difference(ledger, fact, fact.l)


def _difference(ledger: Ledger, fact: Fact, k: int) -> Eta:
    total = dict(_row(ledger, fact.p, k))
    for place, value in _row(ledger, fact.q, k).items():
        total[place] = total.get(place, _ZERO) + fact.sign * value
    return total


def _lifted(eta: Mapping[tuple[int, int], Fraction], rows: Sequence[Row], width: int, channels: int) -> Matrix:
    """Return N'H N for the form H over eta, with the rows of the points: a form over (x, s)."""
    first = len(rows)
    used = sorted({i for place in eta for i in place if i < first})
    spend(len(eta) + len(used) * width // ENTRIES_OF_A_STEP)
    at, rows = {p: k for k, p in enumerate(used)}, [rows[p] for p in used]
    entries = mirrored(eta)
    yy = [(at[i], at[j], value) for i, j, value in entries if i < first and j < first]
    sy = [(i - first, at[j], value) for i, j, value in entries if j < first <= i]
    ss = [(i - first, j - first, value) for i, j, value in entries if first <= i and first <= j]
    side = _times_rows(rows, width, sy, channels)
    head = _dense(rows, width).T * _times_rows(rows, width, yy, len(rows))
    return blocks([[head, side.T], [side, scattered(channels, channels, ss)]])


def padded(part: Matrix, size: int) -> Matrix:
    """Return a leading block in a matrix of zeros."""
    return beside(part, zeros(size - part.height, size - part.height))


def _bounds(ledger: Ledger, gamma: Matrix, size: int) -> Matrix:
    """Return the form v'Gamma v + sum s_j (|w_j|^2 - |C_j zeta_0|^2)."""
    own, inside = ledger.entries, ledger.entries + ledger.inputs
    known = _over_eta((row, row, -deviation.s / 2) for deviation in ledger.deviations for row in deviation.C)
    squares = diagonal([deviation.s for deviation in ledger.deviations for _ in deviation.columns])
    corner = beside(zeros(own, own), gamma) + scattered(inside, inside, mirrored(known))
    return padded(beside(corner, squares), size)


def _curvatures(ledger: Ledger) -> Iterator[Weighted]:
    """Return the factors of mu d y^2, or mu d (l'Phi)^2, of each density."""
    for p, point in enumerate(ledger.points):
        curve = ledger.curves[point.curve]
        for k, mu in point.densities:
            row = _row_inside(ledger, p, k) if curve.squares[k] else {p: Fraction(1)}
            yield row, row, mu * _lower(ledger, p, k)[0] / 2


def _lower(ledger: Ledger, p: int, k: int) -> tuple[Fraction, Fraction]:
    """Return d and o: the integral of form k at point p is at least d y^2 / 2 - o."""
    forms = ledger.curves[ledger.points[p].curve].forms
    form = forms[k]
    return (_ZERO, form.offset) if form.lower is None else (form.lower[0], forms[form.lower[1]].offset)


def _offsets(ledger: Ledger) -> tuple[Fraction, Fraction, Fraction]:
    """Return o_V, e_V and c_0."""
    below = above = supply = _ZERO
    for p, point in enumerate(ledger.points):
        for k, mu in point.densities:
            upper = ledger.curves[point.curve].forms[k].upper
            below += 2 * mu * _lower(ledger, p, k)[1]
            above += 2 * mu * (upper.e if upper is not None else _ZERO)
    for fact in ledger.facts:
        if fact.kind == "constant":
            supply += 2 * fact.tau * ledger.curves[ledger.points[fact.p].curve].products[fact.k].c
    return below, above, supply
