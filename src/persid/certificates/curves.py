"""Curves of a ledger: functions of one argument, each set once, with the forms that points use and their partitions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import lcm

import numpy as np

from persid._dyadics import dyadic
from persid._files import Json
from persid.certificates.partitions import cuts_of, cuts_of_continuity, cuts_of_product
from persid.errors import RoundingError
from persid.lyapunov import sectors
from persid.lyapunov.sectors import Place
from persid.models.functions import scalar_function
from persid.models.model import PersidskiiModel
from persid_check.expression import parse
from persid_check.ledger.lemmas import SLOPES, Cuts, Lemma
from persid_check.ledger.lemmas import Product as ProductLemma
from persid_check.reading import MAX_FORMS

_ZERO = Fraction(0)
SECTOR = ("nondecreasing", "sector")  # kinds that are tried, the one that says most first
SPANNING = ("rising", "growing", *SECTOR)
SAMPLED = np.concatenate([side * np.geomspace(1e-4, 1e3, 400) for side in (-1, 1)])  # arguments, from the centre
INTEGRABLE = (*SECTOR, "offset")
Form = tuple[Fraction, ...]
Row = Mapping[int, Fraction]
Product = tuple[int, int, Fraction]  # forms k and j of a curve, and the constant of their product


def written_cuts(cuts: Cuts) -> list[int | list[int]]:
    """Write cuts with their common exponent."""
    scale = lcm(*(t.denominator for t in cuts))
    if scale & (scale - 1):
        raise RoundingError("a cut is no dyadic number")
    return [1 - scale.bit_length(), [int(t * scale) for t in cuts]]


@dataclass(frozen=True)
class Use:
    """A form as a point uses it: c and d of its integral where it is a density, `spans` where it has to grow.

    `square` is the d of a bound by its own square, `offset` and `e` are those of practical stability. `kinds` are those
    that will do, the one that says most first.
    """

    form: Form
    c: Fraction | None = None
    d: Fraction = _ZERO
    spans: bool = False
    kinds: tuple[str, ...] = SECTOR
    square: Fraction = _ZERO
    offset: Fraction = _ZERO
    e: Fraction = _ZERO

    @property
    def below(self) -> tuple[Fraction, Form] | None:
        """The d of the bound from below and the form that proves it; None without one."""
        if self.square:
            return self.square, (1 - self.square * self.form[0], *(-self.square * v for v in self.form[1:]))
        return (self.d, (self.form[0] - self.d, *self.form[1:])) if self.d else None


@dataclass(frozen=True)
class Curve:
    """Functions with factors, their possible centres and the domain: what points may share."""

    functions: tuple[tuple[str, Fraction], ...]
    shift: tuple[Fraction, Fraction] | str | None
    domain: tuple[Fraction, Fraction] | None

    def lemma(self, form: Form, kind: str, **numbers: Fraction) -> Lemma:
        """Return a lemma about the curve."""
        functions = tuple((parse(text), alpha) for text, alpha in self.functions)
        centre = None
        if isinstance(self.shift, tuple):
            centre = (self.shift[0] - self.shift[1], self.shift[0] + self.shift[1])
        return Lemma(functions, form, kind, centre, **numbers)

    def written(self, uses: Sequence[Use], products: Sequence[Product]) -> Json:
        """Return the curve's object with these forms and products with constants, with partitions.

        Raises:
            RoundingError: a lemma is not proved.
        """
        functions = tuple((parse(text), alpha) for text, alpha in self.functions)
        middle, radius = self.shift if isinstance(self.shift, tuple) else (_ZERO, _ZERO)
        ends = None if self.domain is None else (middle - radius + self.domain[0], middle + radius + self.domain[1])
        continuous = cuts_of_continuity(functions, ends)
        if continuous is None:
            raise RoundingError("no proof that the functions are continuous")
        forms: list[Json] = []
        extra: list[Json] = []
        for use in uses:
            entry = self._itself(use)
            if use.c is not None:
                entry["upper"] = self._upper(use, entry["is"], use.c)
            if use.below:
                d, below = use.below
                entry["lower"] = [dyadic(d), len(uses) + len(extra)]
                extra.append(self._below(use, below))
            forms.append(entry)
        return {
            "functions": [[text, dyadic(alpha)] for text, alpha in self.functions],
            "shift": [dyadic(v) for v in self.shift] if isinstance(self.shift, tuple) else self.shift,
            "domain": None if self.domain is None else [dyadic(v) for v in self.domain],
            "continuous": written_cuts(continuous),
            "forms": forms + extra,
            "products": [self._product([use.form for use in uses], *product) for product in products],
        }

    def lack(self, use: Use) -> str | None:
        """Return the first of "form", "upper" and "lower" bound that has no proof; None where all that is used has."""
        what = "form"
        try:
            entry = self._itself(use)
            what = "upper"
            if use.c is not None:
                self._upper(use, entry["is"], use.c)
            what = "lower"
            if use.below:
                self._below(use, use.below[1])
        except RoundingError:
            return what
        return None

    def _itself(self, use: Use) -> Json:
        kinds = SPANNING if use.spans else use.kinds
        return self._written(use.form, *self._kind(use.form, kinds, use.offset)) | {"offset": dyadic(use.offset)}

    def _below(self, use: Use, form: Form) -> Json:
        return self._written(form, *self._kind(form, ("nondecreasing",) if use.square else INTEGRABLE))

    def _product(self, forms: Sequence[Form], k: int, j: int, c: Fraction) -> list[object]:
        cuts = cuts_of_product(self.product(forms[k], forms[j], c))
        if cuts is None:
            raise RoundingError(f"no proof of a product with the constant {float(c)}")
        return [k, j, dyadic(c), written_cuts(cuts)]

    def product(self, k: Form, j: Form, c: Fraction) -> ProductLemma:
        """Return the statement that the product of two forms is at least -c."""
        return ProductLemma(tuple((parse(text), alpha) for text, alpha in self.functions), (k, j), c)

    def holds_about_any(self, use: Use) -> bool:
        """Whether the form is nondecreasing and its bounds follow from that: then the centre plays no part."""
        free = use.c is None or use.c >= (1 if any(use.form[1:]) or use.form[0] < 0 else Fraction(1, 2))
        return (
            free
            and use.kinds == SECTOR
            and not use.d
            and not use.spans
            and self._rises(use.form)
            and (use.below is None or self._rises(use.below[1]))
        )

    def _rises(self, form: Form) -> bool:
        return cuts_of(self.lemma(form, "nondecreasing"), self.domain) is not None

    def _kind(self, form: Form, kinds: Sequence[str], offset: Fraction = _ZERO) -> tuple[str, Cuts]:
        for kind in kinds:
            if kind in SLOPES and self._seems_to_fall(form):
                continue
            cuts = cuts_of(self.lemma(form, kind, allowance=offset), self.domain)
            if cuts is not None:
                return kind, cuts
        raise RoundingError(f"no proof of the form {[float(v) for v in form]}")

    def _seems_to_fall(self, form: Form) -> bool:
        """Whether a sum of functions falls at one of many points in floating point: no proof need be sought then."""
        ends = (-np.inf, np.inf) if self.domain is None else tuple(map(float, self.domain))
        s = SAMPLED[(ends[0] <= SAMPLED) & (ends[1] >= SAMPLED)]
        y = float(self.shift[0]) + s if isinstance(self.shift, tuple) else s
        with np.errstate(all="ignore"):
            slopes = [float(v) * float(a) * scalar_function(text).derivative(float(a) * y)
                      for v, (text, a) in zip(form[1:], self.functions, strict=True) if v]  # fmt: skip
            size = abs(float(form[0])) + sum((np.abs(each) for each in slopes), np.zeros(len(y)))
            total = float(form[0]) + sum(slopes, np.zeros(len(y)))
        return bool((total < -1e-9 * size).any())

    def _upper(self, use: Use, kind: str, c: Fraction) -> list[object]:
        free = kind in ("nondecreasing", "rising") and c >= 1
        if free or (not any(use.form[1:]) and c >= Fraction(1, 2)):
            return [dyadic(c), [0, 0], None]
        cuts = cuts_of(self.lemma(use.form, "upper", c=c, allowance=use.e), self.domain)
        if cuts is None:
            raise RoundingError(f"no proof of the bound {float(c)} of the integral of {[float(v) for v in use.form]}")
        return [dyadic(c), dyadic(use.e), written_cuts(cuts)]

    @staticmethod
    def _written(form: Form, kind: str, cuts: Cuts) -> Json:
        found = {"l": [dyadic(v) for v in form], "is": kind, "cuts": written_cuts(cuts)}
        return found | {"offset": [0, 0], "upper": None, "lower": None}


@dataclass
class Curves:
    """The curves of a file, each once, with the uses of its forms in the order of the points."""

    found: list[tuple[Curve, dict[Use, int]]] = field(default_factory=list)
    places: dict[Curve, int] = field(default_factory=dict)
    products: dict[int, list[Product]] = field(default_factory=dict)

    def place(self, curve: Curve, uses: Sequence[Use]) -> tuple[int, list[int]]:
        """Return the number of a curve, and those of its forms that are meant."""
        if curve.shift is not None and curve.domain is None and all(curve.holds_about_any(use) for use in uses):
            curve = replace(curve, shift="any")
        i = self.places.get(curve, len(self.found))
        if i == len(self.found) or len({*self.found[i][1], *uses}) > MAX_FORMS // 2:  # a lower bound is a form, too
            i = self.places[curve] = len(self.found)
            self.found.append((curve, {}))
        listed = self.found[i][1]
        return i, [listed.setdefault(use, len(listed)) for use in uses]

    def written(self) -> list[Json]:
        """Return the objects of the curves."""
        return [curve.written(list(uses), self.products.get(i, ())) for i, (curve, uses) in enumerate(self.found)]

    def add(self, i: int, product: Product) -> int:
        """Add a product to a curve, and return its number there."""
        listed = self.products.setdefault(i, [])
        listed.append(product)
        return len(listed) - 1


def curve_of(curve: sectors.Curve) -> Curve:
    """Return a curve as a file has it."""
    return Curve(tuple(zip(curve.functions, curve.factors, strict=True)), curve.shift, curve.domain)


def idle_points(curves: Curves, model: PersidskiiModel, channels: Iterable[int], place: Place | None) -> list[Json]:
    """Return points of channels without effect: each has to be continuous, and no more is said of it."""
    points = []
    for c in channels:
        row = model.channels.rows[c]
        shift, domain = (None, None) if place is None else (place.shift(row), place.domain(row))
        curve = Curve(((model.channels.functions[c].text, Fraction(1)),), shift, domain)
        at = {int(i): Fraction(float(row[i])) for i in np.flatnonzero(row)}
        points.append(written_point(curves.place(curve, ())[0], at, [c], []))
    return points


def written_point(
    curve: int, row: Mapping[int, Fraction], channels: Sequence[int], densities: Sequence[object]
) -> Json:
    """Write the point y = r'x of a curve: which channels its functions are, and their share of V."""
    return {
        "curve": curve,
        "row": [[i, dyadic(r)] for i, r in row.items()],
        "channels": list(channels),
        "densities": list(densities),
    }
