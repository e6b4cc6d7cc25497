"""Partitions: where a lemma about one function is cut, so that the checker proves it piece by piece without a search.

The search is here. Pieces are bisected until the checker's own evaluation of a piece succeeds; a point where it fails
ends the search.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise

from persid._dyadics import is_dyadic
from persid_check.enclosure import UndefinedError, between, value
from persid_check.ledger.lemmas import SLOPES, SUMMED, Cuts, Functions, Lemma, Product, variable
from persid_check.search.side import kinks

GERMS = tuple(Fraction(2) ** k for k in (20, 8, 6, 4, 3, 2, 1, 0, -1, -2, -3, -4, -6, -8, -12, -18, -24))
TAILS = tuple(Fraction(2) ** k for k in (3, 5, 8, 12, 20))
PROBES = tuple(s * Fraction(3 * 2 ** (k + 8), 1024) for k in range(-6, 6) for s in (1, -1))  # 0.01 to 24, and minus
PIECES = 3000  # of a partition
FINEST = Fraction(1, 2**40)
BITS = 40  # of a cut between the centre and an end
_ZERO = Fraction(0)


@lru_cache(maxsize=8192)
def cuts_of(lemma: Lemma, domain: tuple[Fraction, Fraction] | None) -> Cuts | None:
    """Return cuts on which the checker proves a lemma, None where none are found."""
    low, high = lemma.centre or (_ZERO, _ZERO)
    if lemma.kind in SLOPES and domain is None and lemma.centre is not None:  # its pieces do not know the centre
        found = cuts_of(replace(lemma, centre=None), None)
        if found is None or (found[0] < low and high < found[-1]):
            return found
    if _refuted(lemma, domain):
        return None
    ends = _ends(lemma) if domain is None else (low + domain[0], high + domain[1])
    if ends is None:
        return None
    germ = _germ(lemma, ends, low, high)
    left = None if germ is None else _bisected(lemma, ends[0], germ[0])
    right = None if germ is None or left is None else _bisected(lemma, germ[-1], ends[1])
    if germ is not None and left is not None and right is not None:
        return tuple(sorted({*left, *germ, *right}))
    return _graded(lemma, ends, domain) if lemma.kind in SUMMED else None


def _refuted(lemma: Lemma, domain: tuple[Fraction, Fraction] | None) -> bool:
    """Whether the quantity is negative at some point that is tried: then there is nothing to search."""
    if lemma.kind in SUMMED or lemma.kind == "one-signed":
        return False
    low, high = lemma.centre or (_ZERO, _ZERO)
    least, most = (None, None) if domain is None else (low + domain[0], high + domain[1])
    opposite = replace(lemma, form=tuple(-v for v in lemma.form), kind="rising" if lemma.kind in SLOPES else "growing")
    for step in PROBES:
        t = step + (high if step > 0 else low)
        if (least is None or least <= t) and (most is None or t <= most) and opposite.holds_on(t, t):
            return True
    return False


def _graded(lemma: Lemma, ends: tuple[Fraction, Fraction], domain: tuple[Fraction, Fraction] | None) -> Cuts | None:
    """Return pieces that grow with the distance from the centre, for a quantity that falls below 0 where it has risen.

    Near the centre the quantity is about linear in the distance, so only pieces that are short beside it keep its sign.
    """
    low, high = lemma.centre or (_ZERO, _ZERO)
    for count in (32, 128, 512, 2048, 8192):
        left = [low - d for d in _distances(low - ends[0], count)]
        right = [high + d for d in _distances(ends[1] - high, count)]
        hinges = (t for t in _hinges(lemma.functions) if ends[0] < t < ends[1] and not low < t < high)
        cuts = _ordered([*left[::-1], *((low,) if low == high else ()), *right, *hinges])
        if lemma.unproved(cuts, domain) is None:
            return cuts
    return None


def _ordered(cuts: list[Fraction]) -> Cuts:
    """Return cuts in their order, each once: by floats, since fractions compare slowly."""
    rising = sorted(cuts, key=float)
    return tuple(t for k, t in enumerate(rising) if k == 0 or t != rising[k - 1])


def _distances(reach: Fraction, count: int) -> list[Fraction]:
    """Return distances that rise in equal ratios from a millionth of the reach, then by equal steps, to all of it.

    What is given away on a piece is about its length times the rise of the quantity on it: long pieces cost most.
    """
    ratio, step = 2.0 ** (20.0 / count), 1.0 / count
    rising = [2.0**-20]
    while rising[-1] < 1 - step:
        rising.append(min(rising[-1] * ratio, rising[-1] + step))
    unit = Fraction(2) ** (reach.numerator.bit_length() - reach.denominator.bit_length() - BITS)  # cuts are short
    return [*(unit * round(reach * Fraction(share) / unit) for share in rising), reach]


def _ends(lemma: Lemma) -> tuple[Fraction, Fraction] | None:
    """Return the nearest cuts beyond which the tails are proved and inside which all centres lie."""
    low, high = lemma.centre or (_ZERO, _ZERO)
    right = next((Y for Y in TAILS if high < Y and lemma.holds_beyond(Y, 1)), None)
    left = next((Y for Y in TAILS if low > -Y and lemma.holds_beyond(Y, -1)), None)
    return None if left is None or right is None else (-left, right)


def _germ(lemma: Lemma, ends: tuple[Fraction, Fraction], low: Fraction, high: Fraction) -> Cuts | None:
    """Return the cuts about the centre, (or about 0, for a kind that has no centre): as far as they go."""
    if lemma.kind in SLOPES or lemma.kind == "one-signed" or low == high:
        middle = _ZERO if lemma.kind in SLOPES or low != high else low
        if not ends[0] < middle < ends[1]:
            return (ends[0], ends[0])
        reach = middle - ends[0], ends[1] - middle
        left = _widest(_within(reach[0]), lambda h: lemma.holds_on(middle - h, middle))
        right = _widest(_within(reach[1]), lambda h: lemma.holds_on(middle, middle + h))
        return (middle - left, middle, middle + right)
    for h in GERMS:
        pair = (max(low - h, ends[0]), min(high + h, ends[1]))
        if lemma.holds_on(*pair):
            return pair
    return None


def _widest(widths: Sequence[Fraction], holds: Callable[[Fraction], bool]) -> Fraction:
    """Return a width at which something holds, 0 without one, by bisection: mostly it holds on narrower ones, too."""
    low, high = 0, len(widths)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(widths[middle]) else (middle + 1, high)
    return widths[low] if low < len(widths) else _ZERO


def _within(reach: Fraction) -> list[Fraction]:
    """Return widths to try beside a centre, the widest first."""
    return [reach, *(h for h in GERMS if h < reach)]


def _bisected(lemma: Lemma, a: Fraction, b: Fraction) -> list[Fraction] | None:
    return [a] if a >= b else _halved(lemma, _powers(a, b, _hinges(lemma.functions)))


def _halved(lemma: Lemma | Product, pieces: list[tuple[Fraction, Fraction]]) -> list[Fraction] | None:
    """Return the ends of pieces on each of which it holds, halved where it does not; None where that does not end."""
    cuts, finest, left = [pieces[0][0]], (pieces[-1][1] - pieces[0][0]) * FINEST, pieces[::-1]
    while left:
        lo, hi = left.pop()
        if lemma.holds_on(lo, hi):
            cuts.append(hi)
            continue
        middle = (lo + hi) / 2
        if len(cuts) + len(left) > PIECES or hi - lo < finest or not lemma.holds_on(middle, middle):
            return None
        left += [(middle, hi), (lo, middle)]
    return cuts


def _powers(a: Fraction, b: Fraction, hinges: Sequence[Fraction]) -> list[tuple[Fraction, Fraction]]:
    """Cut [a, b] at hinges and at powers of two, where other kinks like to be."""
    inner = [*hinges, *(s * Fraction(2) ** k for k in range(-4, 21) for s in (1, -1))]
    return list(pairwise(sorted({a, *(c for c in inner if a < c < b), b})))


def _hinges(functions: Functions) -> list[Fraction]:
    """Return where hinges lie; a cut is a dyadic, so one that is none is left to bisection."""
    found = (t / alpha for program, alpha in functions for t in kinks(program))
    return [t for t in found if is_dyadic(t)]


@lru_cache(maxsize=8192)
def cuts_of_product(product: Product) -> Cuts | None:
    """Return cuts on which the checker proves that a product is at least -c, None where none are found."""
    ends = [next((Y for Y in TAILS if product.holds_beyond(Y, sign)), None) for sign in (-1, 1)]
    if ends[0] is None or ends[1] is None:
        return None
    hinges = [t for t in _hinges(product.functions) if -ends[0] < t < ends[1]]
    cuts = _halved(product, _powers(-ends[0], ends[1], [*hinges, _ZERO]))
    return None if cuts is None else tuple(cuts)


def cuts_of_continuity(functions: Functions, domain: tuple[Fraction, Fraction] | None) -> Cuts | None:
    """Return cuts on which every function is proved continuous; `domain` is absolute."""
    ends = domain
    if ends is None:
        reach = next((Y for Y in TAILS if all(_runs(functions, variable(Y, s, inverse=False)) for s in (1, -1))), None)
        if reach is None:
            return None
        ends = (-reach, reach)
    cuts, pieces = [ends[0]], [ends]
    while pieces:
        lo, hi = pieces.pop()
        if _runs(functions, between(lo, hi)):
            cuts.append(hi)
            continue
        if len(cuts) > PIECES or hi - lo < (ends[1] - ends[0]) * FINEST:
            return None
        pieces += [((lo + hi) / 2, hi), (lo, (lo + hi) / 2)]
    return tuple(cuts)


def _runs(functions: Functions, y) -> bool:  # type: ignore[no-untyped-def]
    try:
        for program, alpha in functions:
            value(program, y.constant(alpha) * y)
    except UndefinedError:
        return False
    return True
