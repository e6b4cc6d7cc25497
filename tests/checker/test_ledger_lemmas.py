"""Lemmas about one function: whatever a partition proves is true at sampled points, whatever the partition is."""

import random
from fractions import Fraction

import numpy as np
import pytest
from flint import ctx

from persid.certificates.partitions import cuts_of
from persid.models.functions import scalar_function
from persid_check.enclosure import PRECISION
from persid_check.expression import parse
from persid_check.ledger.lemmas import Lemma, Product

FUNCTIONS = (
    "x**3", "sinh(x)", "tanh(x)", "arctan(x)", "sat(x)", "deadzone(x)", "relu(x)", "sin(x)", "softsign(x)", "x*abs(x)",
    "expm1(x)", "erf(x)", "softplus(x)", "x**3-3*x**2+2.5*x", "abs(x)", "cos(x)", "x**2", "arcsinh(x)", "x**5",
    "exp(x)", "x/(1+x**2)", "relu(x-1)", "tanh(x+1)", "sin(3*x)",
    "pwl(x; -1.1: -1, -0.3: 0, 0.3: 0, 1: 2)", "pwl(x; -2: -1, -0.7: -1.5, 0: 0, 0.1: 0.3, 3: 0.3)",
)  # fmt: skip
KINDS = ("sector", "growing", "nondecreasing", "rising", "one-signed", "offset", "upper")
EPSILON = 1e-9


def _draw(choose: random.Random) -> tuple[list[str], list[Fraction], Lemma, tuple[Fraction, Fraction] | None]:
    texts = choose.sample(FUNCTIONS, choose.choice((1, 1, 2)))
    alphas = [choose.choice((Fraction(1), Fraction(1), Fraction(1, 2), Fraction(3))) for _ in texts]
    quarters = [Fraction(choose.randint(-8, 8), choose.choice((1, 4, 16))) for _ in range(1 + len(texts))]
    kind = choose.choice(KINDS)
    centre, domain = None, None
    if choose.random() < 0.4:
        middle = Fraction(choose.randint(-16, 16), 8)
        radius = choose.choice((Fraction(0), Fraction(1, 2**20), Fraction(1, 16)))
        centre = (middle - radius, middle + radius)
    if choose.random() < 0.4:
        domain = (-Fraction(choose.randint(1, 24), 8), Fraction(choose.randint(1, 24), 8))
    c = Fraction(choose.randint(0, 32), 16) if kind == "upper" else Fraction(0)
    allowance = (
        Fraction(choose.randint(0, 32), 16) if kind in ("upper", "offset") and choose.random() < 0.5 else Fraction(0)
    )
    functions = tuple((parse(text), alpha) for text, alpha in zip(texts, alphas, strict=True))
    return texts, alphas, Lemma(functions, tuple(quarters), kind, centre, c=c, allowance=allowance), domain


def _random_cuts(choose: random.Random) -> tuple[Fraction, ...]:
    count = choose.randint(2, 40)
    reach = choose.choice((2, 8, 40))
    return tuple(sorted({Fraction(0), *(Fraction(choose.randint(-64 * reach, 64 * reach), 64) for _ in range(count))}))


def _violated(
    texts: list[str], alphas: list[Fraction], lemma: Lemma, domain: tuple[Fraction, Fraction] | None
) -> str | None:
    """A violation of the statement at sampled points, by NumPy alone."""
    functions = [(scalar_function(text), float(a)) for text, a in zip(texts, alphas, strict=True)]
    form = [float(c) for c in lemma.form]
    for star in {0.0} if lemma.centre is None else {float(v) for v in (*lemma.centre, sum(lemma.centre) / 2)}:
        ends = (-30.0, 30.0) if domain is None else (float(domain[0]), float(domain[1]))
        s = np.unique(np.concatenate([np.linspace(*ends, 12001), ends[0] * np.geomspace(1e-6, 1, 800),
                                      ends[1] * np.geomspace(1e-6, 1, 800), [0.0]]))  # fmt: skip
        with np.errstate(all="ignore"):
            g = form[0] * (star + s) + sum(
                c * f.value(a * (star + s)) for c, (f, a) in zip(form[1:], functions, strict=True)
            )
            if lemma.centre is not None:
                at = np.array([star])
                g = (
                    g
                    - form[0] * star
                    - sum(c * f.value(a * at)[0] for c, (f, a) in zip(form[1:], functions, strict=True))
                )
        size = EPSILON * (1 + np.abs(g) + np.abs(s) * sum(map(abs, form)))
        bad = {
            "sector": s * g < -size * np.abs(s),
            "growing": s * g < -size * np.abs(s),
            "one-signed": g < -size,
        }.get(lemma.kind)
        if lemma.kind in ("nondecreasing", "rising"):
            bad = np.append(np.diff(g) < -size[1:], False)
        if lemma.kind in ("offset", "upper"):
            zero = int(np.searchsorted(s, 0.0))
            area = _outward((g[1:] + g[:-1]) / 2 * np.diff(s), zero)
            loose = 1e-6 * (1 + np.abs(area)) + np.abs(_outward(np.abs(np.diff(g)) * np.diff(s), zero))
            gap = area + float(lemma.allowance)
            if lemma.kind == "upper":
                gap = float(lemma.c) * s * g + float(lemma.allowance) - area
            bad = gap < -loose
        if bad is not None and bad[np.isfinite(g)].any():
            about = f"centre {lemma.centre}, domain {domain}, s = {s[bad][:3]}"
            return f"{lemma.kind} of {form} over {texts}, {alphas}, {about}"
    return None


