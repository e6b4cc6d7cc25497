"""The coefficients of a large network by node, and claim L1's inequality in binary64 with a proved error bound."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from persid_check.expression import is_linear, parse
from persid_check.networks.nodes import MAX_FUNCTIONS, Column, Functions, Nodes
from persid_check.results import NotProvedError
from persid_check.sparse import Columns, SparseModel, SparseTerm

if TYPE_CHECKING:
    from numpy import ndarray

MAX_TABLE = 2**28  # coefficients, zeros included
Placed = tuple[Columns | None, "ndarray", "ndarray"]  # a matrix, the nodes of its columns, and their slots

BLOCK = 2**16  # entries that are summed at a time
LARGE = 2.0**300  # numbers beyond, or below its inverse, could overflow or underflow in a product: not summed here
SMALL_RAY = 2.0**-200
UNIT = 2.0**-51  # more than twice the roundings of N operations, N 2^-53 / (1 - N 2^-53), for every N met here


@dataclass(frozen=True, eq=False)
class Table:
    """Nodes in arrays: off the diagonal x_i' gets values[s, p] phi_s of node k at (row, node)[p] = (i, k), sorted by k.

    `values` is slots x entries and `diagonal` slots x nodes; a node's slots beyond its own are zero.
    """

    n: int
    kinds: tuple[Functions, ...]
    kind: "ndarray"
    row: "ndarray"
    node: "ndarray"
    values: "ndarray"
    diagonal: "ndarray"

    @property
    def entries(self) -> int:
        """How many pairs (row, node) are coupled, the diagonal included."""
        return len(self.row) + int((self.diagonal != 0).any(axis=0).sum())

    def column(self, k: int) -> Column:
        """Return the coefficients of one node, exactly."""
        import numpy as np

        slots = 1 + len(self.kinds[int(self.kind[k])])
        start, stop = np.searchsorted(self.node, [k, k + 1])
        found = {int(self.row[p]): _fractions(self.values[:slots, p]) for p in range(start, stop)}
        return {**found, k: _fractions(self.diagonal[:slots, k])}


def _fractions(values: "ndarray") -> tuple[Fraction, ...]:
    return tuple(Fraction(float(value)) for value in values)


def table_of(nodes: Nodes) -> Table:
    """Return the nodes in arrays.

    Raises:
        NotProvedError: a coefficient is no binary64, as a merged linear term may leave it.
    """
    import numpy as np

    found = np.zeros((1 + max(len(kind) for kind in nodes.kinds), nodes.n, nodes.n))
    for k, slots in enumerate(nodes.slots):
        for s, values in enumerate(slots):
            found[s, k] = _floats(values)
    every = np.arange(nodes.n)
    node, row = np.nonzero(found.any(axis=0) & (every[:, None] != every))
    return Table(
        n=nodes.n, kinds=nodes.kinds, kind=np.array(nodes.kind), row=row, node=node, values=found[:, node, row],
        diagonal=found[:, every, every],
    )  # fmt: skip


def _floats(values: Sequence[Fraction | float]) -> list[float]:
    found = list(map(float, values))
    if any(number.as_integer_ratio() != value.as_integer_ratio() for number, value in zip(found, values, strict=True)):
        raise NotProvedError("model.A0", "with its linear terms merged an entry is no binary64")
    return found


@dataclass(frozen=True, eq=False)
class _Channels:
    """The channels of one term with a nonzero column: node, code of (text, alpha), column of A."""

    node: "ndarray"
    code: "ndarray"
    column: "ndarray"


def table_of_sparse(model: SparseModel) -> Table:
    """Return the coefficients of a model in sparse matrices by node.

    Raises:
        NotProvedError: an argument row is not a positive multiple of a unit vector, a linear term is not in A0, or a
            node has too many functions.
    """
    import numpy as np

    pairs: dict[tuple[str, float], int] = {}
    parts = [_channels(t, term, model.n, pairs) for t, term in enumerate(model.terms)]
    slots, kind, kinds = _slots(parts, model.n, list(pairs))
    width = 1 + max(len(functions) for functions in kinds)
    matrices: list[Placed] = [(model.A0, np.arange(model.n), np.zeros(model.n, np.int8))]
    for term, part, slot in zip(model.terms, parts, slots, strict=True):
        if term.A is not None:
            matrices.append((_chosen(term.A, part.column), part.node, slot))
    return _table(model.n, width, kinds, kind, matrices)


def _channels(t: int, term: SparseTerm, n: int, pairs: dict[tuple[str, float], int]) -> _Channels:
    """Return the active channels of a term, by node; `pairs` numbers the (text, alpha) met."""
    import numpy as np

    where = f"model.terms[{t}]"
    if any(is_linear(parse(text)) for text in dict.fromkeys(term.texts)):
        raise NotProvedError(where, "a linear term of a sparse model must be merged into A0")
    if term.R is None:
        column = node = np.arange(n)
        alpha = np.ones(n)
    else:
        column, alpha = term.R.rows, term.R.values
        node = np.repeat(np.arange(n), np.diff(term.R.starts))
        if len(column) != term.size or (np.bincount(column, minlength=term.size) != 1).any() or (alpha < 0).any():
            raise NotProvedError(f"{where}.R", "a row is no positive multiple of a unit vector")
    active = np.zeros(len(column), bool) if term.A is None else np.diff(term.A.starts)[column] > 0
    node, column, alpha = node[active], column[active], alpha[active]
    factors, place = np.unique(alpha, return_inverse=True)
    numbers = {text: i for i, text in enumerate(dict.fromkeys(term.texts))}
    text = np.zeros(len(node), np.int64)
    if len(term.texts) > 1:
        text = np.array([numbers[f] for f in term.texts])[column]
    joint, inverse = np.unique(text * len(factors) + place, return_inverse=True)
    texts = list(numbers)
    names = [(texts[j // len(factors)], float(factors[j % len(factors)])) for j in joint.tolist()]
    codes = np.array([pairs.setdefault(name, len(pairs)) for name in names], np.int64)
    return _Channels(node, codes[inverse] if len(node) else np.zeros(0, np.int64), column)


def _slots(
    parts: Sequence[_Channels], n: int, names: list[tuple[str, float]]
) -> tuple[list["ndarray"], "ndarray", tuple[Functions, ...]]:
    """Number the channels of each node from 1, in order; find the different lists of functions and who has which."""
    import numpy as np

    counts, slots = np.zeros(n, np.int64), []
    key, codes = np.zeros(n, np.int64), []
    for part in parts:
        first = np.searchsorted(part.node, part.node)  # a term may have several rows on one node
        slots.append((counts[part.node] + 1 + np.arange(len(part.node)) - first).astype(np.int8))
        for step in range(int(slots[-1].max(initial=0))):
            now = slots[-1] == step + 1
            codes.append((part.node[now], part.code[now]))
        counts += np.bincount(part.node, minlength=n)
        if counts.max(initial=0) > MAX_FUNCTIONS:
            raise NotProvedError("model", f"a node has more than {MAX_FUNCTIONS} functions")
    for node, code in codes:
        here = np.zeros(n, np.int64)
        here[node] = code + 1
        key = np.unique(key * (len(names) + 1) + here, return_inverse=True)[1]
    _, first, kind = np.unique(key, return_index=True, return_inverse=True)
    lists: list[list[tuple[str, Fraction]]] = [[] for _ in first]
    for node, code in codes:
        here = np.full(n, -1)
        here[node] = code
        for t, c in enumerate(here[first]):
            if c >= 0:
                lists[t].append((names[c][0], Fraction(names[c][1])))
    return slots, kind, tuple(tuple(found) for found in lists)


def _chosen(A: Columns, columns: "ndarray") -> Columns:
    """Return some columns of a matrix in another order; as it is, if they are all its entries in order."""
    import numpy as np

    sizes = np.diff(A.starts)[columns]
    if len(columns) == A.shape[1] and (np.diff(columns) > 0).all():
        return A
    starts = np.concatenate([[0], np.cumsum(sizes)])
    place = np.arange(starts[-1]) - np.repeat(starts[:-1], sizes) + np.repeat(A.starts[columns], sizes)
    return Columns((A.shape[0], len(columns)), starts, A.rows[place], A.values[place])


def _table(n: int, width: int, kinds: tuple[Functions, ...], kind: "ndarray", matrices: Sequence[Placed]) -> Table:
    """Lay the matrices over each other: one entry for each (row, node) off the diagonal where any has one."""
    import numpy as np

    diagonal, keys, found = np.zeros((width, n)), [], []
    for matrix, node, slot in matrices:
        if matrix is None:
            continue
        sizes = np.diff(matrix.starts)
        k, s = np.repeat(node, sizes), np.repeat(slot, sizes)
        on = matrix.rows == k
        diagonal[s[on], k[on]] = matrix.values[on]
        off = ~on
        keys.append(k[off] * n + matrix.rows[off])
        found.append((s[off], matrix.values[off]))
    joined = np.sort(np.concatenate([*keys, np.full(1, -1)]), kind="stable")  # runs that are sorted are merged
    places = joined[1:][joined[1:] != joined[:-1]]
    if width * len(places) > MAX_TABLE:
        raise NotProvedError("model", f"more than {MAX_TABLE} coefficients")
    values = np.zeros((width, len(places)))
    for key, (s, numbers) in zip(keys, found, strict=True):
        values[s, np.searchsorted(places, key)] = numbers
    node = places // n
    return Table(n=n, kinds=kinds, kind=kind, row=places - node * n, node=node, values=values, diagonal=diagonal)


def doubtful(table: Table, rays: Sequence[Sequence[Sequence[int]]], w: "ndarray", kappa: Fraction) -> "ndarray":
    """Return the nodes for which the binary64 sums do not prove the inequality; an empty array proves it for all.

    Every term w_i v_s A_s[i, k] of a column's sum passes N <= slots + entries + 8 operations, each with a relative
    error of at most 2^-53 (additions in any order; the ray is rounded once; no underflow or overflow for numbers within
    2^+-300). So the sum is off by at most N 2^-53 / (1 - N 2^-53) of the sum of absolute values, and N 2^-51 of the sum
    of absolute values as it is computed is more than that.
    """
    import numpy as np

    if not (w.min() >= 1 / LARGE and w.max() <= LARGE and 1 / LARGE <= kappa <= LARGE):
        raise NotProvedError("weights", "kappa and the weights must lie between 2^-300 and 2^300")
    rate = np.nextafter(float(kappa), np.inf)
    padded, rayless = _padded(rays, len(table.values))
    found = [np.flatnonzero(rayless[table.kind])] if rayless.any() else []
    for nodes, entries in _blocks(table):
        found.append(nodes.start + np.flatnonzero(_unproved(table, padded, w, rate, nodes, entries)))
    return np.unique(np.concatenate([*found, np.zeros(0, np.int64)]))


def _padded(rays: Sequence[Sequence[Sequence[int]]], width: int) -> tuple["ndarray", "ndarray"]:
    """Return rays x kinds x slots with largest entry 1, and which kinds have an entry too small to be summed."""
    import numpy as np

    count = max(len(found) for found in rays)
    padded, small = np.zeros((count, len(rays), width)), np.zeros(len(rays), bool)
    for t, found in enumerate(rays):
        for r, ray in enumerate(found):
            top = max(abs(c) for c in ray) or 1
            row = [float(Fraction(c, top)) for c in ray]
            padded[r, t, : len(row)] = row
            small[t] |= any(c and abs(f) < SMALL_RAY for c, f in zip(ray, row, strict=True))
        padded[len(found) :, t] = padded[0, t]  # a kind with fewer rays has the first one again
    return padded, small


def _blocks(table: Table) -> Iterator[tuple[slice, slice]]:
    """Cut the nodes so that each part has about BLOCK entries: (nodes, entries)."""
    import numpy as np

    start = 0
    while start < table.n:
        first = int(np.searchsorted(table.node, start))
        last = min(first + BLOCK, len(table.node))
        stop = table.n if last == len(table.node) else max(int(table.node[last]), start + 1)
        stop = min(stop, start + BLOCK)
        yield slice(start, stop), slice(first, int(np.searchsorted(table.node, stop)))
        start = stop


def _unproved(table: Table, rays: "ndarray", w: "ndarray", kappa: float, nodes: slice, entries: slice) -> "ndarray":
    """Return for each node of a block whether some generator's sum plus its error bound is positive."""
    import numpy as np

    values, diagonal = table.values[:, entries], table.diagonal[:, nodes]
    local, width = table.node[entries] - nodes.start, nodes.stop - nodes.start
    w_row, w_node = w[table.row[entries]], w[nodes]
    kind = table.kind[nodes]
    single = kind[0] if (kind == kind[0]).all() else None
    off = [s for s in range(len(values)) if values[s].any()]

    def coefficient(ray: "ndarray", s: int, where: "ndarray | None") -> "ndarray | float":
        if single is not None:
            return float(ray[single, s])
        return np.asarray(ray[kind if where is None else kind[where], s])

    def column_sums(ray: "ndarray", size: bool) -> "ndarray":
        T, D = np.zeros(len(local)), np.zeros(width)
        for s in off:
            T += coefficient(ray, s, local) * (np.abs(values[s]) if size else values[s])
        for s in range(len(diagonal)):
            D += coefficient(ray, s, None) * (np.abs(diagonal[s]) if size else diagonal[s])
        sums = np.bincount(local, weights=np.abs(T) * w_row, minlength=width)
        return np.asarray(sums + (D + kappa * coefficient(ray, 0, None)) * w_node)

    # one bound for all generators: their largest entries (v_0 >= 0, so kappa v_0 is in it as well)
    operations = np.bincount(local, minlength=width) + len(values) + 8.0
    bound = column_sums(np.abs(rays).max(axis=0), True) * operations * UNIT
    far = np.zeros(width, bool)
    for s in range(len(values)):
        far |= _far(diagonal[s])
        far[local[_far(values[s])]] = True
    return np.asarray(far | np.any([column_sums(ray, False) + bound > 0 for ray in rays], axis=0))


def _far(values: "ndarray") -> "ndarray":
    """Whether a number is too large or too small to be multiplied without overflow or underflow."""
    import numpy as np

    size = np.abs(values)
    return np.asarray((size > LARGE) | ((size < 1 / LARGE) & (size > 0)))
