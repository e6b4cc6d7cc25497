"""Rigorous numbers of the outputs that a certificate bounds, rounded outwards.

Specification: docs/ledger.md, section 7, "outputs".
"""

from fractions import Fraction

import numpy as np
from flint import arb, ctx
from jaxtyping import Float
from numpy import ndarray

from persid.certificates import bounds
from persid.certificates.claims import Claim, Seen


def gains(claim: Claim) -> list[arb]:
    """Return the gain from sup|u - u*| to |y_i - y_i*| of each output: L (sqrt(c g/kappa) + |D|), g = |Gamma|."""
    with ctx.workprec(bounds.BITS):
        gamma, rate = bounds.largest_eigenvalue(claim.gamma), bounds.ball(claim.kappa)
        return [_steepness(y) * ((bounds.ball(y.constant) * gamma / rate).sqrt() + _through(y)) for y in claim.outputs]


def feedback_margins(claim: Claim) -> Float[ndarray, " l"]:
    """Return 1/gain of each output, rounded down, infinite where inputs do not reach it: docs/ledger.md, "feedback"."""
    upper = [Fraction(bounds.above(gain)) for gain in gains(claim)]
    return np.array([bounds.below(1 / gain) if gain else np.inf for gain in upper])


def bound(claim: Claim, x0: Float[ndarray, " n"], u_sup: float, t: Float[ndarray, " N"]) -> Float[ndarray, "N l"]:
    """Return the bound of |y_i - y_i*| at times t (s) from x0, for inputs with sup|u - u*| <= u_sup."""
    with ctx.workprec(bounds.BITS):
        V = bounds.lyapunov(claim, x0).hi
        rate, still = bounds.decay(claim), bounds.spread(claim, bounds.ball(claim.kappa))  # of sqrt(V)
        stays = [_steepness(y) * bounds.ball(y.constant).sqrt() * still for y in claim.outputs]
        steady = [g * arb(u_sup) + s for g, s in zip(gains(claim), stays, strict=True)]
        start = [_steepness(y) * (bounds.ball(y.constant) * V).sqrt() if V > 0 else arb(0) for y in claim.outputs]
        decay = [(-rate * arb(float(s))).exp() for s in t]
        rows = [[bounds.above(s * d + g) for s, g in zip(start, steady, strict=True)] for d in decay]
        return np.array(rows).reshape(len(t), len(start))


def _steepness(output: Seen) -> arb:
    return bounds.ball(output.lipschitz)


def _through(output: Seen) -> arb:
    """Return |D_i|."""
    return bounds.ball(sum((d**2 for d in output.direct), Fraction(0))).sqrt()
