"""Partitions: where a lemma about one function is cut, so that the checker proves it piece by piece without a search.

The search is here. Pieces are bisected in floating point, many at once, until the checker's evaluation seems to succeed
on all; then it is asked. Where it does not succeed they are bisected until it does; a point where it fails ends that.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy import ndarray

from persid._dyadics import is_dyadic
from persid.certificates.guesses import least_on, mean_on, rise_on
from persid_check.enclosure import UndefinedError, between, value
from persid_check.ledger.lemmas import SLOPES, SUMMED, Cuts, Functions, Lemma, Product, variable
from persid_check.search.side import kinks

GERMS = tuple(Fraction(2) ** k for k in (20, 8, 6, 4, 3, 2, 1, 0, -1, -2, -3, -4, -6, -8, -12, -18, -24))
TAILS = tuple(Fraction(2) ** k for k in (3, 5, 8, 12, 20))
PROBES = np.geomspace(1e-3, 30, 100)  # distances from the centre at which a quantity is looked at
PIECES = 3000  # of a partition
FEW = 100  # halvings that are guessed; where more are needed expansions about the centre may do with fewer
FINEST = Fraction(1, 2**40)
BITS = 40  # of a cut between the centre and an end
_ZERO = Fraction(0)
Piece = tuple[Fraction, Fraction]


@lru_cache(maxsize=8192)
def cuts_of(lemma: Lemma, domain: Piece | None) -> Cuts | None:
    """Return cuts on which the checker proves a lemma, None where none are found."""
    low, high = lemma.centre or (_ZERO, _ZERO)
    if lemma.kind in SLOPES and domain is None and lemma.centre is not None:  # its pieces do not know the centre
        found = cuts_of(replace(lemma, centre=None), None)
        if found is None or (both_sides(found)[0] < low and high < found[-1]):
            return found
    negative = _seems_negative(lemma, domain)
    if negative and lemma.kind not in SUMMED:
        return None
    ends = _ends(lemma, domain)
    if ends is None:
        return None
    cuts = None if negative else _guessed(lemma, domain, ends) or _searched(lemma, domain, ends)
    return _graded(lemma, domain, ends) if cuts is None and lemma.kind in SUMMED else cuts


def _seems_negative(lemma: Lemma, domain: Piece | None) -> bool:
    """Whether the quantity is negative in floats at some point that is tried: then there is nothing to search."""
    low, high = (float(t) for t in lemma.centre or (0, 0))
    tried = np.concatenate([low - PROBES, high + PROBES])
    if domain is not None:
        tried = tried[(low + float(domain[0]) <= tried) & (tried <= high + float(domain[1]))]
    value, known = least_on(lemma, tried, tried)
    return bool((value < -known).any())


def _guessed(lemma: Lemma, domain: Piece | None, ends: Piece) -> Cuts | None:
    """Return a few cuts that floats suggest; None where the checker does not prove it."""
    germ = _seen_germ(lemma, ends)
    cuts = None if germ is None else _halved_in_floats(lemma, ends, germ, FEW)
    return cuts if cuts is not None and lemma.unproved(cuts, domain) is None else None


def _searched(lemma: Lemma, domain: Piece | None, ends: Piece) -> Cuts | None:
    """Return cuts that the checker's evaluation has found, those about the centre first."""
    germ = _germ(lemma, ends)
    cuts = None if germ is None else _halved_in_floats(lemma, ends, germ, PIECES)
    if cuts is None or lemma.unproved(cuts, domain) is None:
        return cuts
    found = _halved(lemma, list(pairwise(cuts)))
    return None if found is None else tuple(found)


def _seen_germ(lemma: Lemma, ends: tuple[Fraction, Fraction]) -> Cuts | None:
    """Return the cuts about the centre, or about 0 for a kind that has none, as far as they seem to go, if at all."""
    low, high = lemma.centre or (_ZERO, _ZERO)
    middle = _ZERO if lemma.kind in SLOPES else low
    if lemma.kind not in (*SLOPES, "one-signed") and low != high:
        return _seen_widest(lemma, [(max(low - h, ends[0]), min(high + h, ends[1])) for h in GERMS])
    if not ends[0] <= middle < ends[1]:
        return (ends[0],)
    left = _seen_widest(lemma, [(middle - h, middle) for h in _within(middle - ends[0])])
    right = _seen_widest(lemma, [(middle, middle + h) for h in _within(ends[1] - middle)])
    return None if left is None or right is None else (left[0], middle, right[1])


def _seen_widest(lemma: Lemma, pieces: Sequence[Piece]) -> Piece | None:
    """Return the widest of pieces about the centre on which the quantity seems to be positive."""
    lo, hi = _floats(pieces)
    seems = least_on(lemma, lo, hi)[0] >= 0 if lemma.kind in (*SLOPES, "one-signed") else mean_on(lemma, lo, hi)
    return pieces[int(seems.argmax())] if seems.any() else None


def _halved_in_floats(lemma: Lemma, ends: Piece, germ: Cuts, most: int) -> Cuts | None:
    """Return cuts about the centre with others beside it, halved where the quantity seems to be negative on a piece.

    A piece on which it is not defined in floats stays, and one that is very short; None where there are too many.
    """
    sides = (ends[0], germ[0]), (germ[-1], ends[1])
    pieces = [piece for a, b in sides if a < b for piece in _powers(a, b, _hinges(lemma.functions))]
    found, (lo, hi), finest = list[float](), _floats(pieces), float(FINEST * (ends[1] - ends[0]))
    while len(lo):
        value, known = least_on(lemma, lo, hi)
        more = (value < -known) & (hi - lo > finest)
        lo, hi = lo[more], hi[more]
        middle = (lo + hi) / 2
        found += middle.tolist()
        if len(found) > most:
            return None
        lo, hi = np.concatenate([lo, middle]), np.concatenate([middle, hi])
    return _ordered([*ends, *germ, *(t for piece in pieces for t in piece), *map(Fraction, found)])