def _outward(steps: np.ndarray, zero: int) -> np.ndarray:
    """Sums from the place `zero` to both sides: small near it, without the far end's rounding errors."""
    return np.concatenate([-np.cumsum(steps[:zero][::-1])[::-1], [0.0], np.cumsum(steps[zero:])])


def _attack(count: int, seed: int) -> tuple[int, dict[str, int]]:
    choose = random.Random(seed)
    proved: dict[str, int] = dict.fromkeys(KINDS, 0)
    with ctx.workprec(PRECISION):
        for i in range(count):
            texts, alphas, lemma, domain = _draw(choose)
            cuts = _random_cuts(choose) if i % 3 == 0 else cuts_of(lemma, domain)
            if cuts is None or lemma.unproved(cuts, domain) is not None:
                continue
            proved[lemma.kind] += 1
            assert _violated(texts, alphas, lemma, domain) is None, cuts
    print(f"{count} lemmas drawn, {sum(proved.values())} proved: {proved}")
    return sum(proved.values()), proved


@pytest.mark.long
def test_what_is_proved_is_true() -> None:
    """Of random lemmas with random and with sought partitions, every one that is proved holds at sampled points."""
    total, proved = _attack(1000, seed=3)
    assert total > 150
    assert all(proved[kind] for kind in KINDS)


@pytest.mark.slow
def test_what_is_proved_is_true_of_fifty_thousand() -> None:
    """The same for 50,000 random lemmas."""
    total, _ = _attack(50_000, seed=4)
    assert total > 5000


def test_products_with_constants_that_are_proved_are_true() -> None:
    """Of random products with a constant, every one that is proved holds at sampled points."""
    choose, proved = random.Random(5), 0
    y = np.concatenate([np.linspace(-20, 20, 8001), np.linspace(-2, 2, 8001)])
    with ctx.workprec(PRECISION):
        for _ in range(400):
            text = choose.choice(("x**3", "tanh(x)", "sin(x)", "relu(x)", "x**2", "arctan(x)"))
            forms = [tuple(Fraction(choose.randint(-4, 4), 2) for _ in range(2)) for _ in range(2)]
            c = Fraction(choose.randint(0, 40), 8)
            cuts = tuple(Fraction(i, 16) for i in range(-64, 65))
            if Product(((parse(text), Fraction(1)),), (forms[0], forms[1]), c).unproved(cuts) is None:
                proved += 1
                f = scalar_function(text).value(y)
                values = [float(form[0]) * y + float(form[1]) * f for form in forms]
                assert (values[0] * values[1] + float(c) >= -1e-9 * (1 + np.abs(values[0] * values[1]))).all()
    assert proved > 60


