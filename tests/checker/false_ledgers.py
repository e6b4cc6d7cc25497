"""Ledgers that must not be accepted, five at least for each kind of fact: known ledgers with some places changed."""

import copy
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from checker import false_steps, known_ledgers
from checker.edits import GONE, Edit, M, R, _f, _is, _l
from checker.ledgers import data, number, rehashed
from persid.certificates.ledger import with_proof
from persid.errors import RoundingError
from persid_check import FormatError, model_sha256
from persid_check.results import NotProvedError


@dataclass(frozen=True)
class Falsehood:
    """A file that must not be accepted."""

    name: str
    expected: str
    why: str
    content: Callable[[], bytes]


def changed(base: str, edits: tuple[Edit, ...], *, refactored: bool = False) -> bytes:
    """A known ledger with some places set; the hash fits, and `refactored` makes factors for the new matrices."""
    content = copy.deepcopy(known_ledgers.load(base))
    for path, value in edits:
        at: Any = content
        for key in path[:-1]:
            at = at[key]
        if value is GONE:
            del at[path[-1]]
        elif callable(value):
            at[path[-1]] = value(at[path[-1]])
        else:
            at[path[-1]] = value
    if any(path[0] == "model" for path, _ in edits) and refactored:
        content["model_sha256"] = model_sha256(content["model"])
    if refactored:
        with suppress(RoundingError, FormatError, NotProvedError):  # then the factors stay as they are
            content = with_proof(content)
    return data(content)


FALSEHOODS: list[Falsehood] = []


def _set(name: str, base: str, expected: str, why: str, *edits: Edit) -> None:
    FALSEHOODS.append(Falsehood(name, expected, why, lambda: changed(base, edits, refactored=expected == R)))


def _cuts(k: int, cuts: Any) -> Edit:
    return (("curves", 0, "forms", k, "cuts"), cuts)


# --- value facts and forms
V = "rated"
_set(
    "sector_too_steep",
    V,
    R,
    "tanh - 1.01 y has the wrong sign",
    _l(0, -1.01, 1),
    _is(0, "sector"),
)
_set("sector_negative", V, R, "-tanh is no sector form", _l(0, 0, -1))
_set("sector_just_false", V, R, "y - 1.0001 tanh falls near 0", _l(1, 1, -1.0001), _is(1, "sector"))
_set("cosine", V, R, "cos is no sector function", *_f("cos(x)"))
_set("cosine_as_nondecreasing", V, R, "cos falls", *_f("cos(x)"), _is(0, "nondecreasing"))
_set("not_at_rest", V, R, "tanh(x + 1) is nondecreasing and not 0 at 0", *_f("tanh(x+1)"))
_set("one_over_x", V, R, "1/x is not continuous", *_f("1/x"))
_set("root", V, R, "the root is not defined below 0", *_f("sqrt(x)"))
_set("nondecreasing_sine", V, R, "sin falls from pi/2 on", *_f("sin(x)"))
_set("cuts_that_skip", V, R, "cuts must hold 0 inside", _cuts(0, [0, [1, 2]]))
_set("cuts_on_one_side", V, R, "cuts must hold 0 inside", _cuts(0, [0, [-4, 0]]))
_set("cuts_fall", V, M, "cuts rise", _cuts(0, [0, [1, 0]]))
_set("cuts_twice", V, M, "cuts rise strictly", _cuts(0, [0, [0, 0]]))
_set("cuts_none", V, M, "there is one at least", _cuts(0, [0, []]))
_set("cuts_float", V, M, "integers", _cuts(0, [0, [0.5, 1]]))
_set("cuts_deep", V, M, "an exponent beyond all use", _cuts(0, [10**9, [-1, 1]]))
_set(
    "one_signed_in_a_value",
    "one_signed",
    R,
    "a one-signed form is no sector form",
    (("facts", "value", 0), [0, 2, 3, [1, 0]]),
)
_set("tau_negative", V, M, "a multiplier is negative", (("facts", "value", 0, 3), [-1, 0]))
_set("form_beyond", V, M, "no such form", (("facts", "value", 0, 1), 9))
_set("point_beyond", V, M, "no such point", (("facts", "value", 0, 0), 2))
_set("growing_tanh", "m_cubes", R, "tanh does not grow", *_f("tanh(x)"))
_set("growing_dead_zone", "m_cubes", R, "the dead zone rests", *_f("deadzone(x)"))
_set("growing_one_sided", "m_cubes", R, "expm1 does not grow below", *_f("expm1(x)"))
_set("spanning_sector", "m_cubes", R, "a sector form need not grow", _is(0, "sector"))
_set("spanning_without", "m_cubes", R, "nothing spans", (("spanning",), []))
_set("spanning_of_one", "m_cubes", R, "one of two rows", (("spanning",), lambda listed: listed[:1]))
_set("spanning_no_density", "m_cubes", R, "mu = 0", (("points", 0, "densities", 0, 1), [0, 0]))
_set("spanning_needless", V, R, "no state is dropped", (("spanning",), [[0, 0]]))

