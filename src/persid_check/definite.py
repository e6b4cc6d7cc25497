"""Positive definite, exactly: C = T M T' strictly diagonally dominant; and bounds of r'M^-1 r from the same C.

Section 6 of the specification. T is untrusted: lower triangular rows of integers. As C > 0, T is nonsingular, and
M = T^-1 C T^-T > 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import fmpz_mat

from persid_check.exact import Matrix, Number, matrix
from persid_check.work import spend

Factor = Sequence[Sequence[int]]
BITS = 192  # of a summand of a bound
_ZERO = Fraction(0)


@dataclass(frozen=True)
class Definite:
    """A proof that M > 0: T, and the gaps delta_i > 0 with T M T' >= diag(delta)."""

    factor: Factor
    gaps: tuple[Fraction, ...]

    def bounds(self, rows: Sequence[Mapping[int, Fraction]]) -> list[Fraction]:
        """Return a number >= r'M^-1 r = (T r)'C^-1 (T r) for each row; each summand is rounded up, to BITS bits."""
        size = len(self.gaps)
        spend(len(rows) * size)
        R = matrix([[row.get(j, _ZERO) for j in range(size)] for row in rows], size)
        products = R * Matrix(lower_triangular(self.factor).transpose(), 0)
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


def lower_triangular(T: Factor) -> fmpz_mat:
    """Return the square matrix of lower rows."""
    size = len(T)
    return fmpz_mat(size, size, [v for i, row in enumerate(T) for v in (*row, *(0,) * (size - 1 - i))])


def proof_of(M: Matrix, T: Factor) -> Definite | None:
    """Return the proof that M > 0, None where T does not give one."""
    size = M.height
    if M.width != size or len(T) != size or any(len(row) != i + 1 for i, row in enumerate(T)):
        return None
    if M.entries != M.entries.transpose():
        return None
    if not size:
        return Definite((), ())
    factor = Matrix(lower_triangular(T), 0)
    C = factor * M * factor.T
    rows = C.entries.table()
    heads = [int(rows[i][i]) for i in range(size)]
    if any(head <= 0 for head in heads):
        return None
    halves = [
        (head.bit_length() - C.exponent) // 2 for head in heads
    ]  # D = diag(2**-half): D C D has a diagonal near 1
    least = min(halves)
    halves = [half - least for half in halves]  # a common factor of D changes nothing
    top = max(halves)
    sizes = fmpz_mat(size, size, [abs(value) for row in rows for value in row])
    sums = (sizes * fmpz_mat(size, 1, [1 << (top - half) for half in halves])).table()
    gaps = [(2 * heads[i] << top) - (int(sums[i][0]) << halves[i]) for i in range(size)]
    if any(gap <= 0 for gap in gaps):
        return None
    return Definite(T, tuple(Fraction(gap, 1 << (top + C.exponent)) for gap in gaps))


def is_positive_definite(M: Matrix | Sequence[Sequence[Number]], T: Factor) -> bool:
    """Prove M > 0 exactly with an untrusted lower triangular integer T, whose row i has i + 1 entries."""
    return proof_of(M if isinstance(M, Matrix) else matrix(M, len(M)), T) is not None
