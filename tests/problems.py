"""Named models with the verdict that is expected of `certify`, and the reason why it is the truth.

"certified" and "refuted" are facts that must come out; "undecided" means that neither may come out: the truth lies
outside what the certificates can say, or the model is a temptation for a looser rule.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from persid.models.model import PersidskiiModel

Expected = Literal["certified", "refuted", "undecided"]


@dataclass(frozen=True)
class Problem:
    """One named model: arguments of PersidskiiModel, the verdict to expect, and one sentence that says why."""

    name: str
    verdict: Expected
    why: str
    model: dict[str, Any] = field(repr=False)

    def build(self) -> PersidskiiModel:
        """Return the model."""
        return PersidskiiModel(**self.model)


def _scalar(name: str, verdict: Expected, why: str, a: float = 0.0, B: float = 1.0, **terms: float) -> Problem:
    """x' = a x + sum coefficient f(x) + B u, functions named by their keys in _NAMES."""
    parts = [(_NAMES[key], None, [[value]]) for key, value in terms.items()]
    return Problem(name, verdict, why, {"A0": [[a]], "terms": parts, "B": [[B]]})


_NAMES = {
    "sinh": "sinh(x)",
    "tanh": "tanh(x)",
    "cube": "x**3",
    "square": "x*abs(x)",
    "fifth": "x**5",
    "arctan": "arctan(x)",
    "erf": "erf(x)",
    "softsign": "softsign(x)",
    "arcsinh": "arcsinh(x)",
    "deadzone": "deadzone(x)",
    "sat": "sat(x)",
    "relu": "relu(x)",
    "expm1": "expm1(x)",
    "sin": "sin(x)",
    "shifted_cube": "(x+1)**3-1",
    "folded": "x**3-3*x**2+2.5*x",
    "wide_sinh": "sinh(x/10)",
}


def _planar(name: str, verdict: Expected, why: str, A0: Any, *terms: Any, B: Any = ((1.0,), (1.0,))) -> Problem:
    return Problem(name, verdict, why, {"A0": A0, "terms": list(terms), "B": B})


_I = np.eye(2)
_ROTATION = [[-1.0, 5.0], [-5.0, -1.0]]

