"""What files of both formats have in common: balls, P, gamma."""

from dataclasses import dataclass
from fractions import Fraction

from persid_check.entry import Entry, Lower
from persid_check.model import Model

MAX_FORMS = 128  # of a curve, a group or a kind


@dataclass(frozen=True)
class Ball:
    """The ball |x* - x|_inf <= radius in which exactly one equilibrium for the constant input u is claimed."""

    x: tuple[Fraction, ...]
    radius: Fraction
    u: tuple[Fraction, ...]


def read_ball(entry: Entry, model: Model, u: tuple[Fraction, ...] | None = None) -> Ball:
    """Return a ball with its input, or one for an input that is given."""
    ball = entry.fields(("x", "radius", "u") if u is None else ("x", "radius"))
    u = ball["u"].dyadics(model.m) if u is None else u
    return Ball(ball["x"].dyadics(model.n), ball["radius"].nonnegative(), u)


def read_P(entry: Entry, n: int) -> tuple[bool, Lower]:
    """Return whether P is diagonal, and its lower rows, of one entry where it is."""
    if isinstance(entry.value, dict) and set(entry.value) == {"diagonal"}:
        return True, tuple((value,) for value in entry.fields(("diagonal",))["diagonal"].dyadics(n))
    return False, entry.fields(("lower",))["lower"].lower(n)


def read_gamma(entry: Entry, width: int) -> Fraction | Lower:
    """Return gamma, or the lower rows of Gamma."""
    return entry.fields(("lower",))["lower"].lower(width) if isinstance(entry.value, dict) else entry.dyadic()
