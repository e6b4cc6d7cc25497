"""The one matrix M and the bounds of V, assembled exactly from the model and the multipliers of the file.

zeta = (x, s, v, w). Facts and densities are rows over eta = (y of each point, s): each costs as much as it has entries;
then eta = N zeta, with y_p = r_p'x. Sections 3 to 5 of the specification.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

from persid_check.exact import Matrix, Number, blocks, diagonal, matrix
from persid_check.ledger.values import Fact, Ledger
from persid_check.reading import Lower
from persid_check.results import NotProvedError
from persid_check.work import spend

Eta = Mapping[int, Fraction]  # a row over eta: points first, then channels
Entries = list[tuple[int, int, Fraction]]  # of a sparse matrix: row, column, value
_ZERO = Fraction(0)


@dataclass(frozen=True)
class Assembly:
    """M over zeta; Pt with V >= x'Pt x - below; V <= zeta'W zeta + above; the supply c_0 of the constant facts."""

    M: Matrix
    P: Matrix
    Pt: Matrix
    gamma: Matrix
    below: Fraction
    above: Fraction
    supply: Fraction


def assemble(ledger: Ledger) -> Assembly:
    """Return the matrices of a certificate."""
    n = ledger.model.n
    P, gamma, flow = quadratic(ledger), gamma_matrix(ledger), flow_matrix(ledger)
    size = flow.width
    rows = matrix([[point.row.get(i, _ZERO) for i in range(n)] for point in ledger.points], n)
    rise = _step_rise(P, flow, size) if ledger.model.is_discrete else _rise(_gradient(ledger, P, rows), flow, size)
    products = _lifted(ledger, _over_eta(ledger), rows)
    quadratic_terms = diagonal([ledger.kappa] * n) * P
    loss = -rise + _padded(-products, size) + _padded(-quadratic_terms, size) + _bounds(ledger, gamma, size)
    Pt = P + rows.T * _times_rows(ledger, _curvatures(ledger), len(ledger.points))
    return Assembly(loss, P, Pt, gamma, *_offsets(ledger))


def _rise(gradient: Matrix, flow: Matrix, size: int) -> Matrix:
    """Return the form V' = 2 (x, s)'gradient G zeta; `gradient` is (x, s) by x."""
    half = gradient * flow
    half = blocks([[half], [matrix([[0] * size for _ in range(size - half.height)], size)]])
    return half + half.T


def _step_rise(P: Matrix, flow: Matrix, size: int) -> Matrix:
    """Return the form V(x+) - V(x) = zeta'G'P G zeta - x'P x of a step."""
    return flow.T * P * flow + _padded(-P, size)


def quadratic(ledger: Ledger) -> Matrix:
    """Return P."""
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
    """Return G = [A0, all a_c, B, L]: x' = G zeta, in discrete time x+ = G zeta."""
    model = ledger.model
    columns = [row for deviation in ledger.deviations for row in deviation.columns]
    lines: list[list[Number]] = []
    for i in range(model.n):
        constant = [model.b[i]] if ledger.counts_b else []
        lines.append([
            *model.A0[i], *(channel.column[i] for channel in model.channels), *model.B[i], *constant,
            *(column.get(i, _ZERO) for column in columns),
        ])  # fmt: skip
    return matrix(lines, ledger.entries + ledger.inputs + len(columns))


def _gradient(ledger: Ledger, P: Matrix, rows: Matrix) -> Matrix:
    """Return half the gradient of V, P x + sum r_p lambda_p'Phi_p, as a matrix (x, s) by x."""
    first = len(ledger.points)
    heads: Entries = []
    sides: Entries = []
    for p, point in enumerate(ledger.points):
        for k, mu in point.densities:
            for place, value in _row(ledger, p, k).items():
                (heads if place == p else sides).append((place if place == p else place - first, p, mu * value))
    top = rows.T * _times_rows(ledger, heads, first)
    return blocks([[P + top], [_times_rows(ledger, sides, len(ledger.model.channels))]])


def _times_rows(ledger: Ledger, entries: Entries, height: int) -> Matrix:
    """Return H R for a sparse H of entries (i, p, value), R the rows of the points: line i is the sum of value r_p'."""
    lines: list[list[Number]] = [[_ZERO] * ledger.model.n for _ in range(height)]
    for i, p, value in entries:
        row = ledger.points[p].row
        spend(len(row))
        for k, r in row.items():
            lines[i][k] += value * r
    return matrix(lines, ledger.model.n)


