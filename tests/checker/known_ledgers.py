"""Ledgers that must be accepted, one for each kind of fact and conclusion, each with the reason why it is true."""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from checker import identities, known_steps, named
from checker.ledgers import Sketch, curve, draft, model_object, number, point, seeing, solved
from checker.translated import as_ledger
from persid.certificates.ledger import with_proof
from persid_check.ledger.file import read_ledger

Certificate = dict[str, Any]
TANH = [("tanh(x)", 1)]
_W = [[0.0, 1.2, -0.7], [-0.9, 0.0, 1.0], [0.8, -1.1, 0.0]]


def spring() -> Certificate:
    """A mass on a hardening spring: the row of x1^3 is exactly zero (V = energy plus x1 x2 / 10)."""
    model = model_object([("x**3", [[1, 0]], [[0], [-1]])], [[0, 1], [-1, -0.5]], [[0], [1]], n=2)
    kappa = Fraction(1, 16)
    cube = curve(
        [("x**3", 1)], ((1, 0), "nondecreasing", {"upper": (0.5, 0)}), ((0, 1), "nondecreasing", {"upper": (0.25, 0)})
    )
    sketch = Sketch(model, [cube], [point(0, {0: 1}, [0], [1])], [("value", 0, 0, 1)], "rate-and-gain", kappa)
    content = draft(sketch)
    # V = x'P x + 2 int x1^3 mu: the rows cancel for mu = P22, tau = P12 - kappa mu / 4
    P12, P22 = Fraction(1, 8), Fraction(1, 1)
    content["P"] = {"lower": [[number(P22 + Fraction(1, 16))], [number(P12), number(P22)]]}
    content["points"][0]["densities"] = [[1, number(P22)]]
    content["facts"]["value"][0][3] = number(P12 - kappa * P22 / 4)
    content |= {"dropped": [2], "gamma": [16, 0], "p": [1, -1]}
    return with_proof(content)


def difference() -> Certificate:
    """A skew network of tanh neurons that only products of differences certify at this gain."""
    model = model_object([("tanh(x)", None, _W)], (-np.eye(3)).tolist(), n=3)
    forms = curve(TANH, ((0, 1), "nondecreasing"), ((1, -1), "nondecreasing"))
    points = [point(0, {i: 1}, [i], [0, 1]) for i in range(3)]
    facts = [("value", i, 0, 1) for i in range(3)]
    facts += [("difference", i, j, sign, 0, 1) for i in range(3) for j in range(i) for sign in (-1, 1)]
    return solved(Sketch(model, [forms], points, facts))


def one_signed() -> Certificate:
    """Relus across channels: relu(x1) relu(x2) >= 0 and their mirror images."""
    model = model_object([("relu(x)", None, [[0.2, -1.5], [0.7, 0.2]])], [[-1.0, 0.0], [0.0, -1.0]], n=2)
    forms = curve(
        [("relu(x)", 1)], ((0, 1), "nondecreasing"), ((1, -1), "nondecreasing"), ((0, 1), "one-signed"),
        ((-1, 1), "one-signed"),
    )  # fmt: skip
    points = [point(0, {i: 1}, [i], [0, 1]) for i in range(2)]
    facts = [("value", i, 0, 1) for i in range(2)]
    facts += [("one_signed", i, k, j, q) for i in (0, 1) for j in range(i + 1) for k in (2, 3) for q in (2, 3)]
    return solved(Sketch(model, [forms], points, facts))


def _tanh_model(B: float = 1.0) -> Certificate:
    return model_object([("tanh(x)", None, [[-0.5, 0.1], [0.0, -0.5]])], [[-1.0, 0.5], [-0.5, -1.0]], [[B], [0.5]], n=2)


def _tanh_sketch(claim: str = "rate-and-gain", densities: tuple[int, ...] = (), **more: Any) -> Sketch:
    forms = curve(
        TANH,
        ((0, 1), "nondecreasing", {"upper": (1, 0)}),
        ((1, -1), "nondecreasing", {"upper": (1, 0)}),
    )
    points = [point(0, {i: 1}, [i], list(densities)) for i in range(2)]
    return Sketch(
        _tanh_model(), [forms], points, [("value", i, 0, 1) for i in range(2)], claim, Fraction(1, 4), True, more
    )


