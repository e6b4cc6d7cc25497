"""A model at its operating point: shifted groups, pools of forms with their constants, and what has been disproved."""

from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov.integrals import lower_constants, proves_lower, proves_upper, upper_constants
from persid.lyapunov.multipliers import Lyapunov
from persid.lyapunov.operating_points import OperatingPoint
from persid.lyapunov.sectors import (
    Curve,
    Group,
    Place,
    axes,
    groups,
    nondecreasing_pool,
    pool,
)
from persid.lyapunov.system import System, system
from persid.models.model import PersidskiiModel
from persid_check.prover import prove_continuous


@dataclass(eq=False)
class Setting:
    """The pools shrink while proofs are made: a form that is not proved leaves, a constant that is not proved weakens.

    In a V with a rate stand only nondecreasing forms, whose constant c = 1 needs no further proof, and functions alone.
    """

    model: PersidskiiModel
    point: OperatingPoint | None
    box: Float[ndarray, "n 2"] | None
    found: tuple[Group, ...]
    pools: dict[Curve, ndarray]
    upper: dict[Curve, ndarray] = field(default_factory=dict)
    below: dict[Curve, ndarray] = field(default_factory=dict)

    @classmethod
    def of(
        cls, model: PersidskiiModel, point: OperatingPoint | None, box: Float[ndarray, "n 2"] | None = None
    ) -> "Setting":
        """Look at a model about an equilibrium (None: about x_ref, functions not shifted), on a box or globally."""
        if point is not None and box is None and _is_reference(model, point):
            point = None
        found = groups(model.channels, _place(model, point, box))
        pools, upper, below = {}, {}, {}
        for curve in dict.fromkeys(group.curve for group in found):
            rising, alone = nondecreasing_pool(curve), axes(curve)
            # a group whose functions all have zero columns takes no part: it has no forms, and so no constants
            listed = list(dict.fromkeys([*rising, *pool(curve), *alone])) if curve.functions else []
            forms = np.array(listed).reshape(-1, curve.size)
            pools[curve] = forms
            simple = np.array([form in alone for form in listed], bool)
            upper[curve] = np.where([form in rising for form in listed], 1.0, np.nan)
            upper[curve][simple] = upper_constants(curve, forms[simple])
            below[curve] = lower_constants(curve, forms) if box is not None else np.zeros(len(forms))
        return cls(model, point, box, found, pools, upper, below)

    @property
    def system(self) -> System:
        """The system about the operating point."""
        return system(self.model, self.found, self.pools, shifted=self.point is not None)

    @property
    def jacobian(self) -> Float[ndarray, "n n"]:
        """The linearisation at the operating point, in 1/s."""
        return self.model.jacobian(self.model.x_ref if self.point is None else self.point.x)

    @property
    def units(self) -> Float[ndarray, " m"]:
        """Units of the inputs, powers of two, in which each moves the equilibrium of the linearisation by about 1.

        A gain that is small in these units is small for each input, whatever the user's units.
        """
        B = self.system.B
        moved = np.linalg.norm(np.linalg.lstsq(self.jacobian, B, rcond=None)[0], axis=0)
        return np.exp2(-np.round(np.log2(np.where(moved > 0, moved, 1.0))))

    @property
    def lower(self) -> list[ndarray]:
        """The constants d of the forms of each group."""
        return [self.below[group.curve] for group in self.found]

    @property
    def reach(self) -> Float[ndarray, " n"] | None:
        """The distance of the operating point from the faces of the box that a certificate names, per state.

        The checker takes the ball's radius r off its own box, and names the box in x less 2r at each side.
        """
        if self.box is None:
            return None
        x, radius = (self.model.x_ref, 0.0) if self.point is None else (self.point.x, self.point.radius)
        return np.minimum(x - self.box[:, 0], self.box[:, 1] - x) - 3 * radius

    def without_unproved(self, lyapunov: Lyapunov) -> list[str]:
        """Prove what a Lyapunov function uses; take what is not proved out of the pools, and name it."""
        dropped, seen = [], set()
        for group, part in zip(lyapunov.system.groups, lyapunov.chosen, strict=True):
            for form, mu in zip(part.forms, part.mu, strict=True):
                key = (group.curve, tuple(form.tolist()), bool(mu > 0 and lyapunov.kappa > 0))
                if key not in seen:
                    seen.add(key)
                    dropped += self._doubts(*key)
        return dropped

    def _doubts(self, curve: Curve, form: tuple[float, ...], rated: bool) -> list[str]:
        places = np.flatnonzero((self.pools[curve] == np.array(form)).all(axis=1))
        if not len(places):  # a group with the same curve has dropped it already
            return []
        k = int(places[0])
        if not curve.proves(form):
            for table in (self.pools, self.upper, self.below):
                table[curve] = np.delete(table[curve], k, axis=0)
            return [_text(curve, form)]
        c, d = float(self.upper[curve][k]), float(self.below[curve][k])
        if rated and not proves_upper(curve, form, c):
            self.upper[curve][k] = 1.0 if c != 1.0 and proves_upper(curve, form, 1.0) else np.nan
            return [f"{_text(curve, form)}, c = {c:.4g}"]
        if rated and not proves_lower(curve, form, d):
            self.below[curve][k] = 0.0
            return [f"{_text(curve, form)}, d = {d:.4g}"]
        return []


def undefined(
    model: PersidskiiModel, point: OperatingPoint | None = None, box: Float[ndarray, "n 2"] | None = None
) -> tuple[str, ...]:
    """Return the functions that are not proved continuous for all states (of a box about a point): no claim is then.

    A square root is one, and the tangent; the checker asks it of channels without effect, too.
    """
    place, channels = _place(model, point, box), model.channels
    found = []
    for row, f in zip(channels.rows, channels.functions, strict=True):
        where = (None, None) if place is None else (place.domain(row), place.shift(row))
        if not prove_continuous(((f.program, Fraction(1)),), *where):
            found.append(f.text)
    return tuple(dict.fromkeys(found))


def _is_reference(model: PersidskiiModel, point: OperatingPoint) -> bool:
    at_reference = np.array_equal(point.x, model.x_ref) and np.array_equal(point.u, model.u_ref)
    return at_reference and point.radius == 0 and not model.b.any()


def _place(model: PersidskiiModel, point: OperatingPoint | None, box: ndarray | None) -> Place | None:
    """Return where the functions are looked at, exactly as the checker computes it."""
    if point is None:
        return None
    radius = Fraction(point.radius)
    x = [Fraction(float(v)) for v in point.x]
    offset = tuple(a - Fraction(float(r)) for a, r in zip(x, model.x_ref, strict=True))
    if box is None:
        return Place(offset, radius)
    sides = [(Fraction(float(lo)), Fraction(float(hi))) for lo, hi in box]
    reach = tuple((lo - a + radius, hi - a - radius) for (lo, hi), a in zip(sides, x, strict=True))
    return Place(offset, radius, reach)


def _text(curve: Curve, form: tuple[float, ...]) -> str:
    names = ("x", *curve.functions)
    return " ".join(f"{c:+.4g} {name}" for c, name in zip(form, names, strict=True) if c)
