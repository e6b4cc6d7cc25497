"""Rigorous numbers of a certificate: V at a state, and the bound of |x(t) - x*| (claims E and R), rounded outwards.

For every input, and every x(0) for which the claim holds, it says

    |x(t) - x*| <= sqrt(V(x(0)) / p) exp(-kappa t / 2) + sqrt(sup v'Gamma v / (kappa p)),     v = u - u*,

where Gamma = gamma I, or a matrix that gives each input its own gain. Where b counts as one more input, v ends with 1.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx, fmpq
from jaxtyping import Float
from numpy import ndarray

from persid_check.enclosure import Interval, between, constant, value, value_and_slope
from persid_check.equilibrium import argument
from persid_check.expression import Program
from persid_check.model import groups_of, read_model

PIECES = 256  # of an integral; the error of the enclosure falls with their square
BITS = 128


def exact(pair: Sequence[int]) -> Fraction:
    """Return a dyadic [mantissa, exponent] as a fraction."""
    return Fraction(pair[0]) * Fraction(2) ** pair[1]


def below(number: Fraction) -> float:
    """Return a float that is not larger."""
    try:
        nearest = float(number)
    except OverflowError:
        return math.nextafter(math.inf, 0) if number > 0 else -math.inf
    return nearest if Fraction(nearest) <= number else math.nextafter(nearest, -math.inf)


def above(ball: arb) -> float:
    """Return a float that is not smaller than any number of a ball."""
    if not ball < arb(2) ** 1024:
        return math.inf
    mantissa, exponent = ball.upper().man_exp()
    return -below(-Fraction(int(mantissa)) * Fraction(2) ** int(exponent))


def gain(content: Mapping[str, Any]) -> arb:
    """Return the gain from sup|v| to |x - x*|: the root of the largest eigenvalue of Gamma over kappa p."""
    with ctx.workprec(BITS):
        return (largest_eigenvalue(content["gamma"]) / _unit(content)).sqrt()


def gains(content: Mapping[str, Any], width: int) -> list[arb]:
    """Return the gain from sup|v_l| to |x - x*| for each of `width` inputs."""
    with ctx.workprec(BITS):
        return [(ball(coupling(content, width)[k][k]) / _unit(content)).sqrt() for k in range(width)]


def coupling(content: Mapping[str, Any], width: int) -> list[list[Fraction]]:
    """Return Gamma for `width` inputs."""
    stored = content["gamma"]
    if not isinstance(stored, dict):
        return [[exact(stored) if i == j else Fraction(0) for j in range(width)] for i in range(width)]
    rows = stored["lower"]
    return [[exact(rows[max(i, j)][min(i, j)]) for j in range(width)] for i in range(width)]


def supply(content: Mapping[str, Any], sizes: Sequence[float]) -> Fraction:
    """Return an upper bound of v'Gamma v for |v_l| <= sizes[l]: each term has the sign that is worst."""
    s = [Fraction(float(size)) for size in sizes]
    Gamma = coupling(content, len(s))
    return sum((abs(Gamma[i][j]) * a * b for i, a in enumerate(s) for j, b in enumerate(s)), Fraction(0))


def largest_eigenvalue(stored: Any) -> arb:
    """Return an upper bound, to 0.1 %: (tr Gamma^k)^(1/k) for Gamma > 0, k a power of two."""
    if not isinstance(stored, dict):
        return ball(exact(stored))
    width, squarings = len(stored["lower"]), 12
    Gamma = coupling({"gamma": stored}, width)
    entries = [arb(fmpq(v.numerator, v.denominator)) for row in Gamma for v in row]
    M = arb_mat(width, width, entries)
    for _ in range(squarings):
        M = M * M
    return M.trace().upper() ** (arb(1) / 2**squarings) if width else arb(0)


def _unit(content: Mapping[str, Any]) -> arb:
    return ball(exact(content["kappa"]) * exact(content["p"]))


def overshoot(content: Mapping[str, Any], x0: Float[ndarray, " n"]) -> arb:
    """Return sqrt(V(x0) / p)."""
    with ctx.workprec(BITS):
        largest = lyapunov(content, x0).hi
        return (largest / ball(exact(content["p"]))).sqrt() if largest > 0 else arb(0)


