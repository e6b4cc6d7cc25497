r"""What a group does to itself, and the forms that a pool needs for it.

With y = r'x the group's own part of the flow is y' = -c'phi(y) + what other groups bring. Where c is a sector form, its
products with forms of V are what V' gains from the group, and the other groups may cost almost as much. But a proof
knows the forms of a pool alone: it can use c as far as c - s e is in their cone, e the form deepest inside the dual
cone. The largest such s, the depth of c there, is

    min w'c / w'e    over the rays w of the cone on which all forms of the pool are nonnegative.

On the curve itself the least of phi'c / phi'e may be far larger where terms cancel, as in x - 0.06 x**3 + 0.04 sinh x:
a pool holds the most different facets and leaves gaps between them. A ray with a small quotient is outside of the hull
of the curve, and the facet that cuts it off closes the gap.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov.cones import facets
from persid.lyapunov.sectors import (
    POOL_SIZE,
    RELAXATION,
    ROUNDING,
    Curve,
    Group,
    _directions,
    _samples,
    fine_pool,
    sizes,
)
from persid.lyapunov.system import Family, System
from persid.models.model import PersidskiiModel

DEEP = 0.5  # share of its depth on the curve that an own function has to have in the cone of a pool
SAMPLES = 400  # points on either side of zero at which own functions are looked at
NEAR = 4 * RELAXATION  # of its length: an own function no deeper than that is lost where forms are relaxed


def own_function(group: Group, states: Float[ndarray, "n n"], columns: Float[ndarray, "n e"]) -> Float[ndarray, " d"]:
    """Return c of a group in x' = states x + columns f, f its functions; of what states give y' the part along r."""
    reads = np.flatnonzero(group.row)
    r = group.row[reads]
    along = r @ states[np.ix_(reads, reads)] @ r / (r @ r) if len(r) else 0.0
    return -np.concatenate([[along], r @ columns[reads]])


def own_functions(model: PersidskiiModel, found: Sequence[Group]) -> dict[Curve, Float[ndarray, "G d"]]:
    """Return the own functions of all groups of each curve; none in discrete time, where they are no forms."""
    A0, columns, rows = model.channels.A0, model.channels.columns, dict[Curve, list[ndarray]]()
    for group in found:
        line = rows.setdefault(group.curve, [])
        if group.channels and not model.is_discrete:
            line.append(own_function(group, A0, columns[:, list(group.channels)]))
    return {curve: np.array(line).reshape(-1, curve.size) for curve, line in rows.items()}


def depths_in(system: System, families: Sequence[Family]) -> Float[ndarray, " g"]:
    """Return how deep the own function of each group is on its curve; 0 where it is no sector form, or in steps."""
    found, alike = np.zeros(len(families)), dict[Curve, list[int]]()
    for g, (group, family) in enumerate(zip(system.groups, families, strict=True)):
        if group.channels and len(family.forms) and not system.discrete:
            alike.setdefault(group.curve, []).append(g)
    states = np.zeros((system.n, system.n))
    states[:, list(system.states)] = system.G[:, : len(system.states)]
    for curve, at in alike.items():
        groups = [system.groups[g] for g in at]
        own = [own_function(each, states, system.G[:, [system.places[c] for c in each.channels]]) for each in groups]
        found[at] = _depths(curve, np.array(own), families[at[0]].forms)
    return np.where(found > 0, np.maximum(found, NEAR), 0.0)


def _depths(curve: Curve, own: Float[ndarray, "G d"], forms: Float[ndarray, "K d"]) -> Float[ndarray, " G"]:
    """Return the least phi'c / phi'e of each c, of length 1, with e the mean of the forms; 0 where there is none."""
    unit = sizes(curve)
    phi = _directions(_samples(curve, SAMPLES, False) / unit)
    found = _quotients(phi, _unit(own * unit), _directions(forms * unit).mean(axis=0)).min(axis=0)
    return np.where(np.isfinite(found), found, 0.0)


def lacking(curve: Curve, forms: Float[ndarray, "K d"], own: Float[ndarray, "G d"]) -> list[tuple[float, ...]]:
    """Return the facets that own functions need which are deep on the curve and not in the cone of the forms.

    They are at most as many as a pool has.
    """
    if curve.size <= 2 or len(forms) < POOL_SIZE or not len(own):  # there the forms are all facets
        return []
    unit, depth = sizes(curve), _depths(curve, own, forms)
    deep = depth > NEAR
    L = _directions(forms * unit)
    gaps = partial(_gaps, _unit(own * unit)[deep], depth[deep], L.mean(axis=0))
    rays, listed = gaps(L), list[int]()
    if not len(rays):
        return []
    fine = _directions(np.array(fine_pool(curve)) * unit)
    while len(rays) and len(listed) < POOL_SIZE:
        cut = fine @ rays.T
        joining = set(cut.argmin(axis=0)[cut.min(axis=0) < -ROUNDING].tolist()) - set(listed)
        if not joining:
            break
        listed += sorted(joining)
        rays = gaps(np.vstack([L, fine[listed]]))
    return [fine_pool(curve)[k] for k in listed[:POOL_SIZE]]


def _gaps(
    own: Float[ndarray, "G d"], depth: Float[ndarray, " G"], e: Float[ndarray, " d"], L: Float[ndarray, "K d"]
) -> Float[ndarray, "N d"]:
    """Return the rays of the cone of L to which own functions are the nearest that are not deep in it."""
    rays = facets(L) if len(own) else own
    if not len(rays):  # nothing is deep, or forms of which two are opposite: then L has no facets that are found here
        return rays
    inside = _quotients(rays, own, e)
    shallow = inside.min(axis=0) < DEEP * depth
    return np.asarray(rays[np.unique(inside[:, shallow].argmin(axis=0))])


def _quotients(
    rays: Float[ndarray, "N d"], own: Float[ndarray, "G d"], e: Float[ndarray, " d"]
) -> Float[ndarray, "N G"]:
    """Return w'c / w'e of all rays w and all c."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((rays @ own.T) / (rays @ e)[:, None])


def _unit(own: Float[ndarray, "G d"]) -> Float[ndarray, "G d"]:
    """Return the rows as unit vectors, zeros as zeros."""
    return np.asarray(own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-300))