# --- tables of knots and values
L = "lookup"


def _table(*changes: tuple[str, str]) -> tuple[Edit, ...]:
    text = known_ledgers.TABLE
    for old, new in changes:
        text = text.replace(old, new)
    return _f(text)


_LONG = ", ".join(f"{k}.{'0' * 60}: {k}.{'0' * 60}" for k in range(40))
_set("table_sector_a_hair_too_tight", L, R, "2 y it is", _l(1, 2 - 2**-20, -1), _is(1, "sector"))
_set("table_slope_a_hair_too_small", L, R, "slope 2 on the left", _l(1, 2 - 2**-40, -1))
_set("table_slope_of_rest", L, R, "it rests on one piece", _l(0, -(2**-40), 1))
_set("table_falls_on_one_piece", L, R, "its last piece falls", *_table(("2: 0.75", "2: 0.7499999999")))
_set("table_falls_inside", L, R, "a piece inside falls", *_table(("0.5: 0,", "0.5: -1e-9,")))
_set("table_steep_on_one_piece", L, R, "slope 2.01 there", *_table(("1.25: 0.75, 2: 0.75", "0.6: 0.201, 2: 0.75")))
_set("table_nearly_jumps", L, R, "slope 1e300", *_table(("0: 0, 0.5: 0", "0: 0, 1e-300: 1e-9, 0.5: 1e-9")))
_set("table_not_at_rest", L, R, "not 0 at 0", *_table(("0: 0, 0.5: 0", "0: 1e-9, 0.5: 1e-9")))
_set("table_does_not_grow", L, R, "its last piece is flat", _is(0, "growing"))
_set("table_does_not_rise", L, R, "it rests on one piece", _is(0, "rising"))
_set(
    "table_integral",
    L,
    R,
    "the flat end wants 1",
    (("curves", 0, "forms", 0, "upper"), [[127, -7], [0, 0], [0, [-8, 0, 8]]]),
)
_set("table_of_another", L, R, "the model's has another value",
     (("curves", 0, "functions", 0, 0), known_ledgers.TABLE.replace("2: 0.75", "2: 0.76")))  # fmt: skip
for _name, _change in {
    "jumps": ("0.5: 0", "0: 0.5"), "falls_back": ("0.5: 0", "-0.1: 0"), "of_nothing": ("-1.5: -2.25", ""),
    "ends": ("-1.5: -2.25", "-1.5"), "infinite": ("0.75", "1e999"), "of_words": ("0.75", "x"),
    "of_a_sum": ("(x;", "(x+1;"), "without_x": ("(x;", "("), "open": ("0.75)", "0.75"), "long": ("2: 0.75", _LONG),
    "of_many_knots": ("2: 0.75", ", ".join(f"{k}: 1" for k in range(2, 90))), "of_no_name": ("pwl(x", "x(x"),
    "of_one": (known_ledgers.TABLE, "pwl(x; 0: 0)"), "of_two_signs": ("-2.25", "--2.25"),
}.items():  # fmt: skip
    _set(f"table_{_name}", L, M, "no table", *_table(_change))

# --- points
_set("other_function", V, R, "the curve has another function", (("curves", 0, "functions", 0, 0), "sinh(x)"))
_set("other_factor", V, R, "the row is not a multiple", (("curves", 0, "functions", 0, 1), [2, 0]))
_set("negative_factor", V, R, "the row is not this multiple", (("curves", 0, "functions", 0, 1), [-1, 0]))
_set("no_factor", V, M, "a factor is not 0", (("curves", 0, "functions", 0, 1), [0, 0]))
_set("mirrored_twice", "mirrored", R, "relu(-y) is not relu(y)", (("curves", 0, "functions", 1, 1), [1, 0]))
_set("mirrored_none", "mirrored", R, "both rows are -1", (("curves", 0, "functions", 0, 1), [-1, 0]))
_set("mirrored_row", "mirrored", R, "the point looks the other way", (("points", 0, "row"), [[0, [-1, 0]]]))
_set("mirrored_exchanged", "mirrored", R, "each channel has the other's row", (("points", 0, "channels"), [1, 0]))
_set("mirrored_sign", "mirrored", R, "relu(-y) falls", (("curves", 0, "forms", 3, "l", 2), [1, 0]))
_set("mirrored_sum", "mirrored", R, "|y| - y falls", (("curves", 0, "forms", 6, "l", 2), [1, 0]))
_set(
    "mirrored_odd",
    "mirrored",
    R,
    "relu(-y) is not -relu(y)",
    (("curves", 0, "forms", 4, "l", 2), [-1, 0]),
    (("curves", 0, "forms", 4, "is"), "sector"),
    (("curves", 0, "forms", 4, "l", 0), [-1, 0]),
)
_set("other_row", V, R, "the row of another channel", (("points", 0, "row"), [[1, [1, 0]]]))
_set("other_channel", V, R, "the channel of another row", (("points", 0, "channels", 0), 1))
_set("no_row", V, R, "an empty row", (("points", 0, "row"), []))
_set(
    "channel_nowhere",
    V,
    R,
    "a channel without a point",
    (("points", 1), lambda point: point | {"channels": [0], "row": [[0, [1, 0]]]}),
)
_set("shift_without_point", V, R, "no operating point, no shift", (("curves", 0, "shift"), [[0, 0], [0, 0]]))
_set("any_without_point", V, R, "no operating point, no shift", (("curves", 0, "shift"), "any"))
_set("shift_absent", "ball", R, "the curve is looked at about 0", (("curves", 0, "shift"), None))
_set("shift_elsewhere", "ball", R, "the centre is not in the ball", (("curves", 0, "shift", 0), [4, 0]))
_set("shift_too_narrow", "ball", R, "the ball is smaller than the equilibrium's", (("curves", 0, "shift", 1), [0, 0]))
_set("shift_negative", "ball", M, "a radius is not negative", (("curves", 0, "shift", 1), [-1, 0]))
_set("ball_elsewhere", "g_ball", R, "no equilibrium there", (("operating_point", "x", 0), [2, 0]))
_set("ball_other_input", "g_ball", R, "the equilibrium of another input", (("operating_point", "u", 0), [2, 0]))
_set("ball_exact", "g_ball", R, "the centre is no equilibrium exactly", (("operating_point", "radius"), [0, 0]))

