"""One changed entry each: name, the valid certificate it starts from, the outcome that is due, why, and the change."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from checker import named
from checker.maker import data, dyadic, file, model
from persid_check import model_sha256

Certificate = dict[str, Any]
R, M = "Rejected", "Malformed"


@dataclass(frozen=True)
class Falsehood:
    """A file that must not be accepted."""

    name: str
    expected: str
    why: str
    content: Callable[[], bytes]


def _changed(base: str, *edits: tuple[tuple[Any, ...], Any], rehash: bool = False) -> bytes:
    """A valid certificate with some places set; `rehash` makes the hash fit the changed model."""
    certificate = copy.deepcopy(named.load(base))
    for path, value in edits:
        place: Any = certificate
        for key in path[:-1]:
            place = place[key]
        if value is _GONE:
            del place[path[-1]]
        else:
            place[path[-1]] = value
    if rehash:
        certificate["model_sha256"] = model_sha256(certificate["model"])
    return data(certificate)


_GONE = object()
FALSEHOODS: list[Falsehood] = []


def _set(
    name: str, base: str, expected: str, why: str, *edits: tuple[tuple[Any, ...], Any], rehash: bool = False
) -> None:
    FALSEHOODS.append(Falsehood(name, expected, why, lambda: _changed(base, *edits, rehash=rehash)))


def _file(name: str, expected: str, why: str, content: Callable[[], Certificate]) -> None:
    FALSEHOODS.append(Falsehood(name, expected, why, lambda: data(content())))


def _text(name: str, why: str, edit: Callable[[bytes], bytes]) -> None:
    FALSEHOODS.append(Falsehood(name, M, why, lambda: edit(data(named.load("g_mixed_pair")))))


G, E, REG, DROP, BALL = "g_mixed_pair", "e_mixed_pair", "r_pendulum", "g_rows_dropped", "g_ball"
P0, MU, TAU = ("P", "diagonal", 0), ("groups", 0, "mu", 1), ("groups", 0, "products", 0)
A00 = ("model", "terms", 0, "A", 0, 0)

# --- not of the format
_set("float_mantissa", G, M, "a float stands where an integer belongs", ((*P0, 0), 1.5))
_set("bool_mantissa", G, M, "true is no integer", ((*P0, 0), True))
_set("text_mantissa", G, M, "text is no integer", ((*P0, 0), "1"))
_set("null_gamma", G, M, "null is no dyadic", (("gamma",), None))
_set("unknown_field", G, M, "a field that is not specified", (("comment",), "hello"))
_set("unknown_group_field", G, M, "constants do not belong to claim G", (("groups", 0, "integral"), []))
_set("missing_gamma", G, M, "a field is missing", (("gamma",), _GONE))
_set("missing_dropped", G, M, "a field is missing", (("dropped",), _GONE))
_set("missing_factor", G, M, "a factor is missing", (("proof", "P"), _GONE))
_set("extra_factor", G, M, "a factor that is not specified", (("proof", "R"), []))
_set("dyadic_of_three", G, M, "a dyadic is a pair", (P0, [1, 0, 0]))
_set("huge_exponent", G, M, "an exponent beyond all use", ((*P0, 1), 10**9))
_set("huge_mantissa", G, M, "a mantissa beyond all use", ((*P0, 0), 1 << 2049))
_set("factor_of_floats", G, M, "T is of integers", (("proof", "Q", 0, 0), 0.5))
_set("factor_not_lower", G, M, "a row of T is too long", (("proof", "Q", 0), [1, 0]))
_set(
    "form_too_short",
    G,
    M,
    "a form has one coefficient a function, and one for y",
    (("groups", 0, "forms", 0), [[1, 0]]),
)
_set("mu_too_short", G, M, "one mu a form", (("groups", 0, "mu"), [[1, 0]]))
_set("groups_too_few", G, M, "one entry a group", (("groups",), []))
_set("pair_across_groups", G, M, "an index beyond the group's forms", ((*TAU, 1), 4))
_set("pair_with_itself", G, M, "k < l", (TAU, [1, 1, [1, 0]]))
_set("pair_backwards", G, M, "k < l", (TAU, [2, 1, [1, 0]]))
_set("pair_negative", G, M, "an index is not negative", (TAU, [-1, 1, [1, 0]]))
_set("pair_twice", G, M, "a pair stands twice", (("groups", 0, "products"), [[0, 1, [1, 0]], [0, 1, [1, 0]]]))
_set("dropped_negative", DROP, M, "an entry is not negative", (("dropped",), [-1]))
_set("dropped_beyond", DROP, M, "z has no such entry", (("dropped",), [99]))
_set("dropped_twice", DROP, M, "an entry stands twice", (("dropped",), [3, 3]))
_set("claim_reserved", G, M, "L1 is reserved", (("claim",), "L1"))
_set("claim_number", G, M, "a claim is text", (("claim",), 1))
_set("claim_weaker_fields", E, M, "claim G has no kappa", (("claim",), "G"))
_set("format_2", G, M, "another version", (("format",), "persid-certificate-2"))
_set("statement_number", G, M, "the statement is text", (("statement",), 1))
_set("model_decimal", G, M, "the model is in canonical form", (A00, -1))
_set("model_minus_zero", G, M, "minus zero is written as zero", (("model", "b", 0), "-0x0.0p+0"), rehash=True)
_set("model_infinite", G, M, "numbers are finite", (A00, "inf"))
_set("model_short_hex", G, M, "as float.hex() writes it", (A00, "-0x1p0"))
_set("model_provenance", G, M, "the canonical form has none", (("model", "provenance"), {}))
_set("model_unknown_function", G, M, "the grammar is closed", (("model", "terms", 0, "f"), "gamma(x)"))
_set("model_code", G, M, "text is never evaluated", (("model", "terms", 0, "f"), "__import__('os')"))
_set("model_no_states", G, M, "a model has a state", (("model", "states"), []))
_set("model_same_names", G, M, "names differ", (("model", "states"), ["x", "x"]))
_set("lower_of_wrong_shape", "g_full", M, "row i has i + 1 entries", (("P", "lower", 0), []))
_set("both_P", G, M, "one of the two", (("P", "lower"), []))
_set("witness_kind", "refuted_two", M, "an unknown kind", (("witness", "kind"), "simulation"))
_set("witness_field", "refuted_two", M, "a field of another kind", (("witness", "sigma"), [1, 0]))
_set("witness_one_point", "refuted_two", M, "two balls are needed", (("witness", "points"), [named._ORIGIN]))
_set("infeasible_ragged", "infeasible_full", M, "rows of L are equally long", (("L",), [[4], [1, 1]]))
_set("infeasible_family", "infeasible_full", M, "diagonal or full", (("family",), "banded"))
_set("infeasible_no_factor", "infeasible_full", M, "a full P needs a factor", (("proof",), {}))
_text("duplicate_field", "a field stands twice", lambda text: text.replace(b'"gamma"', b'"gamma": [1, 0], "gamma"', 1))
_text("not_a_number", "NaN is no number", lambda text: text.replace(b'"dropped": []', b'"dropped": [NaN]', 1))
_text("truncated", "half a file", lambda text: text[: len(text) // 2])
_text("not_utf8", "not UTF-8", lambda text: text.replace(b"for people", b"\xff\xfe"))
_text("byte_order_mark", "a mark before the object", lambda text: b"\xef\xbb\xbf" + text)
_text("nested", "nested beyond all use", lambda text: b"[" * 100000)
_text(
    "long_integer",
    "an integer of 10000 digits",
    lambda text: text.replace(b'"dropped": []', b'"dropped": [' + b"9" * 10000 + b"]"),
)
_text("a_list", "not an object", lambda text: b"[]")
_text("empty", "nothing", lambda text: b"")

# --- well formed and false, or not proved
_set("stale_hash", G, R, "the model was changed", (A00, (-2.0).hex()))
_set("wrong_hash", G, R, "a digit was changed", (("model_sha256",), "0" * 64))
_set("model_entry", G, R, "a sign in the model was changed", (A00, (1.0).hex()), rehash=True)
_set("linear_entry", G, R, "a linear entry was changed", (("model", "A0", 0, 0), (2.0).hex()), rehash=True)
_set("swapped_function", G, R, "x - sinh x is no sector form", (("model", "terms", 1, "f"), "sinh(x)"), rehash=True)
_set("discontinuous_function", G, R, "1/x is not continuous", (("model", "terms", 1, "f"), "1/x"), rehash=True)
_set("cosine", G, R, "cos is no sector function", (("model", "terms", 1, "f"), "cos(x)"), rehash=True)
_set("false_form", G, R, "x - 1.0001 tanh x < 0 near 0", (("groups", 0, "forms", 3, 2), dyadic(Fraction(-1.0001))))
_set("negative_form", G, R, "-y is no sector form", (("groups", 0, "forms", 0, 0), [-1, 0]))
_set("input_column", G, R, "a thousand times the input", (("model", "B", 0, 0), (1000.0).hex()), rehash=True)
_set("negative_mu", G, R, "a multiplier is negative", (MU, [-1, -10]))
_set("negative_tau", G, R, "a multiplier is negative", ((*TAU, 2), [-1, -10]))
_set("zero_gamma", G, R, "gamma must be positive", (("gamma",), [0, 0]))
_set("negative_gamma", "g_linear", R, "gamma must be positive", (("gamma",), [-1, 0]))
_set("small_gamma", G, R, "the gain is too small for the block", (("gamma",), [1, -40]))
_set("gamma_of_wrong_shape", "e_gains", M, "one row an input", (("gamma", "lower"), [[[33, -5]]]))
_set("gamma_full_rows", "e_gains", M, "row i has i + 1 entries", (("gamma", "lower", 0), [[33, -5], [1, 0]]))
_set("gamma_other_field", "e_gains", M, "an unknown field", (("gamma",), {"diagonal": [[33, -5], [33, -5]]}))
_set("gamma_without_coupling", "e_gains", R, "each input pays for the other", (("gamma", "lower", 1, 0), [0, 0]))
_set("gamma_negative_coupling", "e_gains", R, "the inputs act alike", (("gamma", "lower", 1, 0), [-1, 0]))
_set("gamma_small_for_one", "e_gains", R, "a gain below the truth", (("gamma", "lower", 1, 1), [31, -5]))
_set("gamma_joint_too_small", "e_gains", R, "the joint gain is 2 at least", (("gamma",), [33, -5]))
_set("gamma_not_positive", "e_gains", R, "Gamma is positive definite", (("gamma", "lower", 0, 0), [-33, -5]))
_set("gains_input_bound", "r_gains", R, "both inputs at once leave the region", (("input_bound",), [11, -4]))
_ZEROS = [[0, 0]] * 4
_EMPTY = [((*("groups", g), name), value) for g in range(2) for name, value in (("mu", _ZEROS), ("products", []))]
_set("zero_certificate", G, R, "P = mu = tau = 0 proves nothing", (("P", "diagonal"), [[0, 0]] * 2), *_EMPTY)
_set("negative_P", "g_linear", R, "P must be positive", (P0, [-1, 0]))
_set("zero_P", "g_linear", R, "P must be strictly positive", (P0, [0, 0]))
_set(
    "boundary", "g_linear", R, "gamma = 1/2 is the boundary of the inequality, not its interior", (("gamma",), [1, -1])
)
_set("no_input_block", "g_linear", R, "T has no row for the input", (("proof", "Q"), [[1]]))
_set("empty_factor", "g_linear", R, "T is empty", (("proof", "Q"), []))
_set("large_factor", "g_linear", R, "T has a row too many", (("proof", "Q"), [[1], [1, 2], [0, 0, 1]]))
_set("zero_row", "g_linear", R, "T is singular", (("proof", "Q"), [[1], [0, 0]]))
_set("dependent_rows", "g_linear", R, "T is singular", (("proof", "Q"), [[1], [1, 0]]))
_set("zero_P_factor", "g_linear", R, "T is singular", (("proof", "P"), [[0]]))
_set("transposed_linear_part", "g_full", R, "A0 was transposed",
     (("model", "A0"), [[(-1.0).hex(), (0.0).hex()], [(3.0).hex(), (-1.0).hex()]]), rehash=True)  # fmt: skip
_set("drop_with_column", DROP, R, "the channel acts on the state", (("dropped",), [2]))
_set("drop_state_in_G", DROP, R, "claim G needs all states", (("dropped",), [0]))
_set("drop_with_form", DROP, R, "a form touches the channel", (("groups", 0, "forms", 1), [[0, 0], [1, 0], [1, 0]]))
_set("undropped", DROP, R, "T does not fit the entries kept", (("dropped",), []))
_set("integral_of_cube", E, R, "the integral of y^3 is y^4 / 4", (("groups", 0, "integral", 1), [3, -4]))
_set("integral_of_line", E, R, "the integral of y is y^2 / 2", (("groups", 0, "integral", 0), [7, -4]))
_set(
    "integral_of_tanh",
    E,
    R,
    "tanh needs 1",
    (("groups", 0, "mu", 2), [1, -30]),
    (("groups", 0, "integral", 2), [1, -1]),
)
_set("integral_missing", E, R, "a form with mu > 0 needs a constant", (("groups", 0, "integral"), [None] * 4))
_set("integral_negative", E, R, "c is not negative", (("groups", 0, "integral", 1), [-1, 0]))
_set("fast", E, R, "kappa is too large", (("kappa",), [4, 0]))
_set("zero_kappa", E, R, "kappa must be positive", (("kappa",), [0, 0]))
_set("negative_kappa", E, R, "kappa must be positive", (("kappa",), [-1, 0]))
_set("large_p", E, R, "P > p I fails", (("p",), [4, 0]))
_set("zero_p", E, R, "p must be positive", (("p",), [0, 0]))
_set("small_ball", BALL, R, "the ball is too small for a proof", (("operating_point", "radius"), [1, -300]))
_set("point_ball", BALL, R, "the centre is no equilibrium exactly", (("operating_point", "radius"), [0, 0]))
_set("negative_ball", BALL, M, "a radius is not negative", (("operating_point", "radius"), [-1, -30]))
_set("moved_ball", BALL, R, "no equilibrium there", (("operating_point", "x", 0), [2, 0]))
_set("other_input", BALL, R, "the equilibrium of another input", (("operating_point", "u", 0), [2, 0]))
_set(
    "shifted_constant",
    "e_shifted",
    R,
    "1/4 does not hold for the shifted cube",
    (("groups", 0, "integral", 1), [1, -2]),
)
_set("box_without_point", REG, R, "0 is not inside the box", (("box", 0), [[1, 0], [2, 0]]))
_set("box_on_its_face", REG, R, "0 is on a face of the box", (("box", 0), [[0, 0], [2, 0]]))
_set("box_backwards", REG, R, "lo < hi", (("box", 0), [[2, 0], [-2, 0]]))
_set("box_too_wide", REG, R, "sin has no sign on [-4, 4]", (("box", 0), [[-4, 0], [4, 0]]))
_set("high_level", REG, R, "V = c meets a face", (("level",), [2, 0]))
_set("zero_level", REG, R, "an empty region", (("level",), [0, 0]))
_set("negative_level", REG, R, "an empty region", (("level",), [-1, 0]))
_set("large_input", REG, R, "gamma u^2 > kappa c", (("input_bound",), [1, 0]))
_set("negative_input", REG, R, "a bound is not negative", (("input_bound",), [-1, 0]))
_set("large_quadratic", REG, R, "1 - cos y < 3/8 y^2 at 2", (("groups", 0, "quadratic", 1), [3, -2]))
_set("negative_quadratic", REG, R, "d is not negative", (("groups", 0, "quadratic", 1), [-1, 0]))
_set("no_quadratic", REG, R, "a form with mu > 0 needs d", (("groups", 0, "quadratic"), [None] * 4))
_set("infeasible_zero", "infeasible_full", R, "X = 0 separates nothing", (("L",), [[0], [0]]))
_set("infeasible_sign", "infeasible_full", R, "a product is negative", (("L",), [[4], [-1]]))
_set(
    "infeasible_stable", "infeasible_full", R, "the model is stable", (("model", "A0", 0, 0), (-2.0).hex()), rehash=True
)
_set("infeasible_zero_product", "infeasible_full", R, "a product is zero, not positive", (("L",), [[4], [4]]))
_set("same_equilibrium_twice", "refuted_two", R, "one equilibrium", (("witness", "points", 1), named._ORIGIN))
_set("overlapping_balls", "refuted_two", R, "the balls overlap", (("witness", "points", 1, "radius"), [2, 0]))
_set("two_at_another_input", "refuted_two", R, "they are no equilibria for this input", (("u", 0), [1, -4]))
_set("stable_equilibrium", "refuted_unstable", R, "that one is stable", (("witness", "point"), named._OTHER))
_set("negative_growth", "refuted_unstable", R, "sigma < 0 allows decay", (("witness", "sigma"), [-4, 0]))
_set("negative_direction", "refuted_unstable", R, "e'Se < 0", (("witness", "S", 0, 0), [-1, 0]))
_set("no_direction", "refuted_unstable", R, "e = 0", (("witness", "direction", 0), [0, 0]))
_set("fast_growth", "refuted_unstable", R, "the growth is 1, not 2", (("witness", "sigma"), [2, 0]))
_set("singular_factor", "refuted_unstable", R, "T is singular", (("witness", "T"), [[0]]))
_set(
    "unbounded_function",
    "refuted_unstable_linear",
    R,
    "sinh is not bounded",
    (("model", "terms", 0, "f"), "sinh(x)"),
    rehash=True,
)
_set(
    "stable_linear_part",
    "refuted_unstable_linear",
    R,
    "A0 is stable",
    (("model", "A0", 0, 0), (-0.5).hex()),
    rehash=True,
)
_set("no_marginal_direction", "refuted_marginal", R, "w = 0", (("witness", "direction", 0), [0, 0]))
_set("no_input", "refuted_marginal", R, "w'B = 0", (("model", "B", 0, 0), (0.0).hex()), rehash=True)
_set("not_marginal", "refuted_marginal", R, "w'A0 is not 0", (("model", "A0", 0, 0), (-1.0).hex()), rehash=True)
_set(
    "restoring_function",
    "refuted_marginal",
    R,
    "-2 x^3 is not bounded below",
    (("model", "terms", 0, "f"), "x**3"),
    rehash=True,
)
_set(
    "restoring_logarithm",
    "refuted_marginal",
    R,
    "-2 arcsinh is not bounded below",
    (("model", "terms", 0, "f"), "arcsinh(x)"),
    rehash=True,
)
_set("start_at_rest", "refuted_cooperative", R, "the start is the equilibrium", (("witness", "start", 0), [0, 0]))
_set("start_below", "refuted_cooperative", R, "the start lies below", (("witness", "start", 0), [-1, 0]))
_set("start_too_far", "refuted_cooperative", R, "F < 0 there", (("witness", "start", 0), [3, 0]))
_set("line_offset_zero", "refuted_line", R, "s0 = 0", (("witness", "offset"), [0, 0]))
_set("line_offset_far", "refuted_line", R, "s g(s) < 0 there", (("witness", "offset"), [3, 0]))
_set("line_direction_zero", "refuted_line", R, "v = 0", (("witness", "direction", 0), [0, 0]))
_set("line_without_rest", "refuted_line", R, "x_ref is no equilibrium", (("model", "b", 0), (1.0).hex()), rehash=True)


def _M(model_object: Certificate, forms: list[Any], mu: list[Any], T: list[Any], dropped: list[int]) -> Certificate:
    """Claim M with P = 0 for a model of one state."""
    groups = [{"forms": forms, "mu": mu, "products": []}]
    return file(
        model_object, "M", operating_point=None, P={"diagonal": [[0, 0]]}, groups=groups, dropped=dropped, gamma=[4, 0],
        proof={"P": [], "Q": T},
    )  # fmt: skip


def _one(f: str, *, a: float = -1.0, A0: float = 0.0) -> Certificate:
    return model([(f, None, [[a]])], [[A0]])


AXIS, FACTOR = [[[0, 0], [1, 0]]], [[1], [1, 2]]
_file(
    "saturated_as_M", R, "x' = -tanh x + u diverges for u = 2", lambda: _M(_one("tanh(x)"), AXIS, [[1, 0]], FACTOR, [0])
)
_file(
    "dead_zone_as_M",
    R,
    "x' = -dz(x) + u rests all over the dead zone",
    lambda: _M(_one("deadzone(x)"), AXIS, [[1, 0]], FACTOR, [0]),
)
_file(
    "one_sided_as_M",
    R,
    "x' = -(exp x - 1) + u diverges for u = -2",
    lambda: _M(_one("exp(x)-1"), AXIS, [[1, 0]], FACTOR, [0]),
)
_file("slow_as_M", R, "x' = -x / (1 + x^2) + u diverges", lambda: _M(_one("x/(1+x**2)"), AXIS, [[1, 0]], FACTOR, [0]))
_file("absent_row", R, "x' = x + u, the sinh row of column zero kept in V, the state dropped",
      lambda: _M(_one("sinh(x)", a=0.0, A0=1.0), AXIS, [[1, 0]], FACTOR, [0]))  # fmt: skip
_file("absent_row_all", R, "x' = x + u, everything dropped",
      lambda: _M(_one("sinh(x)", a=0.0, A0=1.0), AXIS, [[0, 0]], [[1]], [0, 1]))  # fmt: skip
_file(
    "nothing_kept",
    R,
    "x' = 0 x + u, everything dropped",
    lambda: _M(_one("sinh(x)", a=0.0), AXIS, [[0, 0]], [[1]], [0, 1]),
)
_file("cubic_as_everywhere", R, "x' = -(x - 10 sinh(x/10)) at rest all around 0",
      lambda: _M(_one("10*sinh(x/10)", A0=2.0), AXIS, [[1, 0]], FACTOR, [0]))  # fmt: skip
_file("constant_force", R, "x' = -x + 2 at x = 1: F > 0 there, and it is certified about 2",
      lambda: file(model([], [[-1]], b=[2.0]), "refuted", u=[[0, 0]],
                   witness={"kind": "cooperative-growth", "point": {"x": [[2, 0]], "radius": [0, 0]},
                            "start": [[1, 0]]}))  # fmt: skip
_file("bistable_only_at_0_55", R, "the three equilibria belong to u = 0.55, not to u = 0",
      lambda: file(model([("x**3-3*x**2+2.5*x", None, [[-1]])]), "refuted", u=[[0, 0]],
                   witness={"kind": "two-equilibria", "points": [{"x": [dyadic(Fraction(0.3596))], "radius": [1, -8]},
                                                                  {"x": [[0, 0]], "radius": [0, 0]}]}))  # fmt: skip
_file("line_not_invariant", R, "x1^3 bends the line",
      lambda: file(model([("x**3", None, [[1, 0], [0, 2]])], [[1, 0], [0, 1]], n=2), "refuted", u=[[0, 0]],
                   witness={"kind": "invariant-line", "direction": [[1, 0], [1, 0]], "offset": [1, 0]}))  # fmt: skip
_file("competitive", R, "an off-diagonal slope is negative",
      lambda: file(model([("tanh(x)", None, [[2, -1], [0, 2]])], [[-1, 0], [0, -1]], n=2), "refuted", u=[[0, 0]],
                   witness={"kind": "cooperative-growth", "point": {"x": [[0, 0]] * 2, "radius": [0, 0]},
                            "start": [[1, 0], [1, -2]]}))  # fmt: skip
_file("decreasing_function", R, "x^2 is not nondecreasing",
      lambda: file(model([("x**2", None, [[1, 0], [0, 1]])], None, n=2), "refuted", u=[[0, 0]],
                   witness={"kind": "cooperative-growth", "point": {"x": [[0, 0]] * 2, "radius": [0, 0]},
                            "start": [[1, 0], [1, 0]]}))  # fmt: skip
