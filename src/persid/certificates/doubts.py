"""What a Lyapunov function uses and no partition proves: forms leave their pools, constants weaken."""

from dataclasses import replace
from fractions import Fraction

import numpy as np

from persid.certificates.curves import Curve, Use, curve_of
from persid.certificates.stability import uses
from persid.lyapunov import sectors
from persid.lyapunov.multipliers import Lyapunov
from persid.lyapunov.points import written
from persid.lyapunov.shifted_model import Setting


def without_unproved(setting: Setting, lyapunov: Lyapunov) -> tuple[Setting, tuple[str, ...]]:
    """Prove what a Lyapunov function uses; return the setting without what is not proved, and the names of that.

    The proofs are those that its file carries. A form that is not proved leaves its pool, a constant that is not proved
    weakens.
    """
    used = dict[tuple[sectors.Curve, tuple[float, ...]], tuple[Curve, Use]]()
    for group, part in zip(lyapunov.system.groups, lyapunov.chosen, strict=True):
        k, _, stretched = written(group)
        for form, use in zip(part.forms.tolist(), uses(part, k, lyapunov), strict=True):
            at = group.curve, tuple(form)
            used[at] = max(used.get(at, (curve_of(stretched), use)), (curve_of(stretched), use), key=_asks)
    dropped = list[str]()
    for (curve, form), (about, use) in used.items():
        setting, doubts = _doubted(setting, curve, form, about, use)
        dropped += doubts
    return setting, tuple(dropped)


def _asks(used: tuple[Curve, Use]) -> bool:
    """Whether bounds of the integral are asked for, too."""
    return used[1].c is not None


def _doubted(
    setting: Setting, curve: sectors.Curve, form: tuple[float, ...], about: Curve, use: Use
) -> tuple[Setting, list[str]]:
    places = np.flatnonzero((setting.pools[curve] == np.array(form)).all(axis=1))
    lack = about.lack(use) if len(places) else None  # it may have left for another Lyapunov function
    if lack is None:
        return setting, []
    k, name = int(places[0]), _text(curve, form)
    if lack == "form":
        return setting.without(curve, k), [name]
    if lack == "upper" and use.c is not None:
        weaker = 1.0 if use.c != 1 and about.lack(replace(use, c=Fraction(1))) != "upper" else np.nan
        return setting.with_upper(curve, k, weaker), [f"{name}, c = {float(use.c):.4g}"]
    return setting.with_lower(curve, k, 0.0), [f"{name}, d = {float(use.d):.4g}"]


def _text(curve: sectors.Curve, form: tuple[float, ...]) -> str:
    names = ("x", *curve.functions)
    return " ".join(f"{c:+.4g} {name}" for c, name in zip(form, names, strict=True) if c)
