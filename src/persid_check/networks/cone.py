"""Generators of a small polyhedral cone, by the double description method in integers."""

from collections.abc import Sequence
from fractions import Fraction
from math import gcd, lcm

from persid_check.results import NotProvedError
from persid_check.work import spend

MAX_RAYS = 2000  # met on the way: a cone in 9 dimensions cut out by 128 forms could have millions

Vector = tuple[int, ...]


def generators(forms: Sequence[Sequence[Fraction]], size: int) -> tuple[Vector, ...]:
    """Return vectors whose conic hull is exactly {v in R^size : l'v >= 0 for every form l}.

    Directions along which the cone is a whole line come with both signs. The cone starts as R^size, a hull of lines,
    and is cut by one form after the other (Motzkin, Raiffa, Thompson, Thrall 1953).

    Raises:
        NotProvedError: more than MAX_RAYS generators are met.
    """
    lines = [tuple(int(i == j) for j in range(size)) for i in range(size)]
    rays: list[Vector] = []
    used: list[Vector] = []
    for form in forms:
        cut = _primitive([int(c * lcm(*(v.denominator for v in form))) for c in form])
        used.append(cut)
        crossing = next((line for line in lines if _dot(cut, line)), None)
        if crossing is not None:
            spend(8 * (len(lines) + len(rays)) * words([*lines, *rays, cut]))
            lines, rays = _cut_a_line(cut, crossing, lines, rays)
        else:
            rays = _halved(cut, rays)
            spend(len(rays) * len(used) * words(rays))
            rays = _extreme(rays, used)
    return (*rays, *lines, *(tuple(-c for c in line) for line in lines))


def _cut_a_line(
    cut: Vector, crossing: Vector, lines: list[Vector], rays: list[Vector]
) -> tuple[list[Vector], list[Vector]]:
    """Of the line that leaves the half space only one half stays; all else is moved along it into the plane."""
    up = crossing if _dot(cut, crossing) > 0 else tuple(-c for c in crossing)
    others = [line for line in lines if line is not crossing]
    into_plane = [[_combined(_dot(cut, up), v, -_dot(cut, v), up) for v in vectors] for vectors in (others, rays)]
    return into_plane[0], [*into_plane[1], up]


def _halved(cut: Vector, rays: list[Vector]) -> list[Vector]:
    """Return the rays in the half space, and for each pair across its border the ray of their hull on the border."""
    heights = [(_dot(cut, ray), ray) for ray in rays]
    inside = [ray for height, ray in heights if height >= 0]
    above = [pair for pair in heights if pair[0] > 0]
    below = [pair for pair in heights if pair[0] < 0]
    if len(inside) + len(above) * len(below) > MAX_RAYS**2 // 16:
        raise NotProvedError("kinds", "the cone of the forms has too many generators; fewer forms are needed")
    spend(8 * len(above) * len(below) * words(rays))
    return inside + [_combined(h, low, -g, high) for h, high in above for g, low in below]


def _extreme(rays: list[Vector], used: list[Vector]) -> list[Vector]:
    """Return one ray for each largest set of forms that vanish on one.

    A cone's faces correspond one to one to the sets of forms that vanish on them; on an extreme ray vanish strictly
    more than on any larger face, and two rays of the same set differ by a multiple and by a line of the cone.
    """
    vanishing = {frozenset(f for f, form in enumerate(used) if not _dot(form, ray)): ray for ray in rays}
    if len(vanishing) > MAX_RAYS:
        raise NotProvedError("kinds", "the cone of the forms has too many generators; fewer forms are needed")
    return [ray for where, ray in vanishing.items() if not any(where < other for other in vanishing)]


def words(vectors: Sequence[Vector]) -> int:
    """How many steps a product of two vectors counts for: one for each 256 bits of the largest entry.

    From 2048 bits on it grows with the square, as the time of common divisors does.
    """
    size = 1 + max((abs(c).bit_length() for vector in vectors for c in vector), default=0) // 256
    return size * max(1, size // 8)


def _combined(p: int, v: Vector, q: int, w: Vector) -> Vector:
    return _primitive([p * a + q * b for a, b in zip(v, w, strict=True)])


def _primitive(vector: list[int]) -> Vector:
    divisor = gcd(*vector) or 1
    return tuple(c // divisor for c in vector)


def _dot(a: Vector, b: Vector) -> int:
    return sum(p * q for p, q in zip(a, b, strict=True))