def _floats(pieces: Sequence[Piece]) -> tuple[ndarray, ndarray]:
    ends = np.array([(float(a), float(b)) for a, b in pieces]).reshape(-1, 2)
    return ends[:, 0], ends[:, 1]


def _graded(lemma: Lemma, domain: Piece | None, ends: Piece) -> Cuts | None:
    """Return pieces that grow with the distance from the centre, for a quantity that falls below 0 where it has risen.

    Near the centre the quantity is about linear in the distance, so only pieces that are short beside it keep its sign.
    """
    low, high = lemma.centre or (_ZERO, _ZERO)
    middle = [low] if low == high else []
    outward = [(low, -1, low - ends[0]), (high, 1, ends[1] - high)]
    hinges = [t for t in _hinges(lemma.functions) if ends[0] < t < ends[1] and not low < t < high]
    for count in (16, 64, 256, 1024, 8192):
        sides = [
            [*middle, *(start + sign * d for d in _distances(reach, count))] for start, sign, reach in outward if reach
        ]
        thin = [_thinned(lemma, side) for side in sides]
        if all(thin):
            for each in (thin, sides):
                cuts = _ordered([*(t for side in each for t in side), *hinges])
                if lemma.unproved(cuts, domain) is None:
                    return cuts
    return None


def _thinned(lemma: Lemma, outward: list[Fraction]) -> list[Fraction]:
    """Return some of the cuts on one side, with which the sum still seems to stay above 0; none if it does not on all.

    Two blocks of pieces become one where that loses a small share of what the sum has left from there on.
    """
    t = np.array([float(v) for v in outward])
    rises = [_rise(lemma, t[:: 2**k]) for k in range((len(t) - 1).bit_length())]
    total = float(lemma.allowance) + np.cumsum(rises[0])
    if total.min() < 0:
        return []
    left = np.minimum.accumulate(total[::-1])[::-1]
    for share in 0.5 ** np.arange(24):
        blocks, kept = np.ones(len(rises[0]), bool), [np.arange(len(rises[0]))]
        for k, rise in enumerate(rises[1:], start=1):
            pairs = 2 * len(rise)
            lost = rises[k - 1][:pairs].reshape(-1, 2).sum(axis=1) - rise
            ends = 2**k * np.arange(1, len(rise) + 1) - 1
            joined = blocks[:pairs].reshape(-1, 2).all(axis=1) & (lost <= share * left[ends])
            kept[-1] = kept[-1][~np.isin(kept[-1] >> k, np.flatnonzero(joined))]
            kept.append(2**k * np.flatnonzero(joined))
            blocks = joined
        starts = np.concatenate(kept)
        order = np.argsort(starts)
        sums = np.concatenate([rises[k][at >> k] for k, at in enumerate(kept)])[order]
        if (float(lemma.allowance) + np.cumsum(sums)).min() >= 0:
            return [*(outward[i] for i in starts[order]), outward[-1]]
    return outward


def _rise(lemma: Lemma, t: ndarray) -> ndarray:
    """Return by how much the sum rises at least from each cut to the next, outward, as far as floats tell."""
    lo, hi = np.minimum(t[:-1], t[1:]), np.maximum(t[:-1], t[1:])
    rise = rise_on(lemma, lo, hi)
    about = float((lemma.centre or (_ZERO, _ZERO))[0])
    held = ((lo == about) | (hi == about)) & mean_on(lemma, lo, hi)
    return np.asarray(np.where(held, np.fmax(rise, 0.0), rise))


def both_sides(cuts: Cuts) -> Cuts:
    """Return cuts with their mirror image, where they begin at 0 and so speak of both sides."""
    return (*(-t for t in cuts[:0:-1]), *cuts) if cuts[0] == 0 else cuts


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
    units = float(reach / unit)
    return [*(unit * round(units * share) for share in rising), reach]


def _ends(lemma: Lemma, domain: Piece | None) -> Piece | None:
    """Return the domain, or the nearest cuts beyond which the tails are proved and inside which all centres lie.

    Where both sides are alike they begin at 0.
    """
    low, high = lemma.centre or (_ZERO, _ZERO)
    if domain is not None:
        first, last = low + domain[0], high + domain[1]
        return (_ZERO if lemma.even and first == -last else first), last
    if lemma.even:
        right = _tail(lemma, max(high, -low), 1)
        return None if right is None else (_ZERO, right)
    right, left = _tail(lemma, high, 1), _tail(lemma, -low, -1)
    return None if left is None or right is None else (-left, right)


def _tail(lemma: Lemma, beyond: Fraction, sign: int) -> Fraction | None:
    """Return the nearest cut from which on a tail is proved, None without one."""
    return next((Y for Y in TAILS if beyond < Y and lemma.holds_beyond(Y, sign)), None)


def _germ(lemma: Lemma, ends: Piece) -> Cuts | None:
    """Return the cuts about the centre, (or about 0, for a kind that has no centre): as far as they go."""
    low, high = lemma.centre or (_ZERO, _ZERO)
    if lemma.kind in SLOPES or lemma.kind == "one-signed" or low == high:
        middle = _ZERO if lemma.kind in SLOPES or low != high else low
        if not ends[0] <= middle < ends[1]:
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


def _halved(lemma: Lemma | Product, pieces: list[Piece]) -> list[Fraction] | None:
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


def _powers(a: Fraction, b: Fraction, hinges: Sequence[Fraction]) -> list[Piece]:
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


@lru_cache(maxsize=8192)
def cuts_of_continuity(functions: Functions, domain: Piece | None) -> Cuts | None:
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