# --- integrals
S = "spring"
_set("upper_of_cube", S, R, "the integral of y^3 is y^4 / 4", (("curves", 0, "forms", 1, "upper", 0), [3, -4]))
_set(
    "upper_of_tanh",
    V,
    R,
    "tanh needs 1",
    (("curves", 0, "forms", 0, "upper"), [[3, -2], [0, 0], [0, [-8, -1, 0, 1, 8]]]),
)
_set("upper_unproved", S, R, "without cuts only c >= 1", (("curves", 0, "forms", 1, "upper", 2), None))
_set("upper_missing", S, R, "kappa needs it", (("curves", 0, "forms", 1, "upper"), None))
_set("upper_negative", S, M, "c is not negative", (("curves", 0, "forms", 1, "upper", 0), [-1, 0]))
_set("upper_offset_in_rate", S, R, "offsets belong to practical", (("curves", 0, "forms", 1, "upper", 1), [1, 0]))
_set("lower_of_sine", "region", R, "1 - cos y < 3/4 y^2", (("curves", 0, "forms", 1, "lower", 0), [3, -2]))
_set("lower_other_form", "region", R, "form j is another one", (("curves", 0, "forms", 1, "lower", 1), 0))
_set("lower_negative", "region", M, "d is not negative", (("curves", 0, "forms", 1, "lower", 0), [-1, 0]))
_set("density_one_signed", "one_signed", R, "relu - y is no density", (("points", 0, "densities", 0), [3, [1, 0]]))
_set("density_negative", V, M, "mu is not negative", (("points", 0, "densities", 0, 1), [-1, 0]))

# --- differences
D = "difference"
_set("difference_of_sectors", D, R, "x^3 - 3x^2 + 2.5x is a sector form and not monotone",
     *_f("x**3-3*x**2+2.5*x"), _is(0, "sector"))  # fmt: skip
_set("difference_of_odd_cubic", D, R, "sin(x) + x/2 is no monotone function", *_f("sin(x)+x/2"))
_set("sum_of_relu", D, R, "relu is not odd", *_f("relu(x)"))
_set("sum_of_expm1", D, R, "expm1 is not odd", *_f("expm1(x)"))
_set("difference_sign_0", D, M, "the sign is 1 or -1", (("facts", "difference", 0, 2), 0))
_set("difference_sign_2", D, M, "the sign is 1 or -1", (("facts", "difference", 0, 2), 2))
_set("difference_tau", D, M, "a multiplier is negative", (("facts", "difference", 0, 5), [-1, 0]))
_set("difference_steep", D, R, "y - 1.001 tanh falls", _l(1, 1, -1.001))


def _two_curves(content: Any) -> Any:
    return [*content, copy.deepcopy(content[0])]


_set(
    "difference_of_two_curves",
    D,
    R,
    "the two points lie on two curves",
    (("curves",), _two_curves),
    (("points", 1, "curve"), 1),
)


def _shifted(radius: Any, b: float, centres: list[Any]) -> Callable[[], bytes]:
    """The difference network at an operating point whose centres differ, or are known up to a radius."""

    def content() -> bytes:
        found = copy.deepcopy(known_ledgers.load(D))
        found["operating_point"] = {"x": centres, "radius": radius, "u": [[0, 0]]}
        found["curves"][0]["shift"] = "any"
        found["model"]["b"][0] = b.hex()
        found["model_sha256"] = model_sha256(found["model"])
        return data(found)

    return content


