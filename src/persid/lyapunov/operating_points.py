"""Operating points: equilibria of a model for a constant input, found by Newton's method and proved by the checker.

In discrete time they are fixed points, the zeros of x+ - x.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import ctx
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import dyadic, dyadics, value
from persid._files import Json
from persid.errors import ModelError
from persid.models.model import PersidskiiModel
from persid_check.enclosure import PRECISION
from persid_check.equilibrium import first_radius
from persid_check.model import Model, model_of

STARTS = 160  # points from which the search sets out, for up to 20 states
STEPS = 60  # from each of them
LONGEST = 2.0  # in units
CLOSE = 1e-10  # in units: no further step is worth while
RADII = tuple(Fraction(1, 2**k) for k in (48, 40, 32, 24, 16, 10))  # tried in this order, times the size of x
REACH = 4.0  # starts fill the box of the data, enlarged this many times about its centre


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """Exactly one equilibrium x* for the constant input u lies in the ball |x - x*|_inf <= radius, by proof.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-2.0]], B=[[1.0]], b=[1.0])
        >>> point = ps.find_operating_point(model)[0]
        >>> round(float(point.x[0]), 6), point.radius < 1e-6
        (0.5, True)
    """

    x: Float[ndarray, " n"]
    radius: float
    u: Float[ndarray, " m"]

    def reach(self, box: Float[ndarray, "k 2"]) -> Float[ndarray, " k"]:
        """Return the distance from the faces of the box that a certificate names, per state; negative outside of it.

        A box may be of the first variables alone.

        The checker takes the ball's radius r off its own box, and names the box in x less 2r at each side.
        """
        x = self.x[: len(box)]
        return np.asarray(np.minimum(x - box[:, 0], box[:, 1] - x) - 3 * self.radius)

    def to_dict(self, *, with_input: bool = True) -> Json:
        """Return the point as a certificate writes it; with its input, `from_dict` is the way back, exactly."""
        point: Json = {"x": dyadics(self.x), "radius": dyadic(self.radius)}
        return point | ({"u": dyadics(self.u)} if with_input else {})

    @classmethod
    def from_dict(cls, data: Json) -> "OperatingPoint":
        """Return what `to_dict` was called on."""
        x, u = (np.array([value(pair) for pair in data[name]], float) for name in "xu")
        return cls(x, value(data["radius"]), u)


def find_operating_point(
    model: PersidskiiModel,
    u: Sequence[float] | ndarray | None = None,
    *,
    near: object = None,
    starts: int | None = None,
    seed: int = 0,
) -> tuple[OperatingPoint, ...]:
    """Return the equilibria found for a constant input, each one proved, nearest to x_ref (or `near`) first.

    That no other one exists is not claimed: Newton's method sets out from a fixed set of points.

    Args:
        model: the model.
        u: the constant input, (m,), default u_ref.
        near: a state to sort by, and to set out from as well.
        starts: how many points to set out from: by default 160 for up to 20 states, else 8.
        seed: of the points.

    Raises:
        ModelError: u or `near` is not a vector of finite numbers of the right length.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
        >>> [round(float(point.x[0]), 6) for point in ps.find_operating_point(model)]
        [0.0, 1.0, -1.0]
    """
    u = model.u_ref if u is None else vector("u", u, model.m)
    centre = model.x_ref if near is None else vector("a state near the operating point", near, model.n)
    found, units = list[ndarray](), _units(model)
    starting = _starts(model, centre, units, starts or (STARTS if model.n <= 20 else 8), seed)
    with np.errstate(all="ignore"):
        for x in _distinct(_resting(model, starting, u, units), units):
            polished = _polished(model, x, u, units)
            if polished is not None and _is_new(polished, found, units):
                found.append(polished)
    found.sort(key=lambda x: float(np.linalg.norm(x - centre)))
    proved = (prove(model, x, u) for x in found)
    return tuple(point for point in proved if point is not None)


def vector(name: str, given: object, size: int) -> ndarray:
    """Return what a caller gave as a vector of finite numbers, or say what is needed."""
    try:
        found = np.array(given, float)
    except (TypeError, ValueError):
        raise ModelError(f"{name} is {given!r}; needed are {size} numbers") from None
    if found.shape != (size,) or not np.isfinite(found).all():
        raise ModelError(f"{name} is {given!r}; needed are {size} finite numbers")
    return found


def prove(model: PersidskiiModel, x: Float[ndarray, " n"], u: Float[ndarray, " m"]) -> OperatingPoint | None:
    """Return the equilibrium near x as a proved ball, or None where the proof fails."""
    radius = proved_radius(model_of(model.canonical, discrete=True), x.tolist(), u.tolist())
    return None if radius is None else OperatingPoint(x, float(radius), u)


def proved_radius(model: Model, x: Sequence[float | Fraction], u: Sequence[float | Fraction]) -> Fraction | None:
    """Return a radius r such that exactly one equilibrium for the constant input u lies in |x* - x|_inf <= r, or None.

    The radius 0 means that x itself is an equilibrium, exactly. In discrete time equilibria are fixed points.
    """
    centre, inputs = [Fraction(v) for v in x], [Fraction(v) for v in u]
    scale = Fraction(2) ** int(1 + max(map(abs, centre), default=Fraction(0))).bit_length()
    with ctx.workprec(PRECISION):
        radii = (Fraction(0), *(radius * scale for radius in RADII))
        return first_radius(model.resting, centre, radii, inputs)


def residual(
    model: PersidskiiModel, x: Float[ndarray, "*N n"], u: Float[ndarray, "*M m"] | None = None
) -> Float[ndarray, "*N n"]:
    """Return what vanishes exactly where the model rests: x', or x+ - x in discrete time."""
    return model.rhs(x, u) - x if model.is_discrete else model.rhs(x, u)


