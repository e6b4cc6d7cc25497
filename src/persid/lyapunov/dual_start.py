"""A dual matrix to begin with: inside the sector cone, so every product of two forms has a price above zero.

A point z of the model gives X = z z' with <F, X> = 2 (l'phi)(k'phi) >= 0 for every product of forms of one group; the
mean over many points is positive definite as well. Products only join entries that a group reads together, so each
connected set of entries has a mean of its own, and what would be one matrix of order N falls into blocks of a handful.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse

from persid.lyapunov.sectors import Group
from persid.lyapunov.system import Scaling, System

SAMPLES = 6  # points of the sector cone per entry of z from which the mean is taken
ROOM = 1e-6  # of eigenvalues and prices, of which the mean is about 1: what is closer to zero is zero in rounding
LARGE = 30.0  # mean square of the entries of a point, in their units, from which it counts less

Rows = tuple[Int[ndarray, " _"], Float[ndarray, "_ _"]]  # the entries that forms of a group read, and the rows there


def dual_factor(
    system: System, units: Scaling, forms: Sequence[Rows], width: int, depth: Float[ndarray, " g"] | None = None
) -> sparse.csr_array:
    """Return C, lower triangular in blocks, with X0 = C C' inside the cone of the forms, which are those of each group.

    Entries that no form reads, such as inputs, and blocks as a whole have the same weight, 1 / width an entry. Where
    the `depth` of own functions is given, positive for sector forms, a block has its weight over the least of its
    depths: t N = t X0^-1 then asks of each block in proportion to what it can give. Otherwise one group of four
    hundred, whose terms almost cancel, decides how far mu has to fall.
    """
    rng, label = np.random.default_rng(0), _blocks([at for at, _ in forms], width)
    weight = _weights(np.ones(len(forms)) if depth is None else depth)
    members: dict[int, list[int]] = {}
    for g, (at, _) in enumerate(forms):
        if len(at):
            members.setdefault(int(label[at[0]]), []).append(g)
    order = np.argsort(label, kind="stable")
    row, column, value = [], [], []
    for at in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        inside = members.get(int(label[at[0]]), []) if len(at) else []
        X = _mean(system, units, at, [system.groups[g] for g in inside], rng) if inside else np.eye(len(at))
        X = _inward(X, [(np.searchsorted(at, forms[g][0]), forms[g][1]) for g in inside])
        row.append(np.repeat(at, len(at)))
        column.append(np.tile(at, len(at)))
        value.append(np.linalg.cholesky(X * max((weight[g] for g in inside), default=1.0) / width).ravel())
    places = np.concatenate(row), np.concatenate(column)
    return sparse.csr_array(sparse.coo_array((np.concatenate(value), places), shape=(width, width)))


def _weights(depth: Float[ndarray, " g"]) -> Float[ndarray, " g"]:
    """Return the median depth of own functions over that of each, 1 for what is no sector form."""
    known = depth > 0
    median = np.median(depth[known]) if known.any() else 1.0
    return np.asarray(np.where(known, median / np.where(known, depth, 1.0), 1.0))


def _blocks(entries: Sequence[Int[ndarray, " _"]], width: int) -> Int[ndarray, " w"]:
    """Number the block of each entry: entries that are read together, directly or not."""
    before = list(range(width))  # an entry of the same block that comes earlier, itself for the first

    def first(i: int) -> int:
        while before[i] != i:
            before[i] = i = before[before[i]]
        return i

    for at in entries:
        ends = [first(i) for i in at.tolist()]
        for end in ends:
            before[end] = min(ends)
    return np.unique([first(i) for i in range(width)], return_inverse=True)[1]


def _mean(
    system: System, units: Scaling, at: Int[ndarray, " e"], groups: Sequence[Group], rng: np.random.Generator
) -> Float[ndarray, "e e"]:
    """Return the mean of z z' over points z of the model on the entries `at`, plus a little I; its mean diagonal is 1.

    Only the states that the block holds or its groups read are drawn, so a block costs what it holds.
    """
    kept = np.array(system.states, int)
    own = np.flatnonzero(at < len(kept))
    read = np.union1d(np.flatnonzero(np.any([group.row for group in groups], axis=0)), kept[at[own]])
    count = SAMPLES * len(at) + 20
    magnitude = np.exp(rng.uniform(np.log(0.1), np.log(5.0), (count, len(read))))
    x = magnitude * rng.choice([-1.0, 1.0], magnitude.shape) * units.states[read]
    arguments = [x @ group.row[read] for group in groups]
    shrinking = [_share_inside(group, y) for group, y in zip(groups, arguments, strict=True)]
    share = np.min([np.ones(count), *shrinking], axis=0)
    z = np.zeros((count, len(at)))
    z[:, own] = (x * share[:, None])[:, np.searchsorted(read, kept[at[own]])]
    for group, y in zip(groups, arguments, strict=True):
        with np.errstate(over="ignore"):
            values = group.curve.values(y * share)[:, 1:]
        z[:, np.searchsorted(at, [system.places[c] for c in group.channels])] = values
    z = np.clip(np.nan_to_num(z / units.entries[at]), -1e6, 1e6)
    z /= np.sqrt(LARGE + np.mean(z**2, axis=1, keepdims=True))
    X: ndarray = z.T @ z
    X *= len(at) / max(float(np.trace(X)), 1e-300)
    return X + 1e-4 * np.eye(len(at))


def _share_inside(group: Group, y: Float[ndarray, " N"]) -> Float[ndarray, " N"]:
    """Return the factors by which arguments must shrink to lie well inside the domain of a group."""
    if group.curve.domain is None:
        return np.ones(len(y))
    limit = np.where(y < 0, -float(group.curve.domain[0]), float(group.curve.domain[1]))
    share: ndarray = np.minimum(1.0, 0.98 * limit / np.maximum(np.abs(y), 1e-300))
    return share


def _inward(X: Float[ndarray, "e e"], forms: Sequence[Rows]) -> Float[ndarray, "e e"]:
    """Return X, less a multiple c of I where a product of two forms has no positive price otherwise."""
    price = _off_diagonal(X, forms)
    if (price > 0).all():
        return X
    change = _off_diagonal(np.eye(len(X)), forms)
    falling, rising = change < 0, change > 0
    least = float((price[falling] / change[falling]).max(initial=-np.inf))
    most = min(float(np.linalg.eigvalsh(X)[0]), (price[rising] / change[rising]).min(initial=np.inf))
    if least < 0 < most or not least + ROOM < most:
        return X
    c = 0.5 * (least + most) if np.isfinite(least) else 2 * most
    inward: ndarray = X - c * np.eye(len(X))
    return inward


def _off_diagonal(X: ndarray, forms: Sequence[Rows]) -> ndarray:
    """Return the prices of all products of two different forms."""
    prices = (2 * rows @ X[np.ix_(at, at)] @ rows.T for at, rows in forms)
    return np.concatenate([np.zeros(0), *(each[np.triu_indices(len(each), 1)] for each in prices)])
