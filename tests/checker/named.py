"""Named valid certificates, with why each is true; `python -m checker.named`, in tests/, writes files/valid."""

import json
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from checker.maker import Wanted, dyadic, file, make, model
from persid.lyapunov.operating_points import proved_radius
from persid_check import canonical_model
from persid_check.model import model_of
from places import VALID

Certificate = dict[str, Any]

X, F1, F2 = (1, 0, 0), (0, 1, 0), (0, 0, 1)
DECAY = model([("tanh(x)", None, [[-1]])], [[-1]])
MIXED = model(
    [("x**3", None, [[-1, 0.25], [0, -0.5]]), ("tanh(x)", None, [[0.5, 1], [-1, 0.25]])],
    [[-2, 0.5], [-0.25, -1.5]],
    [[1, 0], [0, 0.5]],
    n=2,
)
CUBE = model([("x**3", None, [[-1, 0.5], [-0.5, -1]])], None, [[1], [0.5]], n=2)
ROWS = model(
    [("tanh(x)", [[1, -1], [2, -2], [1, 1]], [[-0.5, 0.0, -0.25], [0.5, 0.0, -0.25]])], [[-1, 0], [0, -1]], n=2
)
PENDULUM = model([("sin(x)", [[1, 0]], [[0], [-1]])], [[0, 1], [0, -0.5]], [[0], [1]], n=2)
BISTABLE = model([("tanh(x)", None, [[2]])], [[-1]])
NONNORMAL = model([("tanh(x)", None, [[0.0625, 0], [0, 0.0625]])], [[-1, 3], [0, -1]], [[1], [1]], n=2)
OFFSET = model([("x**3", None, [[-1]])], [[-1]], b=[2.0])


def _linear() -> Certificate:
    """x' = -x + u, by hand: V = x^2."""
    return file(
        model([], [[-1]]), "G", operating_point=None, P={"diagonal": [[1, 0]]}, groups=[], dropped=[], gamma=[2, 0],
        proof={"P": [[1]], "Q": [[1], [1, 2]]},
    )  # fmt: skip


def _pair() -> Certificate:
    """A mixed-sign pair with cubes and tanh: V with P diagonal, forms e_j and x - tanh."""
    forms = [X, F1, F2, (1, 0, -1)]
    return make(Wanted(MIXED, [forms, forms]))


def _cubes() -> Certificate:
    """x' = A x^3 + B u without linear part: claim M, both states dropped."""
    forms = [(0, 1)]
    return make(Wanted(CUBE, [forms, forms], "M", dropped=(0, 1)))


def _rated() -> Certificate:
    """The mixed pair with rate and gain."""
    forms, c = [X, F1, F2, (1, 0, -1)], [Fraction(1, 2), Fraction(1, 4), 1, 1]
    return make(Wanted(MIXED, [forms, forms], "E", c=[c, c], kappa=Fraction(1, 2)))


def _gains() -> Certificate:
    """x' = -x + u1 + u2: V = x^2, V' <= -V + (u1 + u2)^2, with Gamma just above [[1, 1], [1, 1]]."""
    return file(
        model([], [[-1]], [[1, 1]]), "E", operating_point=None, P={"diagonal": [[1, 0]]}, groups=[], dropped=[],
        gamma={"lower": [[[33, -5]], [[1, 0], [33, -5]]]}, kappa=[1, 0], p=[7, -3],
        proof={"P": [[1]], "Q": [[1], [1, 1], [4, 0, 4]]},
    )  # fmt: skip


def _gains_in_a_region() -> Certificate:
    """The same model in |x| <= 1, with inputs that Gamma admits one by one."""
    return {**_gains(), "claim": "R", "box": [[[-1, 0], [1, 0]]], "level": [15, -4], "input_bound": [5, -3]} | {
        "operating_point": {"x": [[0, 0]], "radius": [0, 0], "u": [[0, 0], [0, 0]]}
    }


def _rows() -> Certificate:
    """General rows with two channels in one group, at alpha 1 and 2; the channel of column zero is dropped."""
    return make(Wanted(ROWS, [[X, F1], [(1, 0), (0, 1)]], dropped=(3,)))


def _pendulum() -> Certificate:
    """The damped pendulum on |r| <= 2, |x2| <= 3, regional; sin is a sector function on |y| <= 2."""
    forms = [(1, 0), (0, 1), (1, -1), (Fraction(-7, 16), 1)]
    c, d = [Fraction(1, 2), Fraction(13, 16), Fraction(1, 2), 12], [1, Fraction(5, 8), 0, 0]
    box = [(-2, 2), (-3, 3)]
    return make(Wanted(PENDULUM, [forms], "R", c=[c], d=[d], kappa=Fraction(1, 16), box=box, full=True))


def _full() -> Certificate:
    """A nonnormal A0 with a full P."""
    return make(Wanted(NONNORMAL, [[(1, 0), (0, 1), (1, -1)]] * 2, full=True))


