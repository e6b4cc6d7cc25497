"""Cones of vectors: the facets of a conic hull, and the vector that is deepest inside the dual cone."""

from math import hypot

import numpy as np
from jaxtyping import Float
from numpy import ndarray

FLAT = 1e-14  # distance in a section of a cone, which is about as wide as one
THIN = 1e-9  # width over length below which points lie on a line but for rounding
DEEPEST = 1e-12  # to which the deepest form is found
WOLFE = 500  # steps of its search, which takes a dozen


def facets(V: Float[ndarray, "N d"]) -> Float[ndarray, "K d"]:
    """Return inward unit normals of the facets of the conic hull of the rows of V (unit vectors in a half space)."""
    d = V.shape[1]
    if d == 1:
        return np.ones((1, 1))
    centre = interior(V)
    depth = V @ centre
    if not depth.min() > 0:
        return np.zeros((0, d))
    section = np.linalg.svd(centre[None])[2][1:]  # the plane centre'v = 1 cuts out a convex body of dimension d - 1
    points = (V / depth[:, None]) @ section.T
    if d == 2:
        ends = np.array([points.max(), points.min()])
        normals = np.stack([ends[0] * centre - section[0], section[0] - ends[1] * centre])
    else:
        width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        outward = edges(points) if d == 3 and width[-1] > THIN * width[0] else hull(points)
        normals = -(outward[:, :-1] @ section + outward[:, -1:] * centre)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def edges(points: Float[ndarray, "N 2"]) -> Float[ndarray, "K 3"]:
    """Return the outward normals of the convex hull of points of the plane, with -offset: Andrew's chain.

    A corner that lies no farther than `FLAT` from the line between its neighbours is rounding.
    """
    turning = points[np.lexsort(points.T)].tolist()
    corners: list[list[float]] = []
    for way in (turning, turning[::-1]):
        chain: list[list[float]] = []
        for x, y in way:
            while len(chain) > 1:
                (x0, y0), (x1, y1) = chain[-2:]
                away = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
                if away < -FLAT * hypot(x - x0, y - y0):
                    break
                chain.pop()
            chain.append([x, y])
        corners += chain[:-1]
    at = np.array(corners)
    along = np.roll(at, -1, axis=0) - at
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)[np.any(along != 0, axis=1)]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.column_stack([normals, -(normals @ points.T).max(axis=1)])


def hull(points: Float[ndarray, "N e"]) -> Float[ndarray, "K f"]:
    """Return the same in more dimensions, of points moved a little where they lie in a plane; none where both fail."""
    from scipy.spatial import ConvexHull, QhullError

    for options in (None, "QJ"):
        try:
            return np.asarray(ConvexHull(points, qhull_options=options).equations)
        except QhullError:
            continue
    return np.zeros((0, points.shape[1] + 1))


def interior(V: ndarray) -> ndarray:
    """Return a unit vector c that makes min V c largest: the deepest form of the dual cone; 0 where there is none.

    It points at the point nearest to 0 of the hull of the rows, unit vectors: Wolfe's method (1976), Math. Progr. 11.
    """
    if not len(V):
        return np.zeros(V.shape[1])
    rows, weights = [int(np.argmax(V @ V.mean(axis=0)))], np.ones(1)
    for _ in range(WOLFE):
        nearest = weights @ V[rows]
        j = int(np.argmin(V @ nearest))
        if V[j] @ nearest > nearest @ nearest - DEEPEST or j in rows:
            break
        rows, weights = [*rows, j], np.append(weights, 0.0)
        while True:  # towards the nearest point of the plane through the rows; those on the way whose weight is 0 leave
            G = V[rows] @ V[rows].T
            there = np.linalg.lstsq(G + 1.0, np.ones(len(rows)), rcond=None)[0]
            there = there / there.sum()
            if (there > 0).all():
                weights = there
                break
            falling = there <= 0
            share = (weights[falling] / (weights - there)[falling]).min()
            weights = weights + share * (there - weights)
            kept = weights > weights.max() * DEEPEST
            rows, weights = [r for r, k in zip(rows, kept, strict=True) if k], weights[kept] / weights[kept].sum()
    length = float(np.linalg.norm(nearest))
    return np.asarray(nearest / length if length > DEEPEST else 0.0 * nearest)
