"""A model at its operating point: shifted groups and pools of forms with their constants."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov import decay
from persid.lyapunov.arrays import HOST, Arrays
from persid.lyapunov.integrals import lower_constants, upper_constants
from persid.lyapunov.multipliers import Used
from persid.lyapunov.operating_points import OperatingPoint
from persid.lyapunov.own_functions import lacking, own_functions
from persid.lyapunov.sectors import (
    Curve,
    Group,
    Place,
    axes,
    groups,
    nondecreasing_pool,
    pool,
)
from persid.lyapunov.system import Family, System, system
from persid.models.model import PersidskiiModel
from persid_check.search.prover import prove_continuous


@dataclass(frozen=True, eq=False)
class Setting:
    """A model about a point, in a box or globally: its groups, their pools of forms, and constants c and d of these.

    In a V with a rate stand only nondecreasing forms, whose constant c = 1 needs no further proof, and functions alone.
    """

    model: PersidskiiModel
    point: OperatingPoint | None
    box: Float[ndarray, "n 2"] | None
    found: tuple[Group, ...]
    pools: dict[Curve, ndarray]
    upper: dict[Curve, ndarray]
    below: dict[Curve, ndarray]
    arrays: Arrays = field(default=HOST, repr=False)  # where its inequalities are solved

    @classmethod
    def of(
        cls, model: PersidskiiModel, point: OperatingPoint | None, box: Float[ndarray, "n 2"] | None = None,
        arrays: Arrays = HOST,
    ) -> "Setting":  # fmt: skip
        """Look at a model about an equilibrium (None: about x_ref, functions not shifted), on a box or globally."""
        if point is not None and box is None and is_reference(model, point):
            point = None
        found = groups(model.channels, place(model, point, box))
        own = own_functions(model, found)
        pools, upper, below = {}, {}, {}
        for curve in dict.fromkeys(group.curve for group in found):
            rising, alone = nondecreasing_pool(curve), axes(curve)
            # a group whose functions all have zero columns takes no part: it has no forms, and so no constants
            listed = list(dict.fromkeys([*rising, *pool(curve), *alone])) if curve.functions else []
            listed = [form for form in listed if any(form[1:])] if curve.fixed else listed
            listed += lacking(curve, np.array(listed).reshape(-1, curve.size), own[curve])
            forms = np.array(listed).reshape(-1, curve.size)
            pools[curve] = forms
            simple = np.array([form in alone for form in listed], bool)
            upper[curve] = np.where([form in rising for form in listed], 1.0, np.nan)
            upper[curve][simple] = upper_constants(curve, forms[simple])
            bounded = box is not None and not curve.fixed
            below[curve] = lower_constants(curve, forms) if bounded else np.zeros(len(forms))
        return cls(model=model, point=point, box=box, found=found, pools=pools, upper=upper, below=below, arrays=arrays)

    @property
    def system(self) -> System:
        """The system about the operating point."""
        about = system(self.model, self.found, self.pools, shifted=self.point is not None)
        return replace(about, arrays=self.arrays)

    @property
    def jacobian(self) -> Float[ndarray, "n n"]:
        """The linearisation at the operating point, in 1/s, or of one step."""
        return self.model.jacobian(self.model.x_ref if self.point is None else self.point.x)

    @property
    def fastest(self) -> float:
        """What no kappa exceeds, by the linearisation."""
        return decay.fastest(self.jacobian, self.model.dt)

    @property
    def monotone(self) -> "Setting":
        """The setting with nondecreasing forms and no densities: what it proves holds between any two solutions."""
        setting = replace(self, upper={curve: np.full(len(forms), np.nan) for curve, forms in self.pools.items()})
        for curve, forms in self.pools.items():
            rising = nondecreasing_pool(curve) if curve.functions else ()
            for k in reversed([k for k, form in enumerate(forms.tolist()) if tuple(form) not in rising]):
                setting = setting.without(curve, k)
        return setting

    def families(self, used: Collection[Used]) -> tuple[Family, ...]:
        """Return the families of what each group uses, as far as it stands in the pools; any form may be in V."""
        found = []
        for g, group in enumerate(self.found):
            forms = self.pools[group.curve]
            places = {tuple(form): k for k, form in enumerate(forms.tolist())}
            known = sorted(sorted(places[form] for form in one) for at, curve, one in used
                           if (at, curve) == (g, group.curve) and one <= places.keys())  # fmt: skip
            products = tuple((one[0], one[1]) for one in known if len(one) == 2)
            found.append(Family(forms, tuple(one[0] for one in known if len(one) == 1), products))
        return tuple(found)

    @property
    def units(self) -> Float[ndarray, " m"]:
        """Units of the inputs, powers of two, in which each moves the equilibrium of the linearisation by about 1.

        A gain that is small in these units is small for each input, whatever the user's units.
        """
        B, J = self.system.B, self.jacobian
        slopes = J - np.eye(len(J)) if self.model.is_discrete else J
        moved = np.linalg.norm(np.linalg.lstsq(slopes, B, rcond=None)[0], axis=0)
        return np.exp2(-np.round(np.log2(np.where(moved > 0, moved, 1.0))))

    @property
    def lower(self) -> list[ndarray]:
        """The constants d of the forms of each group."""
        return [self.below[group.curve] for group in self.found]

    @property
    def reach(self) -> Float[ndarray, " n"] | None:
        """The distance of the operating point from the faces of the box, per state."""
        return None if self.box is None or self.point is None else self.point.reach(self.box)

    def without(self, curve: Curve, k: int) -> "Setting":
        """Return the setting without a form of a curve's pool."""
        pools, upper, below = (
            {**table, curve: np.delete(table[curve], k, axis=0)} for table in (self.pools, self.upper, self.below)
        )
        return replace(self, pools=pools, upper=upper, below=below)

    def with_upper(self, curve: Curve, k: int, c: float) -> "Setting":
        """Return the setting with another constant c of a form."""
        return replace(self, upper=_changed(self.upper, curve, k, c))

    def with_lower(self, curve: Curve, k: int, d: float) -> "Setting":
        """Return the setting with another constant d of a form."""
        return replace(self, below=_changed(self.below, curve, k, d))


def _changed(table: dict[Curve, ndarray], curve: Curve, k: int, value: float) -> dict[Curve, ndarray]:
    constants = table[curve].copy()
    constants[k] = value
    return {**table, curve: constants}


def undefined(
    model: PersidskiiModel, point: OperatingPoint | None = None, box: Float[ndarray, "n 2"] | None = None
) -> tuple[str, ...]:
    """Return the functions that are not proved continuous for all states (of a box about a point): no claim is then.

    A square root is one, and the tangent; the checker asks it of channels without effect, too.
    """
    at, channels = place(model, point, box), model.channels
    found = []
    for row, f in zip(channels.rows, channels.functions, strict=True):
        where = (None, None) if at is None else (at.domain(row), at.shift(row))
        if not prove_continuous(((f.program, Fraction(1)),), *where):
            found.append(f.text)
    return tuple(dict.fromkeys(found))


def is_reference(model: PersidskiiModel, point: OperatingPoint) -> bool:
    """Whether a point is known to be the reference of a model exactly, without constants."""
    at_reference = np.array_equal(point.x, model.x_ref) and np.array_equal(point.u, model.u_ref)
    return at_reference and point.radius == 0 and not model.b.any()


def place(model: PersidskiiModel, point: OperatingPoint | None, box: Float[ndarray, "n 2"] | None) -> Place | None:
    """Return where the functions of a model are looked at; None where they are not shifted."""
    return None if point is None else Place.about(point.x, model.x_ref, point.radius, box)
