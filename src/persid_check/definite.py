"""Positive definite, exactly: by a factor T, C = T M T' dominant, or by a root L, M less L L' dominant.

Section 6 of the specification. T and L are untrusted: lower triangular rows of integers. With T: C > 0 by Gershgorin,
so T is nonsingular, and M = T^-1 C T^-T > 0; C bounds r'M^-1 r, too. With L: M is L L' >= 0 and what is > 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from persid_check.exact import Matrix, Number, matrix
from persid_check.work import spend

Factor = Sequence[Sequence[int]]
BITS = 192  # of a summand of a bound
SUMMAND = 8  # steps that one counts for: a quotient of long numbers
_ZERO = Fraction(0)


@dataclass(frozen=True)
class Root:
    """L and the scaling of M: 2**bits H M H - L L', H = diag(2**shift_i), is strictly diagonally dominant.

    L is given by its rows, or whole, as it was read from a companion.
    """

    shifts: tuple[int, ...]
    bits: int
    L: Factor | Matrix

    @property
    def matrix(self) -> Matrix | None:
        """L as a square matrix; None where the rows are not those of one."""
        size = len(self.shifts)
        if isinstance(self.L, Matrix):
            return self.L if self.L.shape == (size, size) else None
        return lower_triangular(self.L) if _is_lower(self.L, size) else None


@dataclass(frozen=True)
class Definite:
    """A proof that M > 0: T, and the gaps delta_i > 0 with T M T' >= diag(delta)."""

    factor: Factor
    gaps: tuple[Fraction, ...]

    def bounds(self, rows: Sequence[Mapping[int, Fraction]]) -> list[Fraction]:
        """Return a number >= r'M^-1 r = (T r)'C^-1 (T r) for each row; each summand is rounded up, to BITS bits."""
        size = len(self.gaps)
        spend(SUMMAND * len(rows) * size)
        R = matrix([[row.get(j, _ZERO) for j in range(size)] for row in rows], size)
        products = R * lower_triangular(self.factor).T
        return [
            sum((_quotient_up(products.entry(i, j), gap) for j, gap in enumerate(self.gaps)), _ZERO)
            for i in range(len(rows))
        ]


def _quotient_up(entry: Fraction, gap: Fraction) -> Fraction:
    """Return entry**2 / gap, rounded up to about BITS bits."""
    above, below = entry.numerator**2 * gap.denominator, entry.denominator**2 * gap.numerator
    shift = BITS + below.bit_length() - above.bit_length()
    lifted = -(-(above << max(shift, 0)) // (below << max(-shift, 0)))
    return Fraction(lifted) / Fraction(2) ** shift


def lower_triangular(T: Factor) -> Matrix:
    """Return the square matrix of lower rows."""
    size = len(T)
    return matrix([[*row, *(0,) * (size - 1 - i)] for i, row in enumerate(T)], size)


def _is_lower(T: Factor, size: int) -> bool:
    return len(T) == size and all(len(row) == i + 1 for i, row in enumerate(T))


def proof_of(M: Matrix, T: Factor) -> Definite | None:
    """Return the proof that M > 0, None where T does not give one."""
    size = M.height
    if M.width != size or not _is_lower(T, size):
        return None
    if M.entries != M.entries.transpose():
        return None
    if not size:
        return Definite((), ())
    factor = lower_triangular(T)
    C = factor * M * factor.T
    heads = [int(C.entries[i, i]) for i in range(size)]
    if any(head <= 0 for head in heads):
        return None
    halves = [
        (head.bit_length() - C.exponent) // 2 for head in heads
    ]  # D = diag(2**-half): D C D has a diagonal near 1
    top = max(halves)
    gaps = C.gaps([top - half for half in halves])  # those of D C D, 2**top / D_i times as large
    if any(gap <= 0 for gap in gaps):
        return None
    scales = [1 << (top - half) for half in halves]
    return Definite(T, tuple(Fraction(gap, scale << C.exponent) for gap, scale in zip(gaps, scales, strict=True)))


def has_root(M: Matrix, root: Root) -> bool:
    """Prove M > 0: 2**bits H M H = L L' + F with F strictly diagonally dominant, so F > 0, and L L' >= 0."""
    size, L = M.height, root.matrix
    if M.width != size or len(root.shifts) != size or L is None or M.entries != M.entries.transpose():
        return False
    if not size:
        return True
    least = min(root.shifts)
    scaled = M.scaled([shift - least for shift in root.shifts])
    lifted = replace(scaled, exponent=scaled.exponent - root.bits - 2 * least)
    return all(gap > 0 for gap in (lifted + -L.squared()).gaps([0] * size))


def proves(proof: Factor | Root, M: Matrix) -> bool:
    """Prove M > 0 exactly with an untrusted factor or root."""
    return has_root(M, proof) if isinstance(proof, Root) else proof_of(M, proof) is not None


def is_positive_definite(M: Matrix | Sequence[Sequence[Number]], T: Factor | Root) -> bool:
    """Prove M > 0 exactly with an untrusted lower triangular integer T, whose row i has i + 1 entries, or a root."""
    return proves(T, M if isinstance(M, Matrix) else matrix(M, len(M)))
