"""Ledgers with identities, for the tests: products of states written by squares of rows, and forms that are zero."""

from fractions import Fraction
from typing import Any

import numpy as np

from checker.ledgers import Sketch, curve, draft, number, point
from checker.maker import model as model_object
from persid.certificates.ledger import with_proof

Certificate = dict[str, Any]
Tensor = dict[tuple[int, int, int], Any]  # (equation, state, state): coefficient of the product
QUARTER = Fraction(1, 4)


def quadratic(A0: Any, products: Tensor, B: Any = None, **more: Any) -> dict[str, Any]:
    """A model x' = A0 x + products of states + B u; x_j x_k is ((x_j + x_k)^2 - (x_j - x_k)^2) / 4."""
    n = len(A0)
    R: list[list[int]] = []
    columns = []
    for j, k in sorted({(min(j, k), max(j, k)) for _, j, k in products}):
        column = [sum(Fraction(v) for (i, *p), v in products.items() if i == e and sorted(p) == [j, k])
                  for e in range(n)]  # fmt: skip
        for sign in (1, -1) if j != k else (1,):
            R.append([int(i == j) + sign * int(i == k) * (j != k) for i in range(n)])
            columns.append([float(sign * v * QUARTER if j != k else v) for v in column])
    A = np.array(columns).T.tolist()
    return model_object([("x**2", R, A)], A0, B, n=n, **more)


def lorenz(r: float = 0.5, **more: Any) -> dict[str, Any]:
    """The system of Lorenz, b = 8/3 and sigma = 10, with an input in every equation."""
    A0 = [[-10, 10, 0], [r, -1, 0], [0, 0, -8 / 3]]
    return quadratic(A0, {(1, 0, 2): -1, (2, 0, 1): 1}, np.eye(3).tolist(), **more)


def sketch(model: dict[str, Any], shift: Any = None, **more: Any) -> Sketch:
    """A ledger of a model of squares: each channel at a point of its own, with no form at all."""
    squares = curve([(model["terms"][0]["f"], 1)], shift=shift)
    rows = [{i: v for i, v in enumerate(row) if v} for row in model["terms"][0]["R"]]
    return Sketch(model, [squares], [point(0, row, [c], []) for c, row in enumerate(rows)], [], **more)


def known(model: dict[str, Any], P: Any, identity: list[tuple[int, int, Any]], shift: Any = None, **more: Any) -> Any:
    """A ledger with V = x'P x, an identity, all channels dropped, and gamma 16, as a draft."""
    content = draft(sketch(model, shift, **more))
    n, channels = len(model["states"]), len(model["terms"][0]["R"])
    content["P"] = {"lower": [[number(P[i][j]) for j in range(i + 1)] for i in range(n)]}
    content["facts"]["identity"] = [[i, j, number(v)] for i, j, v in sorted(identity)]
    return content | {"dropped": list(range(n, n + channels)), "gamma": [16, 0]}


ENERGY = [[Fraction(1, 16), 0, 0], [0, 1, 0], [0, 0, 1]]


def cubic() -> list[tuple[int, int, Any]]:
    """What makes 2 z (x y) - 2 y (x z) zero; channels 3 and 4 are x y, 5 and 6 are x z, each as plus and minus."""
    return [(3, 2, -QUARTER), (4, 2, QUARTER), (5, 1, QUARTER), (6, 1, -QUARTER)]


def below_one() -> Certificate:
    """Lorenz with r = 1/2: the products of V = x^2/16 + y^2 + z^2 cancel."""
    return with_proof(known(lorenz(), ENERGY, cubic()))


def rated() -> Certificate:
    """The same with a rate and a gain."""
    more = {"p": [1, -5]}
    return with_proof(known(lorenz(), ENERGY, cubic(), claim="rate-and-gain", kappa=Fraction(1, 8)) | more)


def chaotic() -> Certificate:
    """Lorenz with r = 28 about (0, 0, 38): every run comes into a ball, though none rests."""
    A0 = [[-10, 10, 0], [-10, -1, 0], [0, 0, -8 / 3]]  # z = 38 + zeta: x' = 10(y - x), y' = 28x - y - x(38 + zeta)
    model = quadratic(A0, {(1, 0, 2): -1, (2, 0, 1): 1}, x_ref=[0, 0, 38], b=[0, 0, -38 * 8 / 3])
    content = known(model, np.eye(3).tolist(), cubic(), claim="practical", kappa=Fraction(1, 2))
    return with_proof(content | {"p": [1, -1], "gamma": [1, 12]})


def moved() -> Certificate:
    """Lorenz about x* = (0, 1, 0), held there by inputs: (x + y)^2 is (x + y)^2 + 2 (x + y), and x z has an entry."""
    model, x = lorenz(), [0, 1, 0]
    content = known(model, ENERGY, [*cubic(), (2, 0, 1)], shift="any")
    point = {"x": [number(v) for v in x], "radius": [0, 0], "u": [number(v) for v in (-10, 1, 0)]}
    return with_proof(content | {"operating_point": point})


MAKERS = {made.__name__: made for made in (below_one, rated, chaotic, moved)}