def _shifted() -> Certificate:
    """x' = -x - x^3 + 2 + u about x* = 1, an exact equilibrium: claim E with functions shifted."""
    return make(
        Wanted(OFFSET, [[(1, 0), (0, 1)]], "E", c=[[Fraction(1, 2), 1]], kappa=Fraction(1, 2), point=([1], 0, [0]))
    )


def _ball() -> Certificate:
    """The same model about its equilibrium for u = 1, which lies in a proved ball."""
    x = Fraction(round(1.2134116627622296 * 2**40), 2**40)
    radius = proved_radius(model_of(canonical_model(OFFSET)), [x], [Fraction(1)]) or Fraction(0)
    return make(Wanted(OFFSET, [[(1, 0), (0, 1)]], point=([x], radius, [1])))


def _constant_input() -> Certificate:
    """The same model about x_ref = 0, where b counts as one more input."""
    return make(Wanted(OFFSET, [[(1, 0), (0, 1)]]))


def _infeasible() -> Certificate:
    """x' = 2x - tanh x: unstable, so X = z z' at large x, with z = (1, small), separates."""
    unstable = model([("tanh(x)", None, [[-1]])], [[2]])
    groups = [{"forms": [[dyadic(v) for v in form] for form in [(1, 0), (0, 1), (1, -1)]]}]
    return file(unstable, "infeasible", family="full", groups=groups, L=[[4], [1]], proof={"P": [[1]]})


def _refuted(model_object: dict[str, Any], witness: dict[str, Any]) -> Certificate:
    return file(model_object, "refuted", u=[[0, 0]], witness=witness)


_ORIGIN = {"x": [[0, 0]], "radius": [0, 0]}
_OTHER = {"x": [dyadic(Fraction(round(1.9150080481545 * 2**40), 2**40))], "radius": [1, -30]}
_BOUNDED = model([("tanh(x)", None, [[-1, 0], [0, -1]])], [[0.5, 1], [0, -1]], [[1], [0]], n=2)


def _two() -> Certificate:
    """x' = -x + 2 tanh x rests at 0 and near 1.915."""
    return _refuted(BISTABLE, {"kind": "two-equilibria", "points": [_ORIGIN, _OTHER]})


def _unstable() -> Certificate:
    """x' = -x + 2 tanh x is unstable at 0."""
    grows = {"S": [[[1, 0]]], "sigma": [1, -1], "direction": [[1, 0]], "T": [[1]]}
    return _refuted(BISTABLE, {"kind": "unstable-equilibrium", "point": _ORIGIN, **grows})


def _unstable_linear() -> Certificate:
    """Saturated feedback cannot hold an exponentially unstable linear part."""
    S = [[[1, 0]], [[0, 0], [-2, 0]]]
    grows = {"S": S, "sigma": [1, -3], "direction": [[1, 0], [0, 0]], "T": [[4], [-6, 4]]}
    return _refuted(_BOUNDED, {"kind": "unstable-linear-part", **grows})


def _marginal() -> Certificate:
    """x' = -2 arctan x + u with u > pi goes to infinity."""
    return _refuted(model([("arctan(x)", None, [[-2]])]), {"kind": "marginal-direction", "direction": [[1, 0]]})


def _cooperative() -> Certificate:
    """x' = -x + 2 tanh x at 1: F > 0, and the origin is an equilibrium below."""
    return _refuted(BISTABLE, {"kind": "cooperative-growth", "point": _ORIGIN, "start": [[1, 0]]})


def _line() -> Certificate:
    """x' = -x + 2 tanh x on the line of all x, at s = 1."""
    return _refuted(BISTABLE, {"kind": "invariant-line", "direction": [[1, 0]], "offset": [1, 0]})


MAKERS: dict[str, Callable[[], Certificate]] = {
    "g_linear": _linear,
    "g_mixed_pair": _pair,
    "m_cubes": _cubes,
    "e_mixed_pair": _rated,
    "e_gains": _gains,
    "r_gains": _gains_in_a_region,
    "g_rows_dropped": _rows,
    "r_pendulum": _pendulum,
    "g_full": _full,
    "e_shifted": _shifted,
    "g_ball": _ball,
    "g_constant_input": _constant_input,
    "infeasible_full": _infeasible,
    "refuted_two": _two,
    "refuted_unstable": _unstable,
    "refuted_unstable_linear": _unstable_linear,
    "refuted_marginal": _marginal,
    "refuted_cooperative": _cooperative,
    "refuted_line": _line,
}


def load(name: str) -> Certificate:
    """One kept valid certificate."""
    return json.loads((VALID / f"{name}.json").read_text())


def write() -> None:
    """Write all of them."""
    VALID.mkdir(parents=True, exist_ok=True)
    for name, maker in MAKERS.items():
        (VALID / f"{name}.json").write_text(json.dumps(maker()) + "\n")


if __name__ == "__main__":
    write()