def residual_slopes(model: PersidskiiModel, x: Float[ndarray, "*N n"]) -> Float[ndarray, "*N n n"]:
    """Return the derivatives of `residual` by x."""
    return model.jacobian(x) - np.eye(model.n) if model.is_discrete else model.jacobian(x)


def usual_box(model: PersidskiiModel) -> Float[ndarray, "n 2"]:
    """Return the box of the data, or one of a few natural units of the functions where the model has none."""
    if model.domain is not None:
        return model.domain
    rows = model.channels.rows
    widest = np.abs(rows).max(axis=0) if len(rows) else np.ones(model.n)
    half = 5.0 / np.where(widest > 0, widest, 1.0)
    return np.stack([model.x_ref - half, model.x_ref + half], axis=1)


def _units(model: PersidskiiModel) -> Float[ndarray, " n"]:
    """Return half the sides of the usual box: what is large and what is small, state by state."""
    half = np.diff(usual_box(model), axis=1)[:, 0] / 2
    return np.where(half > 0, half, 1.0)


def _starts(model: PersidskiiModel, centre: ndarray, units: ndarray, count: int, seed: int) -> ndarray:
    middle = usual_box(model).mean(axis=1)
    cube = np.random.default_rng(seed).uniform(-1, 1, (count, model.n))
    near, far = middle + units * cube[: count // 2], middle + REACH * units * cube[count // 2 :]
    return np.vstack([centre, model.x_ref, near, far])


def _resting(
    model: PersidskiiModel, starts: Float[ndarray, "N n"], u: ndarray, units: ndarray
) -> Float[ndarray, "N n"]:
    """Return where Newton's method for rhs(x, u) = 0 leads from all starts at once, no step longer than a few units.

    Those that have arrived stay there. Steps uphill are allowed: they lead out of valleys of |rhs| where nothing rests,
    and to more equilibria.
    """
    found, moving = starts / units, np.arange(len(starts))
    for _ in range(STEPS):
        v = found[moving]
        r = _bounded(residual(model, units * v, u) / units)
        J = _bounded(residual_slopes(model, units * v) * units / units[:, None])
        d = -_solved(J, r)
        length = np.abs(d).max(axis=1)
        found[moving] = v = v + d * np.minimum(1.0, LONGEST / length)[:, None]
        moving = moving[length > CLOSE * (1 + np.abs(v).max(axis=1))]
        if not len(moving):
            break
    return np.asarray(units * found)


def _solved(J: Float[ndarray, "N n n"], r: Float[ndarray, "N n"]) -> Float[ndarray, "N n"]:
    """Return the solutions of all J d = r, the shortest of least error in a step where some J is singular."""
    try:
        return np.asarray(np.linalg.solve(J, r[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(J) @ r[:, :, None])[:, :, 0])


def _distinct(points: Float[ndarray, "N n"], units: ndarray) -> list[ndarray]:
    """Return those of the points that are not near one before them."""
    found = list[ndarray]()
    for x in points:
        if _is_new(x, found, units):
            found.append(x)
    return found


def _is_new(x: ndarray, found: Sequence[ndarray], units: ndarray) -> bool:
    return not any((np.abs(x - other) <= 1e-6 * np.abs(other) + 1e-8 * units).all() for other in found)


def _polished(model: PersidskiiModel, x: ndarray, u: ndarray, units: ndarray) -> ndarray | None:
    """Return the equilibrium near x, by Newton's method; None where there is none."""
    if not residual(model, x, u).any():  # at rest, where slopes may be singular, as those of -x**3 at 0
        return x
    try:
        for _ in range(3):
            x = x - np.linalg.solve(residual_slopes(model, x), residual(model, x, u))
    except np.linalg.LinAlgError:
        return None
    left = np.abs(residual(model, x, u) / units).max()
    size = np.abs(residual_slopes(model, x) * units / units[:, None]).max() * np.abs((x - model.x_ref) / units).max()
    return x if left <= 1e-9 * (1 + size) < np.inf else None  # neither NaN nor infinity is an equilibrium


def _bounded(values: ndarray) -> ndarray:
    return np.asarray(np.nan_to_num(values, nan=1e100, posinf=1e100, neginf=-1e100))
