"""Random functions, shifts, intervals and constants: no lemma is proved that dense sampling contradicts."""

import random
from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
from flint import ctx
from scipy.integrate import cumulative_trapezoid

from checker.expressions import odd_part
from persid.models.functions import scalar_function
from persid_check.expression import parse
from persid_check.search import prover

ONE = (Fraction(0), Fraction(1))


Sampled = list[tuple[np.ndarray, np.ndarray, np.ndarray]]


def _sampled(text: str, alpha: float, lo: float, hi: float, shift: float | None) -> Sampled:
    """s, f(alpha (y + s)) - f(alpha y) and a generous bound of its rounding errors, from 0 to each end."""
    f = scalar_function(text)
    sides = []
    for end in (lo, hi):
        s = np.concatenate([[0.0], end * np.geomspace(1e-4, 1, 6001)])
        x = alpha * ((0.0 if shift is None else shift) + s)
        values = f.value(x)
        rounding = (
            1e-9 * (1 + np.abs(x)) ** 2 + 1e-8 * np.abs(values[0]) + 1e7 * np.abs(f.value(x * (1 + 2.0**-50)) - values)
        )
        sides.append((s, values if shift is None else values - values[0], np.maximum.accumulate(rounding)))
    return sides


def _contradictions(text: str, alpha: float, domain, shift: float | None, c: float, d: float) -> set[str]:
    """Which properties are clearly false on samples."""
    lo, hi = (-30.0, 30.0) if domain is None else (float(domain[0]), float(domain[1]))
    false = set()
    for s, G, noise in _sampled(text, alpha, lo, hi, shift):
        size = np.maximum.accumulate(np.abs(G)) + noise
        area = cumulative_trapezoid(G, s, initial=0)
        far = np.abs(s) > 1e-2 * abs(s[-1])
        if (s * G < -1e-6 * np.abs(s) * size)[far].any():
            false.add("sector")
        if (np.diff(G) * np.sign(s[-1]) < -1e-6 * size[1:]).any():
            false.add("monotone")
        if (area - c * s * G > 1e-4 * np.abs(s) * size)[far].any():
            false.add("upper")
        if (area - d / 2 * s**2 < -1e-4 * (np.abs(s) * size + d * s**2))[far].any():
            false.add("lower")
    return false


def _compare(count: int, seed: int) -> Counter[str]:
    """Prove properties of random curves; return how many were proved, and fail on a contradiction."""
    choose, counts = random.Random(seed), Counter[str]()
    for _ in range(count):
        text, alpha = odd_part(choose), Fraction(choose.choice([1, 1, 2, 3]), choose.choice([1, 2]))
        domain = (
            None if choose.random() < 0.4 else (-Fraction(choose.randint(1, 40), 8), Fraction(choose.randint(1, 40), 8))
        )
        shift = None if choose.random() < 0.5 else Fraction(choose.randint(-24, 24), 8)
        c, d = Fraction(choose.randint(1, 24), 16), Fraction(choose.randint(1, 24), 16)
        ball = None if shift is None else (shift, Fraction(1, 2**40))
        curve = ((parse(text), alpha),)
        proved = {
            "sector": prover.prove_sector_form(curve, ONE, domain, ball),
            "monotone": prover.prove_nondecreasing(curve, ONE, domain, ball),
            "upper": prover.prove_integral_upper(curve, ONE, c, domain, ball),
            "lower": prover.prove_integral_lower(curve, ONE, d, domain, ball),
        }
        with np.errstate(all="ignore"):
            false = _contradictions(
                text, float(alpha), domain, None if shift is None else float(shift), float(c), float(d)
            )
        wrong = {name for name, answer in proved.items() if answer} & false
        assert not wrong, (text, alpha, domain, shift, c, d, wrong)
        counts.update(f"{name} proved" for name, answer in proved.items() if answer)
        counts.update(f"{name} false" for name in false)
    print(dict(counts))
    return counts


@pytest.mark.long
def test_no_lemma_is_contradicted() -> None:
    """On 60 random functions every proved property agrees with samples, and many are proved and many false."""
    with ctx.workprec(192):
        counts = _compare(60, seed=7)
    for name in ("sector", "monotone", "upper", "lower"):
        assert counts[f"{name} proved"] > 5
        assert counts[f"{name} false"] > 5


@pytest.mark.slow
def test_no_lemma_is_contradicted_in_many_trials() -> None:
    """The same on 1,500 random functions."""
    with ctx.workprec(192):
        _compare(1500, seed=8)
