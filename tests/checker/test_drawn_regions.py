"""Regions of random loops, in continuous and in discrete time: every accepted one is invariant along its model."""

import random
from collections import Counter
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from checker.drawn import answers
from checker.known_steps import bounds_of_region, steps_model
from checker.ledgers import Sketch, curve, model_object, point, solved
from checker.sampled import Sampled, _strips, number
from persid.certificates.ledger import with_proof
from persid.errors import RoundingError

FUNCTIONS = ("tanh(x)", "sat(x)", "x**3", "sin(x)", "tanh(2*x)", "x-x**3/3", "relu(x)", "x*abs(x)", "softsign(3*x)",
             "pwl(x; -1: -0.5, 0: 0, 0.5: 1, 3: 1.25)", "deadzone(2*x)", "expm1(x)")  # fmt: skip
UNPROVED = [0, [-1, 0, 1]]
Content = dict[str, Any]


def _loop(choose: random.Random) -> Sketch:
    """A plant of up to three states in a loop with a function of one row or two, each on a strip, its factor 1 or -1,
    its values mostly in V."""
    discrete, n, sign = choose.random() < 0.7, choose.choice((1, 2, 2, 3)), choose.choice((1, -1))
    f, inside, rng = choose.choice(FUNCTIONS), choose.random() < 0.8, np.random.default_rng(choose.randrange(10**9))
    A0 = rng.normal(size=(n, n))
    values = np.linalg.eigvals(A0)
    A0 = A0 * choose.uniform(0.3, 1.02) / np.abs(values).max() if discrete else A0
    A0 = A0 if discrete else A0 - np.eye(n) * (values.real.max() + choose.uniform(-0.1, 1))
    count, make = choose.choice((1, 1, 2)), steps_model if discrete else model_object
    R = (choose.choice((0.25, 0.5, 1.0)) * rng.normal(size=(count, n))).round(3)
    columns = rng.normal(size=(n, count)).round(3) / count
    model = make([(f, (sign * R).tolist(), columns.tolist())], A0.round(3).tolist(), np.eye(n)[:, :1].tolist(), n=n)
    width = choose.choice((0.5, 1.0, 2.0))
    domain, functions = (-width, width * choose.choice((1, 1.5))), [(f, sign)]
    rows = [(0, sign), (1, -sign), (1, 0), (2, -sign), (Fraction(-3, 8), sign)]
    kinds = [(row, kind) for row in rows for kind in ("nondecreasing", "sector")]
    kinds += [(row, "one-signed") for row in ((0, sign), (0, -sign), (1, sign))]
    forms = [form for form in kinds if curve(functions, form, domain=domain)["forms"][0]["cuts"] != UNPROVED]
    known = {form: k for k, form in enumerate(forms)}
    bounds: dict[Any, Any] = {form: {"upper": (1, 0)} for form in forms if form[1] == "nondecreasing"}
    g, h = ((rows[0], "nondecreasing"), (rows[1], "nondecreasing"))
    if g in known and h in known and choose.random() < 0.5:  # each bounds the other by its square
        bounds |= {one: {"upper": (1, 0), "lower": (1, known[other])} for one, other in ((g, h), (h, g))}
    made = curve(functions, *((*form, bounds.get(form, {})) for form in forms), domain=domain)
    sectors = [k for (_, kind), k in known.items() if kind != "one-signed"]
    rising, signed = ([known[form] for form in forms if form[1] == kind] for kind in ("nondecreasing", "one-signed"))
    pairs, places = [(k, j) for k in rising for j in rising if j <= k], range(count)
    facts: list[Any] = []
    for p in places:
        facts += [("value", p, k, j) for k in sectors for j in sectors if j <= k]
        facts += [("one_signed", p, k, q, j) for q in places for k in signed for j in signed if (q, j) <= (p, k)]
        facts += [("difference", p, q, -1, k, j) for q in range(p) for k, j in pairs]
        if inside and discrete:
            facts += [("step", p, q, -1, k, j) for q in places for k, j in pairs]
            facts += [("step", p, p, 0, k, j) for k in sectors for j in sectors if j <= k]
        elif inside:
            facts += [("slope", p, k, j) for k, j in pairs]
    densities = [known[one] for one in (g, h) if one in known and (inside or not discrete)]
    at = [point(0, {i: v for i, v in enumerate(row) if v}, [c], densities) for c, row in enumerate(R.tolist())]
    kappa = Fraction(1, choose.choice((16, 64, 256)))
    return Sketch(model, [made], at, facts, "region", kappa, inside=tuple(places) * inside)


def _smaller(content: Content) -> Content:
    """With a level and inputs some way inside what the strip admits."""
    found = bounds_of_region(content)
    return with_proof(
        content | {name: [part * m, e - 4] for part, (name, (m, e)) in zip((8, 10), found.items(), strict=True)}
    )


def _is_invariant(content: Content, rng: np.random.Generator) -> bool:
    """Whether runs from sampled points of the set, with inputs of the largest size, stay in it and in its strips."""
    look, level, size = Sampled(content), number(content["level"]), number(content["input_bound"])
    strips = _strips(look)
    for _ in range(60):
        x = rng.normal(size=look.model.n)
        x *= rng.uniform() * min((hi if row @ x > 0 else -lo) / abs(row @ x) for row, lo, hi in strips)
        if look.V(x) > level:
            continue
        for _ in range(20):
            v = rng.normal(size=look.model.m)
            v *= size / np.linalg.norm(v)
            x = look.rise(x, v) if look.discrete else x + 0.01 * look.rise(x + 0.005 * look.rise(x, v), v)
            left = any(not lo - 1e-6 <= row @ x <= hi + 1e-6 for row, lo, hi in strips)
            if left or look.V(x) > level * (1 + 1e-5):
                return False
    return True


def _made(choose: random.Random) -> Content:
    try:
        return _smaller(solved(_loop(choose), ratio=1e3))
    except np.linalg.LinAlgError as error:  # no level of a Pt that is not positive
        raise RoundingError(str(error)) from error


def _regions(count: int, seed: int) -> Counter[str]:
    rng = np.random.default_rng(seed)
    return answers(_made, lambda content: _is_invariant(content, rng), count, seed)


@pytest.mark.long
def test_accepted_regions_of_random_loops_are_invariant() -> None:
    """Of random loops with all kinds of facts, runs with the largest inputs stay in every region that is accepted."""
    assert _regions(30, seed=1)["Accepted"] >= 3


@pytest.mark.slow
def test_accepted_regions_of_a_thousand_random_loops_are_invariant() -> None:
    """The same for 1,000 loops."""
    assert _regions(1000, seed=2)["Accepted"] > 60
