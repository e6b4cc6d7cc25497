"""Rigorous numbers of a claim: V at a state, and the bound of |x(t) - x*| where it has a rate, rounded outwards.

For every input, and every x(0) for which the claim holds, it says

    |x(t) - x*| <= sqrt(V(x(0)) / p) exp(-kappa t / 2) + sqrt(sup v'Gamma v / (kappa p)) + spread,     v = u - u*,

where spread = sum_j sqrt(s_j / (kappa p)) epsilon_j for the deviations of a plant, 0 for a model (of a practical claim
the root of (c_0 / kappa + e_V + o_V) / p),
and Gamma = gamma I, or a matrix that gives each input its own gain. Where b counts as one more input, v ends with 1.
In discrete time t is a multiple of dt, and (1 - kappa)^(t/dt) stands for exp(-kappa t).
"""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from flint import arb, arb_mat, ctx, fmpq
from jaxtyping import Float
from numpy import ndarray

from persid.certificates.claims import Claim, Part
from persid_check.enclosure import Interval, between, constant, value, value_and_slope
from persid_check.equilibrium import argument
from persid_check.expression import Program

PIECES = 256  # of an integral; the error of the enclosure falls with their square
BITS = 128
Gamma = Fraction | tuple[tuple[Fraction, ...], ...]  # gamma of gamma I, or the lower rows of a matrix


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


def gain(claim: Claim) -> arb:
    """Return the gain from sup|v| to |x - x*|: the root of the largest eigenvalue of Gamma over kappa p."""
    with ctx.workprec(BITS):
        return (largest_eigenvalue(claim.gamma) / _unit(claim)).sqrt()


def gains(claim: Claim, width: int) -> list[arb]:
    """Return the gain from sup|v_l| to |x - x*| for each of `width` inputs."""
    with ctx.workprec(BITS):
        return [(ball(coupling(claim.gamma, width)[k][k]) / _unit(claim)).sqrt() for k in range(width)]


def coupling(gamma: Gamma, width: int) -> list[list[Fraction]]:
    """Return Gamma for `width` inputs."""
    if isinstance(gamma, Fraction):
        return [[gamma if i == j else Fraction(0) for j in range(width)] for i in range(width)]
    return [[gamma[max(i, j)][min(i, j)] for j in range(width)] for i in range(width)]


def supply(gamma: Gamma, sizes: Sequence[float]) -> Fraction:
    """Return an upper bound of v'Gamma v for |v_l| <= sizes[l]: each term has the sign that is worst."""
    s = [Fraction(float(size)) for size in sizes]
    rows = coupling(gamma, len(s))
    return sum((abs(rows[i][j]) * a * b for i, a in enumerate(s) for j, b in enumerate(s)), Fraction(0))


def input_bounds(claim: Claim, width: int) -> Float[ndarray, " m"]:
    """Return the size that each of `width` inputs alone may have in a region, rounded down: Gamma_ll u^2 <= kappa c."""
    room = claim.kappa * claim.level - claim.constant_supply
    rows = coupling(claim.gamma, width)
    with ctx.workprec(BITS):
        return np.array([-above(-ball(room / rows[k][k]).sqrt()) if rows[k][k] else np.inf for k in range(width)])


def largest_eigenvalue(gamma: Gamma) -> arb:
    """Return an upper bound, to 0.1 %: (tr Gamma^k)^(1/k) for Gamma > 0, k a power of two."""
    if isinstance(gamma, Fraction):
        return ball(gamma)
    width, squarings = len(gamma), 12
    entries = [ball(v) for row in coupling(gamma, width) for v in row]
    M = arb_mat(width, width, entries)
    for _ in range(squarings):
        M = M * M
    return M.trace().upper() ** (arb(1) / 2**squarings) if width else arb(0)


def _unit(claim: Claim) -> arb:
    return ball(claim.kappa * claim.p)


def spread(claim: Claim, unit: arb) -> arb:
    """Return what constants add to a bound of the square root of `unit` / kappa times V: those of deviations, and of a
    practical claim."""
    parts = [(ball(each.s) / unit).sqrt() * ball(each.epsilon) for each in claim.deviations]
    return sum(parts, (ball(claim.square) * _unit(claim) / unit).sqrt())


def remaining(claim: Claim) -> arb:
    """Return the distance from x* at which the constant parts of deviations may leave the state."""
    with ctx.workprec(BITS):
        return spread(claim, _unit(claim))