def incremental() -> Certificate:
    """Without densities and with nondecreasing forms any two solutions come together."""
    return solved(_tanh_sketch())


def rated() -> Certificate:
    """Integrals of tanh in V: a rate and a gain, about every operating point."""
    return solved(_tanh_sketch(densities=(0, 1)))


def plant() -> Certificate:
    """Every plant within .25 |x - x*| of the model in each state, and .125 more."""
    deviation = {
        "columns": [[[0, [1, 0]]], [[1, [1, 0]]]], "C": [[[0, [1, -2]]], [[1, [1, -2]]]], "s": [0, 0],
        "epsilon": [1, -3],
    }  # fmt: skip
    return solved(_tanh_sketch(densities=(0, 1), deviations=[deviation]))


def outputs() -> Certificate:
    """The size of 2 x1 - x2 + u, and a saturated sensor of x1."""
    content = solved(_tanh_sketch(densities=(0,)))
    return seeing(content, size=([2, -1], [1], "abs(x)"), sensor=([1, 0], [0], "2*sat(x)"))


def region() -> Certificate:
    """A pendulum with |x1| <= 2 alone: the strip of one row, unbounded in x2."""
    content = as_ledger(named.load("r_pendulum"))
    content["strips"] = []
    return with_proof(content)


def ball() -> Certificate:
    """About the ball of an equilibrium, each curve with the ball of its own centres in place of any."""
    content = as_ledger(named.load("g_ball"))
    ledger = read_ledger(content)
    for p, one in enumerate(ledger.points):
        content["curves"][one.curve]["shift"] = [number(part) for part in ledger.centre(p)]
    return content


def practical() -> Certificate:
    """A damped double well, x1' = x2, x2' = x1 - x1^3 - x2 + u: every solution ends near the wells; a row is zero."""
    model = model_object([("x**3", [[1, 0]], [[0], [-1]])], [[0, 1], [1, -1]], [[0], [1]], n=2)
    wells = {"offset": Fraction(9, 8), "upper": (Fraction(1, 4), 0)}  # y^4/4 - y^2 >= -1
    forms = curve(
        [("x**3", 1)], ((1, 0), "nondecreasing"), ((-2, 1), "offset", wells), products=[(0, 1, Fraction(65, 64))]
    )  # (y^2 - 1)^2 >= 0
    kappa, P12 = Fraction(1, 16), Fraction(1, 8)
    sketch = Sketch(model, [forms], [point(0, {0: 1}, [0], [1])], [("constant", 0, 0)], "practical", kappa)
    content = draft(sketch)
    content["P"] = {"lower": [[number(1 + P12)], [number(P12), [1, 0]]]}
    content["points"][0]["densities"] = [[1, [1, 0]]]
    content["facts"]["constant"][0][2] = number(P12 - kappa / 4)
    content |= {"dropped": [2], "gamma": [16, 0], "p": [1, -1]}
    return with_proof(content)


def below() -> Certificate:
    """A point at rest beside x_ref, V = x^2 + int (x + 1) with V < 0 there: (y + 1 - y)^2 >= 1 is a supply below 0."""
    model = model_object([("x+1", [[1]], [[-1.0]])], [[-2.0]], [[1.0]])
    offset = {"offset": Fraction(33, 64), "upper": (1, 0)}
    forms = curve([("x+1", 1)], ((-1, 1), "one-signed"), ((0, 1), "offset", offset), products=[(0, 0, -1)])
    content = draft(Sketch(model, [forms], [point(0, {0: 1}, [0], [1])], [("constant", 0, 0)], "practical", 0.5))
    content["P"] = {"lower": [[[1, 0]]]}
    content["points"][0]["densities"] = [[1, [1, -1]]]
    content["facts"]["constant"][0][2] = [1, -6]
    content |= {"gamma": [64, 0], "p": [127, -7]}
    return with_proof(content)


