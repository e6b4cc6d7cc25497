"""Models with products of states, of which many keep an energy: published ones and random ones of known truth."""

import numpy as np
from numpy import ndarray

import persid as ps

Products = dict[tuple[int, int, int], float]  # (equation, state, state): coefficient


def flow(A0: object, products: Products, B: object = None, **more: object) -> ps.PersidskiiModel:
    """A model x' = A0 x + products + B u; x_j x_k is ((x_j + x_k)^2 - (x_j - x_k)^2) / 4."""
    A0 = np.array(A0, float)
    n = len(A0)
    columns: dict[tuple[int, ...], ndarray] = {}
    for (i, j, k), value in products.items():
        for sign in (1.0, -1.0):
            row = tuple(int(sign * (i == k) + (i == j)) for i in range(n))
            if any(row):
                columns.setdefault(row, np.zeros(n))[i] += sign * value / 4
    terms = [("x**2", np.array(list(columns), float), np.array(list(columns.values())).T)]
    return ps.PersidskiiModel(A0, terms, np.eye(n) if B is None else B, **more)


def lorenz(r: float) -> ps.PersidskiiModel:
    """Lorenz's system with sigma = 10, b = 8/3 about its rest at 0, which attracts every run for r < 1."""
    return flow([[-10, 10, 0], [r, -1, 0], [0, 0, -8 / 3]], {(1, 0, 2): -1, (2, 0, 1): 1})


def lorenz_about_a_ball(r: float) -> ps.PersidskiiModel:
    """The same about (0, 0, sigma + r), where |x|^2 falls outside a ball."""
    A0 = [[-10, 10, 0], [-10, -1, 0], [0, 0, -8 / 3]]
    more = {"x_ref": [0, 0, 10 + r], "b": [0, 0, -(10 + r) * 8 / 3]}
    return flow(A0, {(1, 0, 2): -1, (2, 0, 1): 1}, **more)


def body(J: tuple[float, float, float], damping: ndarray) -> ps.PersidskiiModel:
    """Euler's rotating body with moments J, damped, its inputs torques about the three axes."""
    products = {(i, (i + 1) % 3, (i + 2) % 3): (J[(i + 1) % 3] - J[(i + 2) % 3]) / J[i] for i in range(3)}
    return flow(-np.array(damping) / np.array(J)[:, None], products, np.diag(1 / np.array(J)))


def rabinovich(h: float) -> ps.PersidskiiModel:
    """Rabinovich's waves with dampings 4, 1, 1: x' = h y - 4 x + y z, y' = h x - y - x z, z' = -z + x y."""
    A0 = [[-4, h, 0], [h, -1, 0], [0, 0, -1]]
    return flow(A0, {(0, 1, 2): 1, (1, 0, 2): -1, (2, 0, 1): 1})


def five_modes(R: float) -> ps.PersidskiiModel:
    """Five modes of a forced flow on a torus, about the rest (0, 0, R/5, 0, 0), unstable from R = 5 sqrt(3/2) on."""
    A0 = np.diag([-2.0, -9, -5, -5, -1])
    A0[0, 1], A0[1, 0] = 4 * R / 5, 3 * R / 5
    products = {(0, 1, 2): 4, (0, 3, 4): 4, (1, 0, 2): 3, (2, 0, 1): -7, (3, 0, 4): -1, (4, 0, 3): -3}
    return flow(A0, products, [[0.0], [0], [1], [0], [0]], x_ref=[0, 0, R / 5, 0, 0])


def prey() -> ps.PersidskiiModel:
    """Predators y and prey x that fills its room, x' = x (3 - x - 2 y), y' = y (x - 1), about their rest (1, 1)."""
    products = {(0, 0, 0): -1.0, (0, 0, 1): -2.0, (1, 0, 1): 1.0}
    return flow([[-1, -2], [1, 0]], products, x_ref=[1, 1])


def triad() -> ps.PersidskiiModel:
    """Three modes that excite each other, x' = -x + y z and so on around: stable about 0, unstable at (1, 1, 1)."""
    return flow(-np.eye(3), {(0, 1, 2): 1.0, (1, 0, 2): 1.0, (2, 0, 1): 1.0})


def drawn(rng: np.random.Generator, n: int, growth: float) -> ps.PersidskiiModel:
    """A random truncation of a flow: products that keep |x|^2, and x'A0 x <= growth |x|^2, with equality somewhere.

    All numbers are short, so that the products keep it exactly. Stable if growth < 0; unstable about 0 else.
    """
    products: Products = {}
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(j + 1, n):
                a, b = rng.integers(-8, 9, 2) / 4
                products |= {(i, j, k): float(a), (j, i, k): float(b), (k, i, j): float(-a - b)}
    skew = rng.integers(-8, 9, (n, n)) / 4
    skew[0] = skew[:, 0] = 0
    A0 = skew - skew.T - np.diag(rng.integers(4, 9, n) / 4)
    A0[0, 0] = growth
    return flow(A0, products)