@pytest.mark.parametrize(
    ("texts", "form", "kind", "more"),
    [
        (("sinh(x)", "x**3"), (0, 1, "-0.3712"), "sector", {}),
        (("tanh(x)",), (1, "-1.0001"), "sector", {}),
        (("tanh(x)",), (1, "-1.0001"), "nondecreasing", {}),
        (("tanh(x)",), (0, 1), "growing", {}),
        (("arctan(x)",), (0, 1), "growing", {}),
        (("arcsinh(x)",), (0, -1), "growing", {}),
        (("deadzone(x)",), (0, 1), "growing", {}),
        (("deadzone(x)",), (0, 1), "rising", {}),
        (("relu(x)",), (0, 1), "rising", {}),
        (("x**3-3*x**2+2.5*x",), (0, 1), "nondecreasing", {}),
        (("x**3",), (0, 1), "upper", {"c": "0.2499"}),
        (("x**3",), (0, 1), "upper", {"c": "0.25", "centre": (1, 1)}),
        (("x**3",), (0, 1), "upper", {"c": "0.78", "centre": (1, 1)}),
        (("tanh(x)",), (0, 1), "upper", {"c": "0.99"}),
        (("x**3",), (-2, 1), "offset", {"allowance": "0.999"}),
        (("relu(x)",), (0, 1), "one-signed", {"centre": (1, 1)}),
        (("relu(x)",), (0, 1), "one-signed", {"centre": (-1, "0.001")}),
        (("exp(x)",), (-1, 1), "one-signed", {"centre": ("0.001", "0.001")}),
        (("cos(x)",), (0, 1), "sector", {}),
        (("tan(x)",), (0, 1), "sector", {}),
    ],
)  # fmt: skip
def test_a_false_lemma_has_no_partition(texts, form, kind, more) -> None:
    """No partition that is tried proves a false lemma, near as it may be to a true one."""
    numbers = {name: Fraction(value) for name, value in more.items() if name != "centre"}
    centre = tuple(Fraction(v) for v in more["centre"]) if "centre" in more else None
    functions = tuple((parse(text), Fraction(1)) for text in texts)
    lemma = Lemma(functions, tuple(Fraction(v) for v in form), kind, centre, **numbers)
    choose = random.Random(0)
    with ctx.workprec(PRECISION):
        assert cuts_of(lemma, None) is None
        for _ in range(20):
            assert lemma.unproved(_random_cuts(choose), None) is not None


def test_an_integral_is_bounded_by_middles_of_few_pieces() -> None:
    """A bound of an integral that is nearly sharp at the end takes few pieces: their error falls with their squares."""
    cube, h = ((parse("x**3"), Fraction(1)),), Fraction(2)
    forms = {share: (h**2 / 2 * share, Fraction(-1)) for share in (Fraction(1025, 1024), Fraction(1))}
    found = cuts_of(Lemma(cube, forms[Fraction(1025, 1024)], "offset"), (-h, h))
    assert found is not None
    assert len(found) < 150
    assert cuts_of(Lemma(cube, forms[Fraction(1)], "offset"), (-h - Fraction(1, 64), h)) is None


def test_a_middle_says_nothing_where_the_quantity_changes_its_sign() -> None:
    """A gap that falls below 0 inside a piece and has risen at its end is not proved by the piece's middle."""
    falls = ((parse("pwl(x; 0: 0, 0.125: 1, 1: -1, 3: 3)"), Fraction(1)),)  # areas to 1 and 1.5: 1/16, -3/16
    lemma = Lemma(falls, (Fraction(0), Fraction(1)), "offset", allowance=Fraction(1, 64))
    fine = (Fraction(-1), Fraction(0), Fraction(1, 8), *(Fraction(k, 64) for k in range(9, 64)))
    with ctx.workprec(PRECISION):
        assert lemma.unproved((*fine, Fraction(1)), (Fraction(-1), Fraction(1))) is None
        assert lemma.unproved((*fine, Fraction(1), Fraction(3)), (Fraction(-1), Fraction(3))) is not None


@pytest.mark.parametrize("tilt", [Fraction(0), Fraction(1, 2**20)])
def test_a_middle_at_a_kink_counts_what_is_lost_beside_it(tilt: Fraction) -> None:
    """At a kink the mean differs from the middle by an eighth of the width times the change of slope: exactly that."""
    roof = ((parse("3 - abs(x - 3)"), Fraction(1)),)
    lemma = Lemma(roof, (-2 - tilt, Fraction(4)), "offset")  # it falls from 3 on, and its integral is 0 again at 6
    with ctx.workprec(PRECISION):
        reason = lemma.unproved(tuple(map(Fraction, (-1, 0, 2, 4, 6))), (Fraction(-1), Fraction(6)))
    assert reason == ("the sum over the piece from 4 to 6" if tilt else None)


def test_the_point_zero_is_no_piece() -> None:
    """At 0 alone there is nothing to expand: a form that evaluation does not prove there is not proved."""
    cosine = Lemma(((parse("cos(x)-1"), Fraction(1)),), (Fraction(0), Fraction(1)), "rising")
    assert not cosine.holds_on(Fraction(0), Fraction(0))