TABLE = "pwl(x; -1.5: -2.25, -0.5: -0.25, 0: 0, 0.5: 0, 1.25: 0.75, 2: 0.75)"  # slopes 2, 1/2, 0, 1, 0


def lookup() -> Certificate:
    """Two tanks whose outflow is a table: steep on one side, at rest about 0, and flat far out."""
    model = model_object([(TABLE, None, [[-1, 0], [1, -1]])], [[-0.5, 0], [0, -0.5]], [[1], [0]], n=2)
    forms = curve([(TABLE, 1)], ((0, 1), "nondecreasing", {"upper": (1, 0)}), ((2, -1), "nondecreasing"))
    points = [point(0, {i: 1}, [i], [0]) for i in range(2)]
    facts = [("value", i, 0, 1) for i in range(2)]
    return solved(Sketch(model, [forms], points, facts, "rate-and-gain", Fraction(1, 8)))


def mirrored() -> Certificate:
    """x' = -2 x + 1.9 (relu(x) - relu(-x)) + u, that is -x/10 + u: relu(-y) stands beside relu(y), its factor -1."""
    terms = [("relu(x)", [[1]], [[1.9]]), ("relu(x)", [[-1]], [[-1.9]])]
    ones = [(1, 0, 0), (0, 1, 0), (1, -1, 0), (0, 0, -1), (1, 0, 1), (1, -1, 1), (-1, 1, -1)]
    forms = curve([("relu(x)", 1), ("relu(x)", -1)], *((form, "nondecreasing") for form in ones))
    pairs = [(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (3, 4), (5, 6)]
    facts = [("value", 0, k, j) for k, j in pairs]
    sketch = Sketch(model_object(terms, [[-2]], [[1]], n=1), [forms], [point(0, {0: 1}, [0, 1], [])], facts)
    return solved(replace(sketch, claim="rate-and-gain", kappa=Fraction(1, 16)))


def lure(f: str = "tanh(x)", **more: Any) -> Sketch:
    """A plant in a loop with a function of slopes 0 to 2: integrals and products prove it up to 1.76."""
    A0, row = [[-2.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [2.0, -0.4, -0.2]
    model = model_object([(f, [row], [[-1.0], [0.0], [0.0]])], A0, [[1.0], [0.0], [0.0]], n=3)
    bounds = [{"upper": (1, 0), "lower": (1, j)} for j in (1, 0)]
    rising = [((0, 1), "nondecreasing", bounds[0]), ((1, -1), "nondecreasing", bounds[1])]
    points = [point(0, dict(enumerate(row)), [0], [0, 1])]
    return Sketch(
        model, [curve([(f, 1)], *rising)], points, [("value", 0, 0, 1), ("slope", 0, 0, 1)], inside=(0,), **more
    )


def slopes() -> Certificate:
    """Slopes along the solution, and the function's value in V."""
    return solved(lure())


def slopes_of_kinks() -> Certificate:
    """The same for a saturation, whose slope jumps, with a rate and a gain."""
    return solved(lure("sat(x)", claim="rate-and-gain", kappa=Fraction(1, 256)))


OWN: dict[str, Callable[[], Certificate]] = {
    made.__name__: made
    for made in (
        spring, difference, one_signed, incremental, rated, plant, outputs, region, ball, practical, below,
        lookup, mirrored, slopes, slopes_of_kinks, *known_steps.MAKERS,
    )
} | {f"identity_{name}": made for name, made in identities.MAKERS.items()}  # fmt: skip
TRANSLATED = tuple(name for name in named.MAKERS if name[:2] in ("g_", "m_", "e_", "r_"))


@cache
def _load(name: str) -> Certificate:
    return OWN[name]() if name in OWN else as_ledger(named.load(name))


def load(name: str) -> Certificate:
    """A good ledger, by name; not to be changed in place."""
    return _load(name)


NAMES = (*OWN, *TRANSLATED)