_Z = [[0, 0]] * 3
FALSEHOODS.append(
    Falsehood("difference_within_a_ball", R, "the centres are not known to be equal", _shifted([1, -20], 0.0, _Z))
)
FALSEHOODS.append(Falsehood("difference_at_other_point", R, "that is no equilibrium", _shifted([0, 0], 1.0, _Z)))


def _moved(name: str, base: str, at: int, value: float, shift: Any) -> None:
    """A ledger of relus about the equilibrium that has one entry `value`; b keeps it at rest exactly."""

    def content() -> bytes:
        found = copy.deepcopy(known_ledgers.load(base))
        model, n = found["model"], len(found["model"]["states"])
        term = model["terms"][0]
        term["f"] = found["curves"][0]["functions"][0][0] = "relu(x)"
        column = [round(8 * float.fromhex(row[at])) / 8 for row in term["A"]]  # few bits: all sums are exact
        for row, a in zip(term["A"], column, strict=True):
            row[at] = (a + 0.0).hex()
        model["b"] = [(value * (i == at) - a * max(value, 0.0) + 0.0).hex() for i, a in enumerate(column)]
        found["operating_point"] = {"x": [number(value * (i == at)) for i in range(n)], "radius": [0, 0], "u": [[0, 0]]}
        found["curves"][0]["shift"] = shift
        found["model_sha256"] = model_sha256(model)
        return data(found)

    FALSEHOODS.append(Falsehood(name, R, "the centres of the points differ, or the relu is shifted", content))


for _at, _value in ((0, 1.0), (1, 1.0), (2, 2.0), (0, -1.0), (1, 0.5)):
    _moved(f"difference_of_other_centres_{_at}_{_value}", D, _at, _value, "any")

# --- one-signed facts
ONE = "one_signed"
_set("one_signed_of_sector", ONE, R, "y - relu is nondecreasing, not one-signed", (("facts", "one_signed", 0, 1), 1))
_set("one_signed_negative", ONE, R, "-relu is negative", _l(2, 0, -1))
_set("one_signed_line", ONE, R, "y has both signs", _l(2, 1, 0))
_set("one_signed_tanh", ONE, R, "tanh has both signs", *_f("tanh(x)"))
_set("one_signed_steep", ONE, R, "relu - 1.01 y is negative far out", _l(3, -1.01, 1))
_set("one_signed_shifted", ONE, R, "relu(x + 1) - x is one-signed, relu(x + 1) - 1 - x is not",
     *_f("relu(x+1)-1"))  # fmt: skip
_set("one_signed_softplus", ONE, R, "softplus(x) - log 2 has both signs", *_f("softplus(x)-0.6931471805599453"))
_set("one_signed_tau", ONE, M, "a multiplier is negative", (("facts", "one_signed", 0, 4), [-1, 0]))

_set("one_signed_from_half", ONE, R, "relu(x + 1/2) - 1/2 has both signs", *_f("relu(x+0.5)-0.5"))
_set("one_signed_from_near", ONE, R, "so has a relu that is shifted by a millionth", *_f("relu(x+1e-6)-1e-6"))
_set("one_signed_from_one", ONE, R, "relu(x - 1) - x is -1 far out", *_f("relu(x-1)"))
_set("one_signed_bounded", ONE, R, "a relu that ends falls below x", *_f("relu(x)-relu(x-1)"))
for _at in (0, 1):
    _moved(f"one_signed_about_one_{_at}", ONE, _at, 1.0, [[1, -1], [1, -1]])
_moved("one_signed_about_any", ONE, 0, 1.0, "any")

# --- zero rows
_set(
    "row_not_quite_zero",
    S,
    R,
    "tau is a little too large",
    (("facts", "value", 0, 3), number(Fraction(1, 8) - Fraction(1, 64) + Fraction(1, 2**40))),
)
_set("row_of_density", S, R, "mu is not P22", (("points", 0, "densities", 0, 1), number(1 + Fraction(1, 2**30))))
_set("row_of_a_state", S, R, "the speed is not unread", (("dropped",), [2, 1]))
_set("row_of_the_wrong_entry", S, R, "the position is not unread", (("dropped",), [0]))
_set("row_kept", S, R, "a zero row is not positive", (("dropped",), []))
_set("row_twice", S, M, "an entry stands twice", (("dropped",), [2, 2]))
_set("row_beyond", S, M, "no such entry", (("dropped",), [3]))
_set(
    "row_with_damping", S, R, "the cube acts on the speed twice", (("model", "terms", 0, "A", 1, 0), (-1.0000001).hex())
)
_set("row_with_position", S, R, "the cube acts on the position", (("model", "terms", 0, "A", 0, 0), (-0.125).hex()))

