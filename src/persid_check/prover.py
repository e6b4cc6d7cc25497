"""stub"""

from fractions import Fraction
from persid_check.expression import Program

Curve = tuple[tuple[Program, Fraction], ...]
Form = tuple[Fraction, ...]
Domain = tuple[Fraction, Fraction] | None
Shift = tuple[Fraction, Fraction] | None


def _no(*args):
    return False


prove_continuous = prove_integral_lower = prove_integral_unbounded = prove_integral_upper = prove_nondecreasing = (
    prove_radially_unbounded
) = prove_sector_form = prove_strict_sector_form = prove_strictly_increasing = prove_bounded = _no
