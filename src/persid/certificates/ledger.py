"""Certificates of format 2 from the content of format 1: curves are shared, and each lemma gets its partition."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import gcd, lcm

import numpy as np

from persid._dyadics import exact, is_dyadic
from persid._files import Json
from persid.certificates.encoding import eliminated, factor, root
from persid.certificates.partitions import cuts_of, cuts_of_continuity, cuts_of_product
from persid.errors import RoundingError
from persid_check.exact import Matrix, diagonal, is_large
from persid_check.expression import parse
from persid_check.ledger import FORMAT
from persid_check.ledger.algebraic import form_of_differences
from persid_check.ledger.assembly import assemble
from persid_check.ledger.file import read_ledger
from persid_check.ledger.lemmas import Cuts, Lemma
from persid_check.ledger.lemmas import Product as ProductLemma
from persid_check.ledger.values import Ledger
from persid_check.model import Group, Model, groups_of, model_of
from persid_check.reading import MAX_FORMS
from persid_check.version_1.format import WORDS

_ZERO = Fraction(0)
BOUNDING = 1e12  # how well the factor of the bound of V is known: bounds of rows lose about so little by it
ELIMINATED = 40  # rows of a matrix that is eliminated in fractions
SECTOR = ("nondecreasing", "sector")  # kinds that are tried, the one that says most first
SPANNING = ("rising", "growing", *SECTOR)
INTEGRABLE = (*SECTOR, "offset")
Form = tuple[Fraction, ...]
Row = Mapping[int, Fraction]
Product = tuple[int, int, Fraction]  # forms k and j of a curve, and the constant of their product


def dyadic(number: Fraction) -> list[int]:
    """Write a dyadic number.

    Raises:
        RoundingError: it is not dyadic.
    """
    if number.denominator & (number.denominator - 1):
        raise RoundingError(f"{number} is no dyadic number")
    return [number.numerator, 1 - number.denominator.bit_length()]


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
            entry = self._written(use.form, *self._kind(use.form, SPANNING if use.spans else use.kinds, use.offset))
            entry["offset"] = dyadic(use.offset)
            if use.c is not None:
                entry["upper"] = self._upper(use.form, entry["is"], use.c, use.e)
            if use.below:
                d, below = use.below
                entry["lower"] = [dyadic(d), len(uses) + len(extra)]
                extra.append(self._written(below, *self._kind(below, ("nondecreasing",) if use.square else INTEGRABLE)))
            forms.append(entry)
        return {
            "functions": [[text, dyadic(alpha)] for text, alpha in self.functions],
            "shift": [dyadic(v) for v in self.shift] if isinstance(self.shift, tuple) else self.shift,
            "domain": None if self.domain is None else [dyadic(v) for v in self.domain],
            "continuous": written_cuts(continuous),
            "forms": forms + extra,
            "products": [self._product([use.form for use in uses], *product) for product in products],
        }

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
            cuts = cuts_of(self.lemma(form, kind, allowance=offset), self.domain)
            if cuts is not None:
                return kind, cuts
        raise RoundingError(f"no proof of the form {[float(v) for v in form]}")

    def _upper(self, form: Form, kind: str, c: Fraction, e: Fraction = _ZERO) -> list[object]:
        free = kind in ("nondecreasing", "rising") and c >= 1
        if free or (not any(form[1:]) and c >= Fraction(1, 2)):
            return [dyadic(c), [0, 0], None]
        cuts = cuts_of(self.lemma(form, "upper", c=c, allowance=e), self.domain)
        if cuts is None:
            raise RoundingError(f"no proof of the bound {float(c)} of the integral of {[float(v) for v in form]}")
        return [dyadic(c), dyadic(e), written_cuts(cuts)]

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


def as_ledger(content: Json, deviations: Sequence[Json] = (), outputs: Mapping[str, object] | None = None) -> Json:
    """Return the content of format 2 that claims what a content of format 1 claims.

    It speaks of plants with deviations, and of outputs, if they are given.

    Raises:
        RoundingError: a lemma has no partition that is found, or a factor no proof.
    """
    model, claim = model_of(content["model"], discrete=True), content["claim"]
    curves, points, facts = Curves(), [], []
    for g, (group, stored) in enumerate(zip(groups_of(model), content["groups"], strict=True)):
        scale, row, alphas = _dyadic_row(group.row, [alpha for _, alpha in group.members])
        place, at = curves.place(_curve(content, model, row, group, alphas), list(_uses(claim, stored, scale)))
        densities = [[at[k], dyadic(exact(mu) * scale)] for k, mu in enumerate(stored["mu"]) if mu[0]]
        points.append(
            {
                "curve": place,
                "row": [[i, dyadic(r)] for i, r in row.items()],
                "channels": [c for c, _ in group.members],
                "densities": densities,
            }
        )
        facts += [[g, at[k], at[j], tau] for k, j, tau in stored["products"]]
    rated, regional, written = claim in ("E", "R"), claim == "R", curves.written()
    draft = {
        "format": FORMAT,
        "claim": WORDS[claim],
        **{name: content[name] for name in ("statement", "model_sha256", "model", "operating_point")},
        "curves": written,
        "points": points,
        "facts": {"value": facts, "one_signed": [], "difference": [], "constant": []},
        "P": content["P"],
        "gamma": content["gamma"],
        "deviations": list(deviations),
        "dropped": content["dropped"],
        "spanning": _spanning(content, model, points, written),
        "kappa": content["kappa"] if rated else [0, 0],
        "p": content["p"] if rated else [0, 0],
        "strips": _strips(content, model, points, written) if regional else [],
        "level": content["level"] if regional else [0, 0],
        "input_bound": content["input_bound"] if regional else [0, 0],
        "outputs": outputs or [],
        "proof": {"P": [], "M": [], "V": None},
    }
    return with_proof(draft)


def with_proof(draft: Json) -> Json:
    """Return a content with factors for its matrices."""
    ledger = read_ledger(draft)
    matrices, n = assemble(ledger), ledger.model.order
    kept = [i for i in range(matrices.M.height) if i not in set(ledger.dropped)]
    states = [i for i in kept if i < n]
    values = list(range(n, matrices.Pt.height))  # of functions, which V reads
    lower = matrices.Pt + diagonal([-ledger.p] * n + [0] * len(values))
    bounding = ledger.claim == "region" or ledger.outputs is not None
    proof = {
        "P": _proved(lower.kept(*[states + values] * 2)),
        "M": _proved(matrices.M.kept(kept, kept)),
        "V": factor(floats(matrices.Pt), BOUNDING) if bounding else None,
    }
    return draft | {"proof": proof} | _with_algebraic(draft, ledger)


def _with_algebraic(draft: Json, ledger: Ledger) -> Json:
    """Return what is said of equations with factors, nothing of a model without them."""
    said = ledger.algebraic
    if said is None:
        return {}
    written = draft["algebraic"]
    solvable = {**written["solvable"], "proof": factor(floats(form_of_differences(ledger, said)))}
    return {"algebraic": {**written, "solvable": solvable}}


def _proved(M: Matrix) -> list[list[int]] | Json:
    """Return what proves a matrix positive definite; by elimination in fractions what floating point does not bear."""
    try:
        return shortest(floats(M))
    except RoundingError:
        if M.height > ELIMINATED:
            raise
        return eliminated(M.flint)


def shortest(M: np.ndarray) -> list[list[int]] | Json:
    """Return what proves a matrix positive definite: a factor of a small one, a root of a large one."""
    return root(M) if is_large(*M.shape) else factor(M)


def floats(M: Matrix) -> np.ndarray:
    """Return an exact matrix in floating point."""
    if is_large(*M.shape):
        return M.digits.floats(M.exponent)
    rows = [[float(Fraction(int(v), 1 << M.exponent)) for v in line] for line in M.flint.table()]
    return np.array(rows, float).reshape(M.height, M.width)


def _dyadic_row(
    row: dict[int, Fraction], alphas: list[Fraction]
) -> tuple[Fraction, dict[int, Fraction], list[Fraction]]:
    """Return k, r/k and the factors times k, all dyadic: r/k is r itself where it can be, else k is nearly 1.

    The cuts of lemmas lie about 1, where functions of arguments of the size of r'x bend.
    """
    if all(map(is_dyadic, alphas)) or not row:
        return Fraction(1), row, alphas
    common = gcd(*(value.numerator for value in row.values()))
    k = Fraction(common, 1 << common.bit_length())
    return k, {i: value / k for i, value in row.items()}, [alpha * k for alpha in alphas]


def _curve(content: Json, model: Model, row: Row, group: Group, alphas: Sequence[Fraction]) -> Curve:
    """Return the curve of a group of channels, about the operating point and on the region."""
    shift, domain, point = None, None, content["operating_point"]
    if point is not None:
        center = sum((r * (exact(point["x"][i]) - model.x_ref[i]) for i, r in row.items()), _ZERO)
        shift = (center, sum((abs(r) for r in row.values()), _ZERO) * exact(point["radius"]))
    if content["claim"] == "R":
        box = _relative_box(content, model)
        sides = [sorted((r * box[i][0], r * box[i][1])) for i, r in row.items()]
        domain = (sum((s[0] for s in sides), _ZERO), sum((s[1] for s in sides), _ZERO))
        domain = domain if sides else (Fraction(-1), Fraction(1))
    functions = tuple((model.channels[c].text, alpha) for (c, _), alpha in zip(group.members, alphas, strict=True))
    return Curve(functions, shift, domain)


def _uses(claim: str, stored: Json, scale: Fraction) -> Iterator[Use]:
    """Return how a group uses its forms; those in V have their constants."""
    none = [None] * len(stored["forms"])
    bounds = zip(stored.get("integral", none), stored.get("quadratic", none), strict=True)
    for pairs, mu, (c, d) in zip(stored["forms"], stored["mu"], bounds, strict=True):
        form = tuple(exact(v) for v in pairs)
        form = (form[0] * scale, *form[1:])
        if mu[0]:
            yield Use(form, c and exact(c), exact(d) * scale if d else _ZERO, claim == "M")
        else:
            yield Use(form)


def _relative_box(content: Json, model: Model) -> list[tuple[Fraction, Fraction]]:
    point = content["operating_point"]
    center = model.x_ref if point is None else [exact(v) for v in point["x"]]
    radius = _ZERO if point is None else exact(point["radius"])
    return [
        (exact(lo) - x + radius, exact(hi) - x - radius) for (lo, hi), x in zip(content["box"], center, strict=True)
    ]


def _strips(content: Json, model: Model, points: list[Json], curves: list[Json]) -> list[object]:
    """Return the sides of the box, but for those that stand as the domain of a point."""
    sides = [([[i, [1, 0]]], [dyadic(lo), dyadic(hi)]) for i, (lo, hi) in enumerate(_relative_box(content, model))]
    standing = [(point["row"], curves[point["curve"]]["domain"]) for point in points]
    return [[row, *ends] for row, ends in sides if (row, ends) not in standing]


def _spanning(content: Json, model: Model, points: list[Json], curves: list[Json]) -> list[list[int]]:
    if not any(i < model.n for i in content["dropped"]):
        return []
    dropped, found = set(content["dropped"]), []
    for p, point in enumerate(points):
        for k, _ in point["densities"]:
            form = curves[point["curve"]]["forms"][k]["l"]
            reads = {model.n + c for c, v in zip(point["channels"], form[1:], strict=True) if v[0]}
            reads |= {i for i, _ in point["row"]} if form[0][0] else set()
            if not reads & dropped:
                found.append([p, k])
                break
    return found
