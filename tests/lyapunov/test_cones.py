"""Cones: hulls in the plane are those of Qhull, and the deepest vector is the deepest."""

import numpy as np
import pytest

from persid.lyapunov.cones import edges, hull, interior


@pytest.mark.parametrize("kind", ["round", "flat", "triangle"])
def test_edges_are_those_of_qhull(kind: str) -> None:
    """The hull of points of the plane is Qhull's; corners that are rounding are none."""
    rng = np.random.default_rng(0)
    turn = rng.uniform(0, 2 * np.pi, 60)
    points = np.stack([np.cos(turn), np.sin(turn)], axis=1) * (1.0, 1e-4 if kind == "flat" else 1.0)
    if kind == "triangle":
        share = rng.dirichlet(np.ones(2), 40)
        corners = rng.normal(size=(3, 2))
        points = np.vstack([corners, *(share @ corners[[i, i - 1]] for i in range(3))])
    found, meant = edges(points), hull(points)
    meant = np.unique(np.round(meant, 9), axis=0)
    assert np.unique(np.round(found, 9), axis=0) == pytest.approx(meant, abs=1e-8)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_the_deepest_form_is_that_of_the_program(d: int) -> None:
    """No form of unit length is deeper: that of a cone by its extreme rays, and a solver's of random cones."""
    rng = np.random.default_rng(d)
    V = rng.normal(size=(80, d)) + 2.0 * np.eye(d)[0]
    V = V[V[:, 0] > 0.2] / np.linalg.norm(V[V[:, 0] > 0.2], axis=1, keepdims=True)
    c = interior(V)
    near = c + 1e-3 * rng.normal(size=(2000, d))
    depths = (near / np.linalg.norm(near, axis=1, keepdims=True) @ V.T).min(axis=1)
    assert np.linalg.norm(c) == pytest.approx(1.0)
    assert (V @ c).min() > 0
    assert depths.max() <= (V @ c).min() + 1e-12
    assert not interior(np.vstack([V, -V])).any()