# --- deviations
P = "plant"
_set("deviation_too_large", P, R, "C beyond the margin", (("deviations", 0, "C", 0, 0, 1), [2, 0]))
_set("deviation_s_zero", P, R, "s must be positive", (("deviations", 0, "s"), [0, 0]))
_set("deviation_s_negative", P, R, "s must be positive", (("deviations", 0, "s"), [-1, 0]))
_set("deviation_s_small", P, R, "s too small for the columns", (("deviations", 0, "s"), [1, -20]))
_set("deviation_columns", P, R, "the columns a hundredfold", (("deviations", 0, "columns", 0, 0, 1), [100, 0]))
_set("deviation_epsilon_negative", P, M, "epsilon is not negative", (("deviations", 0, "epsilon"), [-1, 0]))
_set("deviation_row_falls", P, M, "indices rise", (("deviations", 0, "C", 0), [[1, [1, 0]], [0, [1, 0]]]))
_set("deviation_beyond", P, M, "no such entry", (("deviations", 0, "C", 1), [[5, [1, -2]]]))
_set("deviation_on_input", P, R, "a C on the input beyond Gamma", (("deviations", 0, "C", 1), [[4, [1, 20]]]))

# --- constants (practical)
C = "practical"
_set("constant_too_small", C, R, "(y^2 - 1)^2 - 1/64 is negative at 1", (("curves", 0, "products", 0, 2), [63, -6]))
_set("constant_zero", C, R, "y (y^3 - 2 y) is negative", (("curves", 0, "products", 0, 2), [0, 0]))
_set("constant_in_iss", C, R, "constants belong to practical", (("claim",), "rate-and-gain"))
_set("offset_too_small", C, R, "the integral of y^3 - 2 y falls to -1", (("curves", 0, "forms", 1, "offset"), [31, -5]))
_set("offset_zero", C, R, "the integral of y^3 - 2 y is negative", (("curves", 0, "forms", 1, "offset"), [0, 0]))
_set(
    "offset_as_sector",
    C,
    R,
    "y^3 - 2 y is no sector form",
    (("curves", 0, "forms", 1, "offset"), [0, 0]),
    _is(1, "sector"),
)
_set("offset_of_sector", C, M, "only an offset form has one", _is(1, "sector"))
_set("practical_upper", C, R, "c too small", (("curves", 0, "forms", 1, "upper", 0), [15, -6]))
_set(
    "practical_about_a_point",
    C,
    R,
    "practical is about x_ref",
    (("operating_point",), {"x": [[0, 0]] * 2, "radius": [0, 0], "u": [[0, 0]]}),
)
_set(
    "product_cuts_short", C, R, "beyond the cuts it is not proved", (("curves", 0, "products", 0, 3), [-4, [-8, 0, 8]])
)

_set("constant_as_value", C, R, "the constant is left out: y (y^3 - 2 y) is negative",
     (("facts",), {"value": [[0, 0, 1, [1, -4]]], "one_signed": [], "difference": [], "constant": []}))  # fmt: skip
_set("constant_as_one_signed", C, R, "the same as a product of one-signed forms",
     (("facts",), {"value": [], "one_signed": [[0, 0, 0, 1, [1, -4]]], "difference": [], "constant": []}))  # fmt: skip
_set("constant_left_out_of_upper", "below", R, "y^2/2 + y is larger than y (y + 1) / 2",
     (("curves", 0, "forms", 1, "upper", 0), [1, -1]))  # fmt: skip
_set(
    "constant_below_a_square", "below", R, "1 is not larger than 1.01", (("curves", 0, "products", 0, 2), number(-1.01))
)
_set("constant_left_out_below", "below", R, "the integral of y + 1 falls to -1/2",
     (("curves", 0, "forms", 1, "offset"), [0, 0]))  # fmt: skip

# --- regions
G = "region"
_set("strip_open", G, R, "sin has no sign on all of R", (("curves", 0, "domain"), None))
_set("strip_too_wide", G, R, "sin changes its sign at pi", (("curves", 0, "domain"), [[-4, 0], [4, 0]]))
_set("strip_open_at_one_end", G, R, "the cuts end before the domain", (("curves", 0, "domain", 1), [5, -1]))
_set("strip_without_the_point", G, R, "0 is not inside", (("curves", 0, "domain"), [[1, 0], [2, 0]]))
_set("strip_on_the_point", G, R, "0 is on a face", (("curves", 0, "domain", 0), [0, 0]))
_set(
    "strip_of_the_file_narrow",
    G,
    R,
    "the level set meets the face",
    (("strips",), [[[[1, [1, 0]]], [-1, -2], [1, -2]]]),
)
_set("strip_of_the_file_without", G, R, "0 is not inside", (("strips",), [[[[1, [1, 0]]], [1, 0], [2, 0]]]))
_set("level_high", G, R, "the level set meets a face", (("level",), [4, 0]))
_set("level_zero", G, R, "an empty region", (("level",), [0, 0]))
_set("level_negative", G, R, "an empty region", (("level",), [-1, 0]))
_set("input_large", G, R, "gamma u^2 > kappa c", (("input_bound",), [1, 0]))
_set("input_negative", G, R, "a bound is not negative", (("input_bound",), [-1, 0]))
_set(
    "region_as_global",
    G,
    R,
    "the functions are known on a domain alone",
    (("claim",), "rate-and-gain"),
    (("level",), [0, 0]),
    (("input_bound",), [0, 0]),
)
_set("region_with_force", G, R, "b moves the equilibrium", (("model", "b", 1), (0.125).hex()))