def decay(claim: Claim) -> arb:
    """Return the rate at which |x - x*| is proved to decay, in 1/s: kappa/2, in discrete time -ln(1 - kappa)/(2 dt)."""
    dt = claim.model.dt
    if dt is None:
        return ball(claim.kappa / 2)
    return -ball(1 - claim.kappa).log() / ball(2 * dt)


def rate(claim: Claim) -> float:
    """Return `decay`, rounded down."""
    if claim.model.dt is None:
        return below(claim.kappa / 2)
    with ctx.workprec(BITS):
        return -above(-decay(claim))


def factor(claim: Claim) -> float:
    """Return sqrt(1 - kappa), what is left of the bound of the state in one step, rounded up."""
    with ctx.workprec(BITS):
        return above(ball(1 - claim.kappa).sqrt())


def overshoot(claim: Claim, x0: Float[ndarray, " n"]) -> arb:
    """Return sqrt(V(x0) / p)."""
    with ctx.workprec(BITS):
        largest = lyapunov(claim, x0).hi
        return (largest / ball(claim.p)).sqrt() if largest > 0 else arb(0)


def bound(
    claim: Claim, x0: Float[ndarray, " n"], u_sup: float | Sequence[float], t: Float[ndarray, " N"]
) -> Float[ndarray, " N"]:
    """Return the bound of |x(t) - x*| at times t (s) for inputs with sup|v| <= u_sup, or sup|v_l| <= u_sup[l] each."""
    with ctx.workprec(BITS):
        start, rate = overshoot(claim, x0), decay(claim)
        if isinstance(u_sup, float):
            steady = gain(claim) * arb(u_sup)
        else:
            steady = (ball(supply(claim.gamma, u_sup)) / _unit(claim)).sqrt()
        steady += spread(claim, _unit(claim))
        return np.array([above(start * (-rate * arb(float(s))).exp() + steady) for s in t])


def is_in_region(claim: Claim, x: Float[ndarray, " n"]) -> bool:
    """Whether x lies in the region of a claim, by proof, for every x* in the ball of the operating point."""
    for row, lo, hi in claim.strips:
        y = sum((r * (Fraction(float(x[i])) - claim.centre[i]) for i, r in row.items()), Fraction(0))
        margin = claim.radius * sum((abs(r) for r in row.values()), Fraction(0))
        if not lo + margin <= y <= hi - margin:
            return False
    with ctx.workprec(BITS):
        return bool(lyapunov(claim, x).hi <= ball(claim.level))


def lyapunov(claim: Claim, x: Float[ndarray, " n"]) -> Interval:
    """Return an enclosure of V(x), for every x* in the ball of the operating point."""
    model = claim.model
    star = [between(c - claim.radius, c + claim.radius) for c in claim.centre]
    dx = [constant(Fraction(float(v))) - s for v, s in zip(x, star, strict=True)]
    from_ref = [s - constant(r) for s, r in zip(star, model.x_ref, strict=False)]
    total = _quadratic(claim, [*dx, *(_rise(claim, c, dx, from_ref) for c in claim.inside)])
    for part in claim.parts:
        y = argument(part.row, dx)
        at = argument(part.row, from_ref)
        total = total + _share(claim, part, y, None if claim.x is None else at)
    return total


def _rise(claim: Claim, c: int, dx: Sequence[Interval], from_ref: Sequence[Interval]) -> Interval:
    """Enclose the value of a channel, less that at x* where an operating point is stated."""
    channel = claim.model.channels[c]
    at, y = argument(channel.row, from_ref), argument(channel.row, dx)
    start = constant(Fraction(0)) if claim.x is None else value(channel.program, at)
    return value(channel.program, at + y) - start


def _share(claim: Claim, part: Part, y: Interval, at: Interval | None) -> Interval:
    """The double integral of the density of a part."""
    weights = part.density
    total = constant(weights[0]) * y.power(Fraction(2))
    for weight, (c, alpha) in zip(weights[1:], part.members, strict=True):
        if weight:
            total = total + constant(2 * weight) * _integral(claim.model.channels[c].program, alpha, y, at)
    return total


def ball(number: Fraction) -> arb:
    """Return an enclosure of a fraction."""
    return arb(fmpq(number.numerator, number.denominator))


def _quadratic(claim: Claim, dx: Sequence[Interval]) -> Interval:
    total = constant(Fraction(0))
    if claim.diagonal:
        for (entry,), v in zip(claim.P, dx, strict=True):
            total = total + constant(entry) * v.power(Fraction(2))
        return total
    for i, row in enumerate(claim.P):
        for j, entry in enumerate(row):
            factor = constant(entry * (1 if i == j else 2))
            total = total + factor * (dx[i].power(Fraction(2)) if i == j else dx[i] * dx[j])
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