def bound(
    content: Mapping[str, Any], x0: Float[ndarray, " n"], u_sup: float | Sequence[float], t: Float[ndarray, " N"]
) -> Float[ndarray, " N"]:
    """Return the bound of |x(t) - x*| at times t (s) for inputs with sup|v| <= u_sup, or sup|v_l| <= u_sup[l] each."""
    with ctx.workprec(BITS):
        start, rate = overshoot(content, x0), ball(exact(content["kappa"]) / 2)
        if isinstance(u_sup, float):
            steady = gain(content) * arb(u_sup)
        else:
            steady = (ball(supply(content, u_sup)) / _unit(content)).sqrt()
        return np.array([above(start * (-rate * arb(float(s))).exp() + steady) for s in t])


def is_in_region(content: Mapping[str, Any], x: Float[ndarray, " n"]) -> bool:
    """Whether x lies in the region of a claim R, by proof, for every x* in the ball of the operating point."""
    point = content["operating_point"]
    margin = Fraction(0) if point is None else 2 * exact(point["radius"])  # X = box - x*, shrunk by the ball
    for (low, high), v in zip(content["box"], x, strict=True):
        if not exact(low) + margin <= Fraction(float(v)) <= exact(high) - margin:
            return False
    with ctx.workprec(BITS):
        return bool(lyapunov(content, x).hi <= ball(exact(content["level"])))


def lyapunov(content: Mapping[str, Any], x: Float[ndarray, " n"]) -> Interval:
    """Return an enclosure of V(x), for every x* in the ball of the operating point."""
    model = read_model(content["model"])
    point = content["operating_point"]
    centre = model.x_ref if point is None else [exact(pair) for pair in point["x"]]
    radius = Fraction(0) if point is None else exact(point["radius"])
    star = [between(c - radius, c + radius) for c in centre]
    dx = [constant(Fraction(float(v))) - s for v, s in zip(x, star, strict=True)]
    total = _quadratic(content["P"], dx)
    for group, stored in zip(groups_of(model), content["groups"], strict=True):
        weights = _density(stored, 1 + len(group.members))
        y = argument(group.row, dx)
        at = argument(group.row, [s - constant(r) for s, r in zip(star, model.x_ref, strict=True)])
        total = total + constant(weights[0]) * y.power(Fraction(2))
        for weight, (c, alpha) in zip(weights[1:], group.members, strict=True):
            if weight:
                shift = at if point is not None else None
                total = total + constant(2 * weight) * _integral(model.channels[c].program, alpha, y, shift)
    return total


def ball(number: Fraction) -> arb:
    """Return an enclosure of a fraction."""
    return arb(fmpq(number.numerator, number.denominator))


def _quadratic(stored: Mapping[str, Any], dx: Sequence[Interval]) -> Interval:
    total = constant(Fraction(0))
    if "diagonal" in stored:
        for pair, v in zip(stored["diagonal"], dx, strict=True):
            total = total + constant(exact(pair)) * v.power(Fraction(2))
        return total
    for i, row in enumerate(stored["lower"]):
        for j, pair in enumerate(row):
            factor = constant(exact(pair) * (1 if i == j else 2))
            total = total + factor * (dx[i].power(Fraction(2)) if i == j else dx[i] * dx[j])
    return total


def _density(stored: Mapping[str, Any], size: int) -> list[Fraction]:
    total = [Fraction(0)] * size
    for mu, form in zip(stored["mu"], stored["forms"], strict=True):
        total = [a + exact(mu) * exact(c) for a, c in zip(total, form, strict=True)]
    return total


def _integral(program: Program, alpha: Fraction, y: Interval, at: Interval | None) -> Interval:
    """Enclose the integral of f(alpha (at + s)) - f(alpha at) over s from 0 to y (at = None: of f(alpha s)).

    On a piece of width h about its middle m, g(m) + g'(.) (s - m) integrates to h g(m) with an error of at most
    h^2/4 times half the width of the range of g'.
    """
    a, base = constant(alpha), constant(Fraction(0))
    offset = base if at is None else a * at
    if at is not None:
        base = value(program, offset)
    total = constant(Fraction(0))
    for k in range(PIECES):
        middle = constant(Fraction(2 * k + 1, 2 * PIECES)) * y
        piece = between(Fraction(k, PIECES), Fraction(k + 1, PIECES)) * y
        _, slope = value_and_slope(program, offset + a * piece, a)
        half = constant(Fraction(1, 8 * PIECES)) * (slope - slope) * y  # symmetric: +- half the width of the slopes
        total = total + value(program, offset + a * middle) - base + half
    return constant(Fraction(1, PIECES)) * y * total