_set("strip_half_open", G, R, "the upper end is beyond the cuts", (("curves", 0, "domain", 1), [1, 2000]))
_set("strip_half_open_below", G, R, "the lower end is beyond the cuts", (("curves", 0, "domain", 0), [-1, 2000]))
_set("strip_without_end", G, M, "a strip has two ends", (("curves", 0, "domain", 1), None))
_set("strip_of_one_number", G, M, "a strip has two ends", (("curves", 0, "domain"), [[-2, 0]]))
_set("strip_on_a_face", G, R, "0 is on a face", (("strips",), [[[[1, [1, 0]]], [-1, 0], [0, 0]]]))

# --- outputs
Y = "outputs"


def _seen(name: str, expected: str, why: str, *edits: Edit, hashed: bool = False, base: str = Y) -> None:
    """A false block of outputs, with the hash of the true one, or with its own."""

    def content() -> bytes:
        found = json.loads(changed(base, tuple((("outputs", *path), value) for path, value in edits)))
        return data(rehashed(found) if hashed else found)

    FALSEHOODS.append(Falsehood(name, expected, why, content))


_seen("output_bound_small", R, "c'Pt^-1 c is larger", (("constants", 0), lambda pair: [pair[0] - 1, pair[1]]))
_seen("output_bound_a_tenth_less", R, "larger", (("constants", 0), lambda pair: [pair[0] * 9 // 10, pair[1]]))
_seen("output_bound_negative", R, "a bound is positive", (("constants", 0), [-1, 0]))
_seen("output_bound_zero", R, "only a zero row has the bound 0", (("constants", 1), [0, 0]))
_seen("output_bounds_swapped", R, "that of the other one", (("constants",), lambda both: both[::-1]))
_seen("output_bounds_few", M, "one an output", (("constants",), lambda both: both[:1]))
_seen("output_row_long", R, "ten times the row", (("C", 0, 0), (20.0).hex()), hashed=True)
_seen("output_row_of_the_other_sign", R, "the other sum is larger", (("C", 0, 1), (4.0).hex()), hashed=True)
_seen("output_row_shorter", R, "it is not the model's", (("C", 0, 0), (1.0).hex()))
_seen("output_row_plain", M, "no float.hex", (("C", 0, 0), 2))
_seen("output_rows_null", M, "written out", (("C",), None))
_seen("output_names_swapped", R, "it is not the model's", (("outputs",), lambda both: both[::-1]))
_seen("output_name_twice", M, "a name stands once", (("outputs",), ["size", "size"]), hashed=True)
_seen("output_name_of_lines", M, "a name is printable", (("outputs", 0), "size\n"), hashed=True)
_seen("output_offset", R, "it is not the model's", (("d", 0), (0.0).hex()))
_seen("output_direct_zero", R, "it is not the model's", (("D", 0, 0), (0.0).hex()))
_seen("output_direct_null", M, "written out", (("D",), None), hashed=True)
_seen("output_direct_short", M, "one an input", (("D", 0), []), hashed=True)
_seen("output_direct_missing", M, "all fields are needed", (("D",), GONE))
_seen("output_map_missing", R, "it is not the model's", (("output_map",), None), (("lipschitz",), None))
_seen("output_map_without_slopes", M, "a slope a map", (("lipschitz",), None))
_seen("output_map_steeper", R, "slope 3", (("output_map", 0), "3*abs(x)"), hashed=True)
_seen("output_map_unbounded", R, "no Lipschitz constant", (("output_map", 0), "x**3"), hashed=True)
_seen("output_map_steep_at_zero", R, "an infinite slope", (("output_map", 0), "sqrt(abs(x))"), hashed=True)
_seen("output_map_with_a_pole", R, "not continuous", (("output_map", 0), "1/x"), hashed=True)
_seen("output_map_undefined", R, "not on all of R", (("output_map", 0), "log1p(x)"), hashed=True)
_seen("output_map_nothing", M, "a bound with cuts", (("lipschitz", 0), None))
_seen("output_slope_less", R, "the slope is 1", (("lipschitz", 0, 0), [2**53 - 1, -53]))
_seen("output_slope_negative", M, "not negative", (("lipschitz", 0, 0), [-1, 0]))
_seen("output_slope_of_one_side", R, "2 sat(x) rises by 2", (("lipschitz", 1, 0), [1, 0]))
_seen("output_slope_beside_zero", R, "the cuts hold 0 inside", (("lipschitz", 0, 1), [0, [1, 2]]))
_seen("output_slope_without_cuts", M, "one cut at least", (("lipschitz", 0, 1), [0, []]))
_seen("output_hash", R, "another hash", (("sha256",), "0" * 64))
_seen("steps_output", R, "a bound below the truth", (("constants", 0), [1, -8]), base="steps_outputs")
_set("output_of_iss", Y, R, "no rate, no bound", (("claim",), "iss"), (("kappa",), [0, 0]), (("p",), [0, 0]))
_set("output_list", Y, M, "no block of outputs", (("outputs",), [{"row": [], "direct": [], "bound": [1, 0]}]))
FALSEHOODS.append(
    Falsehood("output_without_factor", R, "V has no factor", lambda: changed(Y, ((("proof", "V"), None),)))
)

# --- numbers of the claim
_set("kappa_large", V, R, "faster than the model", (("kappa",), [8, 0]))
_set("kappa_zero", V, R, "kappa is positive", (("kappa",), [0, 0]))
_set("kappa_negative", V, R, "kappa is positive", (("kappa",), [-1, 0]))
_set("p_large", V, R, "P > p I fails", (("p",), [4, 0]))
_set("p_zero", V, R, "p is positive", (("p",), [0, 0]))
_set("p_of_iss", D, R, "iss has none", (("p",), [1, -10]))
_set("gamma_small", V, R, "the gain is below the truth", (("gamma",), [1, -20]))
_set("gamma_zero", V, R, "gamma is positive", (("gamma",), [0, 0]))
_set("gamma_matrix_negative", V, R, "Gamma is positive", (("gamma",), {"lower": [[[-1, 0]]]}))
_set("level_of_rate", V, R, "only a region has a level", (("level",), [1, 0]))
_set("zero_certificate", D, R, "P = 0 proves nothing", (("P",), {"lower": [[[0, 0]] * (i + 1) for i in range(3)]}),
     (("facts",), {"value": [], "one_signed": [], "difference": [], "constant": []}),
     *((("points", i, "densities"), []) for i in range(3)))  # fmt: skip
_set("state_dropped_in_rate", "e_gains", R, "only iss drops states", (("dropped",), [0]))
_set("unstable_model", V, R, "A0 is unstable", (("model", "A0", 0, 0), (2.0).hex()))
_set("sign_of_A", V, R, "tanh pushes outward", (("model", "terms", 0, "A", 0, 0), (4.0).hex()))
_set("input_column", V, R, "a thousand times the input", (("model", "B", 0, 0), (100000.0).hex()))

# --- form of the file
for _name in known_ledgers.load("g_linear"):
    _set(f"without_{_name}", V, M, "a field is missing", ((_name,), GONE))
_set("field_unknown", V, M, "an unknown field", (("comment",), "hello"))
_set("claim_G", V, M, "claims are words", (("claim",), "G"))
_set("claim_list", V, M, "a claim is text", (("claim",), []))
_set("format_list", V, M, "a format is text", (("statement",), []))
_set(
    "model_sparse",
    V,
    M,
    "matrices are lists",
    (("model", "A0"), {"shape": [1, 32000000], "rows": [], "columns": [], "values": []}),
)
_set("model_f_object", V, M, "f is text", (("model", "terms", 0, "f"), {}))
_set("model_f_nested", V, M, "f is text", (("model", "terms", 0, "f"), [["x"], ["x"]]))
_set("model_B_null", V, M, "canonical B is a list", (("model", "B"), None))
_set("model_b_object", V, M, "b is a list", (("model", "b"), {}))
_set("curves_object", V, M, "a list", (("curves",), {}))
_set("form_row_short", V, M, "one coefficient a function, and one for y", (("curves", 0, "forms", 0, "l"), [[1, 0]]))
_set("form_kind", V, M, "an unknown kind", _is(0, "increasing"))
_set("form_kind_list", V, M, "a kind is text", _is(0, ["sector"]))
_set("shift_text", V, M, "null, a ball or any", (("curves", 0, "shift"), "all"))
_set("row_falls", V, M, "indices rise", (("points", 0, "row"), [[1, [1, 0]], [0, [1, 0]]]))
_set("proof_extra", V, M, "an unknown factor", (("proof", "W"), []))
_set("proof_null", V, M, "only V may be null", (("proof", "M"), None))
_set("proof_ragged", V, M, "row i has i + 1 entries", (("proof", "M", 0), [1, 0]))
FALSEHOODS.append(Falsehood("proof_empty", R, "M has no factor", lambda: changed(V, ((("proof", "M"), []),))))
FALSEHOODS.append(
    Falsehood("proof_singular", R, "T is singular", lambda: changed("g_linear", ((("proof", "P", 0, 0), 0),)))
)
FALSEHOODS.append(Falsehood("hash_stale", R, "another hash", lambda: changed(V, ((("model_sha256",), "0" * 64),))))

# --- slopes along solutions, and values in V
Z, ZK = "slopes", "slopes_of_kinks"
_slope = ("facts", "slope", 0)
_without_upper = tuple((("curves", 0, "forms", k, name), None) for k in (0, 1) for name in ("upper", "lower"))
_set("slope_too_steep", Z, R, "tanh has slope 1", _l(1, 0.999, -1), *_without_upper)
_set("slope_of_a_sector_form", Z, R, "a sector form says nothing of slopes", _is(1, "sector"), *_without_upper)
_set("slope_of_the_other_sign", Z, R, "-x + tanh x falls", _l(1, -1, 1))
_set("slope_negative", Z, M, "a multiplier is negative", ((*_slope, 3), [-1, 0]))
_set("slope_of_a_channel_without_value", Z, M, "P has no such row", (("P",), lambda P: {"lower": P["lower"]}))
_set("slope_without_value", Z, R, "the function's value has no derivative in zeta", (("P",), lambda P: {
    "lower": P["lower"][:3]}), (("points", 0, "densities"), lambda listed: listed[:1]))  # fmt: skip
_set("slope_short", Z, M, "a fact has four numbers", (_slope, [0, 0, [1, 0]]))
_set("slope_of_two_points", Z, M, "a fact has four numbers", (_slope, [0, 0, 0, 1, [1, 0]]))
_set("slope_with_an_input", Z, M, "y' holds u itself, and nothing of u'", (_slope, [0, 0, 1, [1, 0], [1, 0]]))
_set("slope_of_sine", Z, R, "sin falls from pi/2 on", *_f("sin(x)"))
_set("slope_of_sine_in_a_sum", Z, R, "slopes to 2", *_f("x+sin(x)"), *_without_upper)
_set("slope_of_a_root", Z, R, "not Lipschitz at 0", *_f("sqrt(abs(x))"), *_without_upper)
_set("slope_of_a_cube", Z, R, "no bound of slopes", *_f("x**3"))
_set("slope_of_a_jump", Z, R, "nearly a jump", *_f("tanh(1e6*x)"))
_set("slope_of_a_steeper_saturation", ZK, R, "slope 1.5", *_f("1.5*sat(x)"))
_set("slope_of_a_dead_zone", ZK, R, "nothing holds x where the dead zone rests", *_f("deadzone(x)"),
     (("model", "A0", 0, 0), (2.0).hex()))  # fmt: skip
_set("slope_of_a_relu", Z, R, "far out on one side the loop is as with slope 1, and half the sum is not bounded",
     *_f("relu(x)"), (("model", "A0", 1, 0), (-1.0).hex()))  # fmt: skip
_set("value_not_at_rest", Z, R, "V is not 0 at x*", *_f("tanh(x)+1"))
_set("value_of_shifted_tanh", Z, R, "V is not 0 at x*", *_f("tanh(x+1)"))
_set("value_of_no_channel", Z, M, "no such channel", (("P", "channels"), [1]))
_set("value_twice", Z, M, "channels rise", (("P", "channels"), [0, 0]))
_set("value_of_none", Z, M, "there is one at least", (("P", "channels"), []))
_set("value_in_a_diagonal", Z, M, "P is full there", (("P",), {"diagonal": [[1, 0]] * 4, "channels": [0]}))
_set("value_row_missing", Z, M, "a row for each value", (("P", "lower"), lambda rows: rows[:3]))
_set("value_sign", Z, R, "the other sign", (("P", "lower", 3, 0), lambda pair: [-pair[0], pair[1]]))
_set("value_alone", Z, R, "without facts about slopes nothing bounds sigma", (("facts", "slope"), []))
_set("value_dropped", Z, R, "its row of M is not zero", (("dropped",), [3]))
_set("value_of_an_unstable_loop", Z, R, "a slope of 2.3 is one too many", *_f("tanh(2.5*x)"))
_set("value_with_the_loop_closed_wrong", Z, R, "an unstable loop",
     (("model", "terms", 0, "A", 0, 0), (4.0).hex()))  # fmt: skip
_lower = ("curves", 0, "forms", 0, "lower")
_set("square_larger_than_it_says", Z, R, "j is y - d l", ((*_lower, 0), number(1.125)))
_set("square_of_another_form", Z, R, "form j is another one", ((*_lower, 1), 0))
_set("square_of_a_form_that_falls", Z, R, "1 - 1.125 y' < 0", ((*_lower, 0), number(1.125)), _l(1, 1, -1.125),
     (("curves", 0, "forms", 1, "lower"), None), *_without_upper)  # fmt: skip
_set("square_of_a_sector_bound", Z, R, "y - d l must rise", _is(1, "sector"), *_without_upper[:1],
     *_without_upper[2:], (("facts", "slope"), []))  # fmt: skip
_set("values_and_dropped_states", "m_cubes", R, "P is over the states alone", (("P",), {
    "lower": [[[0, 0]] * i + [[1, -20]] for i in range(3)], "channels": [0]}))  # fmt: skip

# --- discrete time
for _each in false_steps.FALSE:
    _set(*_each)
