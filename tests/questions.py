"""Questions about named models: operating points, inputs and regions; and models whose rate and gain are measured."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

TRAFFIC: dict[str, Any] = {
    "A0": [[-0.1, 0.05], [0.05, -0.15]],
    "terms": [("sin(x)", [[1.0, 0.0]], [[1.0], [0.0]]), ("cos(x)", [[0.0, 1.0]], [[0.0], [1.0]])],
    "B": [[0.5], [0.3]],
}
PENDULUM: dict[str, Any] = {
    "A0": [[0.0, 1.0], [0.0, -0.5]],
    "terms": [("sin(x)", [[1.0, 0.0]], [[0.0], [-1.0]])],
    "B": [[0.0], [1.0]],
}


@dataclass(frozen=True)
class Case:
    """A question about a named model, with the verdict that is expected and why."""

    name: str
    expected: str
    why: str
    model: dict[str, Any] = field(repr=False)
    question: dict[str, Any] = field(default_factory=dict)


def _one(terms: dict[str, float], a: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"A0": [[a]], "terms": [(f, None, [[c]]) for f, c in terms.items()], "B": [[1.0]]} | more


ASKED = (
    Case("constant force, named state 1", "certified", "The equilibrium of x' = -x + 2 is 2, whatever state is named.",
         _one({}, -1.0, b=[2.0]), {"operating_point": [1.0]}),
    Case("folded curve at u = 0", "certified", "Other inputs have three equilibria; u = 0 has one.",
         _one({"x**3-3*x**2": -1.0}, -2.5)),
    Case("folded curve at u = 0.55", "refuted", "At u = 0.55 it rests at three points.",
         _one({"x**3-3*x**2": -1.0}, -2.5), {"u_op": [0.55]}),
    Case("folded curve at u = 0.3", "certified", "u = 0.3 lies below the fold at 0.363: one equilibrium.",
         _one({"x**3-3*x**2": -1.0}, -2.5), {"u_op": [0.3]}),
    Case("cube at u = 1", "certified", "x' = -x - x^3 + u about its equilibrium for u = 1.",
         _one({"x**3": -1.0}, -1.0), {"u_op": [1.0]}),
    Case("exponential with a bias", "certified", "x' = 1 - e^x - x + u, at rest at 0.", _one({"expm1(x)": -1.0}, -1.0)),
    Case("saturated spring at u = 2", "refuted", "x' = -tanh x + u has no equilibrium at u = 2.",
         _one({"tanh(x)": -1.0}), {"u_op": [2.0]}),
    Case("pendulum", "refuted", "It rests at every multiple of pi.", PENDULUM),
    Case("pendulum, |x1| <= 2", "certified", "Damped, and energy bounds it.", PENDULUM,
         {"domain": [[-2.0, 2.0], [-6.0, 6.0]]}),
    Case("pendulum, |x1| <= 3.1", "certified", "Damped, and energy bounds it up to pi.", PENDULUM,
         {"domain": [[-3.1, 3.1], [-6.0, 6.0]]}),
    Case("pendulum, |x1| <= 3.3", "undecided", "The box holds the upright equilibria.", PENDULUM,
         {"domain": [[-3.3, 3.3], [-6.0, 6.0]]}),
    Case("pendulum upright", "undecided", "Unstable there, and a region says nothing about other points.", PENDULUM,
         {"operating_point": [3.1, 0.0], "domain": [[2.0, 4.0], [-1.0, 1.0]]}),
    Case("double well", "refuted", "It rests at -1, 0 and 1.", _one({"x**3": -1.0}, 1.0)),
    Case("double well, right half", "certified", "x = 1 attracts (0, 2).", _one({"x**3": -1.0}, 1.0),
         {"domain": [[0.2, 1.8]], "operating_point": [1.0]}),
    Case("x - x^3 the other way", "certified", "x' = -x + x^3 decays for |x| < 1.", _one({"x**3": 1.0}, -1.0),
         {"domain": [[-0.95, 0.95]]}),
    Case("traffic", "refuted", "It has dozens of equilibria at u = 0.", TRAFFIC),
    Case("traffic near (2.92, 1.49)", "certified", "That equilibrium attracts a neighbourhood.", TRAFFIC,
         {"operating_point": [2.922, 1.493], "domain": [[1.9, 4.2], [0.4, 2.9]]}),
    Case("tanh of each state, B = 0", "undecided", "Not ISS in this family; w'B = 0 refutes nothing.",
         {"A0": [[0.0, 1.0], [0.0, 0.0]],
          "terms": [("tanh(x)", [[1.0, 0.0]], [[0.0], [-1.0]]), ("tanh(x)", [[0.0, 1.0]], [[0.0], [-1.0]])],
          "B": [[0.0], [0.0]]}),
    Case("dead zone at u = 0.5", "certified", "From 1.5 the dead zone is far: y f(y) >= 0.2 y^2, so there it is ISS.",
         _one({"deadzone(x)": -1.0}), {"u_op": [0.5]}),
    Case("cross relu at (0, 0)", "certified", "relu(x1) relu(x2) >= 0 proves it; unstable at u = (3, 3) only.",
         {"A0": -np.eye(2), "terms": [("relu(x)", None, [[0.0, -2.0], [-2.0, 0.0]])], "B": np.eye(2)}),
)  # fmt: skip


SHARP: dict[str, dict[str, Any]] = {
    "linear": _one({}, -1.0),
    "sinh against tanh": _one({"sinh(x)": -3.0, "tanh(x)": 2.0}),
    "cube and line": _one({"x**3": -1.0}, -1.0),
    "two states, diagonal": {"A0": [[-1.0, 0.5], [-0.5, -1.0]], "terms": [("tanh(x)", None, -0.5 * np.eye(2))],
                             "B": [[1.0], [0.5]]},
    "two states, cubes": {"A0": [[-1.0, 0.3], [0.2, -1.0]], "terms": [("x**3", None, -0.5 * np.eye(2))],
                          "B": [[1.0], [0.0]]},
    "two states, sinh and tanh": {"A0": [[-0.5, 0.4], [-0.4, -0.5]],
                                  "terms": [("sinh(x)", None, -0.5 * np.eye(2)), ("tanh(x)", None, 0.2 * np.eye(2))],
                                  "B": np.eye(2)},
    "oscillator": {"A0": [[0.0, 1.0], [-1.0, -1.0]], "terms": [("tanh(x)", [[1.0, 0.0]], [[0.0], [-0.5]])],
                   "B": [[0.0], [1.0]]},
    "constant force": {"A0": [[-1.0, 0.5], [0.0, -1.0]], "terms": [("x**3", None, -0.2 * np.eye(2))],
                       "B": [[1.0], [1.0]], "b": [1.0, -0.5]},
}  # fmt: skip

SEVERAL_INPUTS: dict[str, dict[str, Any]] = {
    "one state, two inputs": _one({"tanh(x)": -1.0}, -1.0) | {"B": [[1.0, 1.0]]},
    "inputs of different units": {"A0": [[-1.0, 0.3], [-0.4, -1.2]],
                                  "terms": [("x**3", None, [[-0.5, 0.1], [0.2, -0.6]]),
                                            ("tanh(x)", None, [[-0.2, 0.1], [0.1, -0.3]])],
                                  "B": [[1.0, 0.002], [0.3, 0.005]]},
    "an input a state": {"A0": [[-0.5, 0.4], [-0.4, -2.0]],
                         "terms": [("sinh(x)", None, -0.5 * np.eye(2)), ("tanh(x)", None, 0.2 * np.eye(2))],
                         "B": np.eye(2)},
    "oscillator, force and drift": {"A0": [[0.0, 1.0], [-1.0, -1.0]],
                                    "terms": [("tanh(x)", [[1.0, 0.0]], [[0.0], [-0.5]])],
                                    "B": [[0.0, 0.1], [1.0, 0.0]]},
}  # fmt: skip