PROBLEMS = (
    # stable scalar models
    _scalar("linear", "certified", "V = x^2 decays.", a=-1.0),
    _scalar("slow linear", "certified", "However slow, V = x^2 decays.", a=-1e-6),
    _scalar("sinh against tanh", "certified", "sinh x >= x >= tanh x, so x' x <= -sinh(x) x.", sinh=-3.0, tanh=2.0),
    _scalar("sinh against x", "certified", "sinh x >= x for x > 0: 3 sinh x outweighs 2 x.", a=2.0, sinh=-3.0),
    _scalar("x against tanh", "certified", "x >= tanh x for x > 0.", a=-1.0, tanh=0.9),
    _scalar("cube against tanh", "certified", "x + x^3 outweighs 0.5 tanh x.", a=-1.0, cube=-1.0, tanh=0.5),
    _scalar("sinh against cube", "certified", "sinh x >= x^3 / 6, and 0.1 < 1/6.", sinh=-1.0, cube=0.1),
    _scalar("arctan helps", "certified", "Both parts pull to 0 and -x has no bound.", a=-1.0, arctan=-1.0),
    _scalar("softsign against x", "certified", "|softsign x| <= |x|.", a=-1.0, softsign=0.5),
    _scalar("erf against x", "certified", "erf x <= 1.1284 x, and 0.8 * 1.1284 < 1.", a=-1.0, erf=0.8),
    _scalar("fifth power", "certified", "-x - x^5 decays.", a=-1.0, fifth=-1.0),
    _scalar("signed square", "certified", "x |x| is a sector function.", a=-1.0, square=-1.0),
    _scalar("dead zone helps", "certified", "-x decays, and the dead zone pulls the same way.", a=-1.0, deadzone=-1.0),
    _scalar("saturation against x", "certified", "|sat x| <= |x|.", a=-1.0, sat=0.5),
    _scalar("relu against x", "certified", "relu x <= x for x > 0 and 0 below.", a=-1.0, relu=0.5),
    _scalar("expm1 helps", "certified", "expm1 has the sign of x.", a=-1.0, expm1=-1.0),
    _scalar("shifted cube", "certified", "(x+1)^3 - 1 has the sign of x.", a=-1.0, shifted_cube=-1.0),
    _scalar(
        "sinh alone",
        "certified",
        "sinh has no bound: V = 2 (cosh x - 1) is an ISS function.",
        sinh=-1.0,
    ),
    _scalar("cube alone", "certified", "V = x^4 / 2 grows without bound, and V' <= -x^6 + x^3 u.", cube=-1.0),
    _scalar("sinh against more cube", "certified", "sinh x >= 0.371 x^3, and 0.36 is less.", sinh=-1.0, cube=0.36),
    _scalar(
        "three equilibria elsewhere",
        "certified",
        "x^3 - 3 x^2 + 2.5 x has the sign of x, whatever happens at u = 0.55.",
        a=-1e-3,
        folded=-1.0,
    ),
    # stable planar models
    _planar("rotation", "certified", "The symmetric part of A0 is -I.", _ROTATION),
    _planar("nonnormal", "certified", "Hurwitz, though x1 alone grows: needs a full P.", [[1.0, -3.0], [2.0, -2.0]]),
    _planar("damped tanh", "certified", "x1' and x2' are diagonally dominated.", -2 * _I, ("tanh(x)", None, 0.5 * _I)),
    _planar(
        "skew cubes",
        "certified",
        "The coupling of the cubes is skew: V = sum x_i^4 + x_i^2.",
        -_I,
        ("x**3", None, [[-1.0, 2.0], [-2.0, -1.0]]),
    ),
    _planar(
        "pendulum with friction",
        "certified",
        "Small gain of sin-like tanh in a damped loop.",
        [[0.0, 1.0], [-4.0, -3.0]],
        ("tanh(x)", [[1.0, 0.0]], [[0.0], [0.5]]),
    ),
    _planar(
        "difference row",
        "certified",
        "x1 - x2 enters through a cube that pulls both together.",
        -_I,
        ("x**3", [[1.0, -1.0]], [[-1.0], [1.0]]),
    ),
    _planar(
        "row of negative sign",
        "certified",
        "tanh(-x1) = -tanh x1, helped by -2 x1.",
        -2 * _I,
        ("tanh(x)", [[-1.0, 0.0]], [[0.5], [0.0]]),
    ),
    _planar("chain", "certified", "A stable state drives a stable state.", [[-1.0, 0.0], [5.0, -1.0]]),
    _planar("no input", "certified", "With B = 0 stability of a Hurwitz matrix is enough.", -_I, B=((0.0,), (0.0,))),
    _planar(
        "duplicate functions",
        "certified",
        "Two terms with one function are their sum, -x^3.",
        -_I,
        ("x**3", None, -2 * _I),
        ("x**3", None, 1.0 * _I),
    ),
    # unstable
    _scalar("unstable linear", "refuted", "The origin is exponentially unstable.", a=1.0),
    _scalar("bistable tanh", "refuted", "The origin is unstable and two equilibria lie beside it.", a=-1.0, tanh=2.0),
    _scalar("cube upward", "refuted", "x^3 carries x to infinity from x = 1.", a=-0.5, cube=1.0),
    _scalar("double well", "refuted", "x - x^3 has an unstable origin.", a=1.0, cube=-1.0),
    _scalar("saturated", "refuted", "A constant input of 2 drives x to infinity.", tanh=-1.0),
    _scalar("saturated arctan", "refuted", "A constant input of 4 > pi drives x to infinity.", arctan=-2.0),
    _scalar("saturated dead input", "refuted", "sat is bounded: u = 2 drives x to infinity.", sat=-1.0),
    _planar("saddle", "refuted", "One eigenvalue is positive.", [[1.0, 0.0], [0.0, -1.0]]),
    _planar("unstable spiral", "refuted", "The spiral turns outward.", [[0.1, 1.0], [-1.0, 0.1]]),
    _planar(
        "cooperative bistable",
        "refuted",
        "Loop gain above 1 makes a second, positive equilibrium.",
        -_I,
        ("tanh(x)", None, [[0.0, 1.5], [1.5, 0.0]]),
    ),
    # false in ways that a looser rule would not notice
    _scalar("absent row dropped", "refuted", "x' = x + u: a sinh with coefficient 0 changes nothing.", a=1.0, sinh=0.0),
    _scalar("absent tanh", "refuted", "x' = x + 0 tanh(x) + u is unstable.", a=1.0, tanh=0.0),
    _scalar("rows not normalised", "refuted", "2 x - 10 sinh(x / 10) has slope 1 at 0.", a=2.0, wide_sinh=-10.0),
    _scalar(
        "wrong lemma constant",
        "refuted",
        "sinh x < 0.3712 x^3 at x = 2.985, hence more equilibria.",
        sinh=-1.0,
        cube=0.3712,
    ),
    Problem(
        "folded with a bias",
        "refuted",
        "At the constant 0.55 there are three equilibria.",
        {"A0": [[0.0]], "terms": [("x**3-3*x**2+2.5*x", None, [[-1.0]])], "B": [[1.0]], "b": [0.55]},
    ),
    Problem(
        "products of different rows",
        "refuted",
        "At the constant (3, 3) the equilibrium (1, 1) is unstable.",
        {"A0": -_I, "terms": [("relu(x)", None, [[0.0, -2.0], [-2.0, 0.0]])], "B": _I, "b": [3.0, 3.0]},
    ),
    _scalar("dead zone alone", "refuted", "All of [-1, 1] is at rest at u = 0.", deadzone=-1.0),
    _scalar("integrator", "refuted", "x' = 0 is at rest everywhere.", a=0.0, B=0.0, cube=0.0),
    # true or false, but beyond these certificates
    _scalar(
        "lemma constant too close",
        "undecided",
        "Stable by 5e-5 of sinh x; the forms are relaxed by more.",
        sinh=-1.0,
        cube=0.371,
    ),
    _planar(
        "tanh of a sum with B = 0",
        "undecided",
        "The origin attracts, but no ISS function of this family exists and no input reaches the state.",
        [[0.0, 1.0], [0.0, 0.0]],
        ("tanh(x)", None, [[0.0, 0.0], [-1.0, -1.0]]),
        B=((0.0,), (0.0,)),
    ),
)
BY_NAME = {problem.name: problem for problem in PROBLEMS}
