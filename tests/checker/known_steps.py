"""Ledgers of models in discrete time that must be accepted, each with the reason why it is true."""

from fractions import Fraction
from typing import Any

import numpy as np

from checker.ledgers import Sketch, curve, draft, model_object, number, point, seeing, solved
from checker.sampled import number as sampled
from persid.certificates.ledger import floats, with_proof
from persid.lyapunov.operating_points import proved_radius
from persid_check import canonical_model, model_sha256
from persid_check.ledger.assembly import assemble
from persid_check.ledger.file import read_ledger
from persid_check.model import model_of

Certificate = dict[str, Any]
TANH = [("tanh(x)", 1)]
_W = [[0.0, 0.5, -0.3], [-0.4, 0.0, 0.45], [0.35, -0.5, 0.0]]


def steps_model(*parts: Any, **more: Any) -> dict[str, Any]:
    """A model.json object of x+ - x_ref = A0 (x - x_ref) + ..., one step in an eighth of a second."""
    return model_object(*parts, **more) | {"time": "discrete", "dt": 0.125}


def _network(claim: str = "rate-and-gain", kappa: Any = Fraction(1, 8), **more: Any) -> Sketch:
    model = steps_model([("tanh(x)", None, _W)], (0.4 * np.eye(3)).tolist(), n=3)
    forms = curve(TANH, ((0, 1), "nondecreasing"), ((1, -1), "nondecreasing"))
    points = [point(0, {i: 1}, [i], []) for i in range(3)]
    return Sketch(model, [forms], points, [("value", i, 0, 1) for i in range(3)], claim, kappa, True, more)


def steps_network() -> Certificate:
    """A small network of tanh neurons contracts: any two solutions come together."""
    return solved(_network(), ratio=1e3)


def steps_iss() -> Certificate:
    """The same without a rate, with products of differences and of sums."""
    sketch = _network("iss", 0)
    sketch.facts += [("difference", i, j, sign, 0, 1) for i in range(3) for j in range(i) for sign in (-1, 1)]
    return solved(sketch, ratio=1e3)


def steps_plant() -> Certificate:
    """Every plant within |x - x*| / 32 of the model in each step, and .125 more."""
    columns, C = ([[[i, [1, e]]] for i in range(3)] for e in (0, -5))
    deviation = {"columns": columns, "C": C, "s": [0, 0], "epsilon": [1, -3]}
    return solved(_network(kappa=Fraction(1, 32), deviations=[deviation]), ratio=1e3)


def steps_outputs() -> Certificate:
    """An output x1 - x3 / 2 + u / 4 in its own unit."""
    return seeing(steps_network(), level=([1, 0, -0.5], [0.25]))


def steps_ball() -> Certificate:
    """About the fixed point of x+ = x/2 + tanh(x)/4 + u for u = 1, which nobody can write down."""
    model = steps_model([("tanh(x)", None, [[0.25]])], [[0.5]])
    x = 2.4
    for _ in range(60):
        x = 0.5 * x + 0.25 * np.tanh(x) + 1
    radius = proved_radius(model_of(canonical_model(model), discrete=True), [Fraction(x)], [Fraction(1)])
    forms = curve(TANH, ((0, 1), "nondecreasing"), ((1, -1), "nondecreasing"), shift="any")
    at = {"operating_point": {"x": [number(x)], "radius": number(radius or 0), "u": [[1, 0]]}}
    sketch = Sketch(model, [forms], [point(0, {0: 1}, [0], [])], [("value", 0, 0, 1)], "rate-and-gain", 0.25)
    sketch.more = at
    return solved(sketch)


def steps_region() -> Certificate:
    """x1+ = x1/2 + x2/4 + x1^2/4, x2+ = x2/2 - x1/4 + u: where |x1| <= 1 the square is no larger than x1."""
    model = steps_model([("x**2", [[1, 0]], [[0.25], [0.0]])], [[0.5, 0.25], [-0.25, 0.5]], [[0.0], [1.0]], n=2)
    square = curve([("x**2", 1)], ((1, 1), "sector"), ((1, -1), "sector"), domain=(-1, 1))
    sketch = Sketch(model, [square], [point(0, {0: 1}, [0], [])], [("value", 0, 0, 1)], "region", 0.25)
    content = solved(sketch, ratio=100)
    P = np.zeros((2, 2))
    for i, row in enumerate(content["P"]["lower"]):
        P[i, : i + 1] = [float(Fraction(m) * Fraction(2) ** e) for m, e in row]
    P = P + np.tril(P, -1).T
    level = Fraction(round(0.98 / np.linalg.inv(P)[0, 0] * 2**20), 2**20)
    gamma = Fraction(content["gamma"][0]) * Fraction(2) ** content["gamma"][1]
    bound = Fraction(int(0.99 * float(0.25 * level / gamma) ** 0.5 * 2**20), 2**20)
    content |= {"level": number(level), "input_bound": number(bound)}
    content["strips"] = [[[[1, [1, 0]]], [-64, 0], [64, 0]]]
    return with_proof(content)


