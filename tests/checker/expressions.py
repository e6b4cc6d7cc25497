"""Random expressions of the grammar, and the truth about them by dense sampling."""

import random

import numpy as np

from persid.models.functions import scalar_function

_UNARY = [
    "sinh",
    "tanh",
    "arctan",
    "arcsinh",
    "erf",
    "softsign",
    "sin",
    "cos",
    "exp",
    "expm1",
    "sat",
    "deadzone",
    "relu",
    "abs",
    "softplus",
    "cosh",
]


TABLE = "pwl(x; -1.3: -1, -0.4: 0, 0.4: 0.1, 2: -0.5)"


def expression(choose: random.Random, depth: int = 3) -> str:
    """A random expression, often but not always a sector function."""
    if depth == 0 or choose.random() < 0.15:
        return choose.choice(["x", "x", "x", "x**3", "tanh(x)", f"{choose.randint(1, 9) / 4}*x", "x**2", "1", TABLE])
    kind = choose.random()
    inner = expression(choose, depth - 1)
    if kind < 0.35:
        return f"{choose.choice(_UNARY)}({inner})"
    if kind < 0.45:
        return f"({inner})**{choose.choice([2, 3, 5])}"
    other = expression(choose, depth - 1)
    if kind < 0.55:
        return f"({inner})/(1+({other})**2)"
    return f"({inner}){choose.choice(['+', '+', '-', '*'])}({other})"


def odd_part(choose: random.Random) -> str:
    """Either an expression or x times a square plus noise: so that many are sector functions."""
    text = expression(choose)
    return text if choose.random() < 0.4 else f"x*(({text})**2+{choose.randint(0, 3)}/8)+{choose.randint(-1, 2)}/16*x"


SAMPLES = np.concatenate(
    [s * np.geomspace(1e-6, 1e6, 40001) for s in (1, -1)] + [s * np.linspace(0, 30, 60001)[1:] for s in (1, -1)]
)


def is_sector_function(text: str) -> bool | None:
    """Truth by sampling: False where a clearly wrong sign is found, None where a value is not a number."""
    with np.errstate(all="ignore"):
        values = scalar_function(text).value(SAMPLES)
        at_zero = float(scalar_function(text).value(np.array(0.0)))
    if np.isnan(values).any() or not np.isfinite(at_zero):
        return None
    if abs(at_zero) > 1e-12:
        return False
    near = np.abs(SAMPLES) <= 30
    scale = np.where(near, 1e-9 * np.maximum(np.abs(values), np.abs(SAMPLES)), 1e-6 * np.abs(values) + 1e-6)
    return not (np.sign(SAMPLES) * values < -scale).any()