def _row(ledger: Ledger, p: int, k: int) -> Eta:
    """Return form k at point p, l'Phi_p, as a row over eta."""
    point, first = ledger.points[p], len(ledger.points)
    l = ledger.curves[point.curve].forms[k].l  # noqa: E741
    spend(len(l))
    row = {p: l[0]}
    for c, value in zip(point.channels, l[1:], strict=True):
        row[first + c] = row.get(first + c, _ZERO) + value
    return {place: value for place, value in row.items() if value}


def _over_eta(ledger: Ledger) -> dict[tuple[int, int], Fraction]:
    """Return the lower entries of sum tau (p q' + q p') + kappa sum mu c (e_y l' + l e_y'), a form over eta."""
    total: dict[tuple[int, int], Fraction] = {}
    for p, q, weight in _weighted(ledger):
        spend(len(p) * len(q))
        for i, a in p.items():
            for j, b in q.items():
                place = (max(i, j), min(i, j))
                total[place] = total.get(place, _ZERO) + weight * a * b * (2 if i == j else 1)
    return total


def _weighted(ledger: Ledger) -> Iterator[tuple[Eta, Eta, Fraction]]:
    for fact in ledger.facts:
        if fact.tau:
            yield *_factors(ledger, fact), fact.tau
    for p, point in enumerate(ledger.points):
        for k, mu in point.densities if ledger.kappa else ():
            upper = ledger.curves[point.curve].forms[k].upper
            if mu and upper is None:
                raise NotProvedError(f"points[{p}].densities", "with kappa > 0 each density needs an upper bound")
            if mu and upper is not None and upper.c:
                yield {p: Fraction(1)}, _row(ledger, p, k), ledger.kappa * mu * upper.c


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


def _lifted(ledger: Ledger, eta: Mapping[tuple[int, int], Fraction], rows: Matrix) -> Matrix:
    """Return N'H N for the form H over eta: a form over (x, s)."""
    first, channels = len(ledger.points), len(ledger.model.channels)
    yy: Entries = []
    sy: Entries = []
    ss: list[list[Number]] = [[_ZERO] * channels for _ in range(channels)]
    for (i, j), value in eta.items():
        if i < first:
            yy += [(i, j, value)] if i == j else [(i, j, value), (j, i, value)]
        elif j < first:
            sy.append((i - first, j, value))
        else:
            ss[i - first][j - first] = ss[j - first][i - first] = value
    side = _times_rows(ledger, sy, channels)
    return blocks([[rows.T * _times_rows(ledger, yy, first), side.T], [side, matrix(ss, channels)]])


def _padded(part: Matrix, size: int) -> Matrix:
    """Return a leading block in a matrix of zeros."""
    width = size - part.height
    side = matrix([[0] * width for _ in range(part.height)], width)
    return blocks([[part, side], [side.T, matrix([[0] * width for _ in range(width)], width)]])


def _bounds(ledger: Ledger, gamma: Matrix, size: int) -> Matrix:
    """Return the form v'Gamma v + sum s_j (|w_j|^2 - |C_j zeta_0|^2)."""
    own = ledger.entries
    inside = own + ledger.inputs
    known: list[list[Number]] = [[_ZERO] * inside for _ in range(inside)]
    for deviation in ledger.deviations:
        for row in deviation.C:
            spend(len(row) ** 2)
            for i, a in row.items():
                for j, b in row.items():
                    known[i][j] -= deviation.s * a * b
    squares = diagonal([deviation.s for deviation in ledger.deviations for _ in deviation.columns])
    corner = blocks([[matrix([[0] * own for _ in range(own)], own), matrix([[0] * ledger.inputs] * own, ledger.inputs)],
                     [matrix([[0] * own] * ledger.inputs, own), gamma]]) + matrix(known, inside)  # fmt: skip
    width = size - inside
    return blocks([[corner, matrix([[0] * width] * inside, width)], [matrix([[0] * inside] * width, inside), squares]])


def _curvatures(ledger: Ledger) -> Entries:
    """Return mu d of each density, at its point."""
    densities = ((p, k, mu) for p, point in enumerate(ledger.points) for k, mu in point.densities)
    return [(p, p, mu * _lower(ledger, p, k)[0]) for p, k, mu in densities]


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