def steps_practical() -> Certificate:
    """x+ = x/2 + 2 tanh(x) + u has three fixed points; tanh (y/8 - tanh) >= -1, so every solution ends near them."""
    model = steps_model([("tanh(x)", None, [[2.0]])], [[0.5]])
    eighth = {"offset": 8}  # y^2/16 - log cosh y >= -8
    forms = curve(TANH, ((0, 1), "nondecreasing"), ((Fraction(1, 8), -1), "offset", eighth), products=[(0, 1, 1)])
    sketch = Sketch(model, [forms], [point(0, {0: 1}, [0], [])], [("constant", 0, 0)], "practical", Fraction(1, 16))
    content = draft(sketch)
    content["P"] = {"lower": [[[1, 0]]]}
    content["facts"]["constant"][0][2] = [4, 0]  # 2 tau = 8 times the product
    return with_proof(content | {"gamma": [64, 0], "p": [1, -1]})


def loop(f: str = "tanh(x)", k: float = 8.0, **more: Any) -> Sketch:
    """The plant .1 z/(z^2 - 1.8 z + .81) in a loop with k f: its quadratic V ends at k = .7, its linear limit is 36."""
    A0, row = [[1.8, -0.81], [1.0, 0.0]], {0: Fraction(k) / 8}
    model = steps_model([(f, [[k / 8, 0.0]], [[-0.8], [0.0]])], A0, [[1.0], [0.0]], n=2)
    bounds = [{"upper": (1, 0), "lower": (1, j)} for j in (1, 0)]
    forms = curve([(f, 1)], ((0, 1), "nondecreasing", bounds[0]), ((1, -1), "nondecreasing", bounds[1]))
    facts = [("value", 0, 0, 1), *(("step", 0, 0, sign, 0, 1) for sign in (-1, 0, 1))]
    return Sketch(model, [forms], [point(0, row, [0], [0, 1])], facts, inside=(0,), **more)


def steps_values() -> Certificate:
    """The function's value and its integral in V, and facts about a step."""
    return solved(loop())


def steps_values_of_kinks() -> Certificate:
    """The same for a saturation, with a rate and a gain."""
    return solved(loop("sat(x)", 4.0, claim="rate-and-gain", kappa=Fraction(1, 128)))


def steps_values_apart() -> Certificate:
    """Two neurons that feed each other: sums and differences of one after a step and the other before it."""
    model = steps_model([("tanh(x)", None, [[0.25, 0.5], [-0.5, 0.25]])], [[0.25, 0], [0, 0.25]], n=2)
    forms = curve(TANH, ((0, 1), "nondecreasing", {"upper": (1, 0)}), ((1, -1), "nondecreasing", {"upper": (1, 0)}))
    points = [point(0, {i: 1}, [i], [0, 1]) for i in range(2)]
    facts = [("step", p, q, sign, 0, 1) for p in range(2) for q in range(2) for sign in (-1, 1)]
    facts += [("value", p, 0, 1) for p in range(2)] + [("step", p, p, 0, 0, 1) for p in range(2)]
    return solved(Sketch(model, [forms], points, facts, "rate-and-gain", Fraction(1, 16), inside=(0, 1)))


def steps_values_region() -> Certificate:
    """A cube in the loop, on a strip where its slopes are those of the saturation: V reads it, and its integral."""
    sketch = loop("x**3/3", 2.0, claim="region", kappa=Fraction(1, 256))
    given = [
        (form, kind, {"upper": (1, 0), "lower": (1, j)})
        for form, kind, j in (((0, 1), "nondecreasing", 1), ((1, -1), "nondecreasing", 0))
    ]
    sketch.curves = [curve([("x**3/3", 1)], *given, domain=(-1, 1))]
    content = solved(sketch)
    return with_proof(content | bounds_of_region(content))


def bounds_of_region(content: Certificate) -> Certificate:
    """The level that just keeps off the strips of the points, and the inputs that it admits."""
    matrices = assemble(read_ledger(content))
    inverse, gamma, kappa = np.linalg.inv(floats(matrices.Pt)), *(sampled(content[k]) for k in ("gamma", "kappa"))
    levels = []
    for each in content["points"]:
        row = np.zeros(len(inverse))
        row[[i for i, _ in each["row"]]] = [sampled(v) for _, v in each["row"]]
        levels.append(sampled(content["curves"][each["curve"]]["domain"][1]) ** 2 / float(row @ inverse @ row))
    level = Fraction(int(0.98 * min(levels) * 2**40), 2**40)
    bound = Fraction(int(0.99 * (kappa * float(level) / gamma) ** 0.5 * 2**40), 2**40)
    return {"level": number(level), "input_bound": number(bound)}


def as_steps(content: Certificate, dt: float = 0.5) -> Certificate:
    """The same file about the same numbers read in discrete time."""
    model = content["model"] | {"time": "discrete", "dt": dt.hex()}
    return content | {"model": model, "model_sha256": model_sha256(model)}


MAKERS = (
    steps_network, steps_iss, steps_plant, steps_outputs, steps_ball, steps_region, steps_practical, steps_values,
    steps_values_of_kinks, steps_values_apart, steps_values_region,
)  # fmt: skip
