"""Ledgers of models in discrete time that must not be accepted: known ones with some places changed."""

from typing import Any

from checker.edits import GONE, M, R, _f, _is, _l
from checker.ledgers import number

FALSE: list[tuple[Any, ...]] = []


def _set(*named: Any) -> None:
    """A name, the ledger that is changed, the answer, why, and the edits."""
    FALSE.append(named)


# --- discrete time
S = "steps_network"
_set("steps_kappa_one", S, R, "nothing is left after a step", (("kappa",), [1, 0]))
_set("steps_kappa_large", S, R, "faster than the model", (("kappa",), [1, -1]))
_set("steps_kappa_zero", S, R, "kappa is positive", (("kappa",), [0, 0]))
_set("steps_gamma_small", S, R, "the gain is below the truth", (("gamma",), [1, -20]))
_set("steps_p_large", S, R, "P > p I fails", (("p",), [4, 0]))
_set("steps_density", S, R, "P reads no value of its function", (("points", 0, "densities"), [[0, [1, -4]]]),
     (("curves", 0, "forms", 0, "upper"), [[1, 0], [0, 0], None]))  # fmt: skip
_set("steps_density_of_iss", "steps_iss", R, "P reads no value", (("points", 0, "densities"), [[0, [1, -20]]]))
_set("steps_dropped", "steps_iss", R, "its row of M is not zero", (("dropped",), [3]))
_set("steps_state_dropped", "steps_iss", R, "no state is dropped", (("dropped",), [0]))
_set("steps_spanning", "steps_iss", R, "nothing is dropped", (("spanning",), [[0, 0]]))
_set("steps_unstable", S, R, "an eigenvalue beyond 1", (("model", "A0", 0, 0), (1.25).hex()))
_set("steps_alternating", S, R, "an eigenvalue below -1", (("model", "A0", 0, 0), (-1.25).hex()))
_set("steps_integrator", S, R, "x1 stays where it is", (("model", "A0", 0), [v.hex() for v in (1.0, 0.0, 0.0)]),
     (("model", "terms", 0, "A", 0), [(0.0).hex()] * 3))  # fmt: skip
_set("steps_input", S, R, "a thousand times the input", (("model", "B", 0, 0), (100000.0).hex()))
_set("steps_as_rates", S, R, "x' = A0 x with a positive A0 grows", (("model",), lambda model: {
    name: value for name, value in model.items() if name not in ("time", "dt")}))  # fmt: skip
_set("rates_as_steps", "incremental", R, "x+ = -x + ... turns round and does not fall", (("model",), lambda model: (
    model | {"time": "discrete", "dt": (0.5).hex()})))  # fmt: skip
_set("steps_rest_of_rates", "steps_ball", R, "a zero of F is no fixed point",
     (("operating_point", "x", 0), number(-1.4)))  # fmt: skip
_set("steps_ball_exact", "steps_ball", R, "it does not rest there exactly", (("operating_point", "radius"), [0, 0]))
_set("steps_level", "steps_region", R, "the ellipsoid leaves the strip", (("level",), [1, 3]))
_set("steps_input_bound", "steps_region", R, "a step may leave the region", (("input_bound",), [1, 3]))
_set("steps_strip", "steps_region", R, "a strip that the ellipsoid leaves", (("strips", 0, 1), [-1, -4]))
_set("steps_offset", "steps_practical", R, "the constant does not cover it",
     (("curves", 0, "products", 0, 2), [1, -6]))  # fmt: skip
_set("steps_deviation", "steps_plant", R, "deviations as large as the state",
     (("deviations", 0, "C"), lambda rows: [[[i, [1, 0]]] for i in range(len(rows))]))  # fmt: skip
for _name, _dt in (("zero", (0.0).hex()), ("negative", (-0.5).hex()), ("null", None), ("number", 0.125)):
    _set(f"steps_dt_{_name}", S, M, "a step is positive", (("model", "dt"), _dt))
_set("steps_dt_alone", "rated", M, "continuous time has no step", (("model", "dt"), (0.5).hex()))
_set("steps_time_alone", S, M, "a step is needed", (("model", "dt"), GONE))
_set("steps_time_unknown", S, M, "no such time", (("model", "time"), "sampled"))
_set("steps_time_continuous", "rated", M, "not in canonical form", (("model", "time"), "continuous"))

_set("values_in_steps", "steps_iss", R, "nothing bounds the value after the step", (("P",), {
    "lower": [[[0, 0]] * i + [[1, 0]] for i in range(4)], "channels": [0]}))  # fmt: skip

# --- values and integrals in V in discrete time
SV, SK, SA, SR = "steps_values", "steps_values_of_kinks", "steps_values_apart", "steps_values_region"
_step, _densities = ("facts", "step"), ("points", 0, "densities")
_free = tuple((("curves", 0, "forms", k, "lower"), None) for k in (0, 1))
_no_bounds = (*_free, *((("curves", 0, "forms", k, "upper"), None) for k in (0, 1)))
for _base in (SV, SK):
    for _name, _text, _why in (
        ("twice_as_steep", "2*tanh(x)", "slopes to 2"), ("a_little_steeper", "1.0001*tanh(x)", "slopes to 1.0001"),
        ("steep_at_0", "tanh(2*x)", "slopes to 2"), ("a_sine", "sin(x)", "it falls from pi/2 on"),
        ("a_cube", "x**3", "no bound of slopes"), ("a_root", "sqrt(abs(x))", "it falls on the left"),
        ("turned", "-tanh(x)", "it falls"), ("a_bump", "x/(1+x**2)", "it falls from 1 on"),
    ):  # fmt: skip
        _set(f"{_base}_of_{_name}", _base, R, _why, *_f(_text))
    _set(f"{_base}_beyond_the_limit", _base, R, "a loop that is unstable about 0",
         (("model", "terms", 0, "A", 0, 0), (-12.0).hex()))  # fmt: skip
    _set(
        f"{_base}_wrong_way", _base, R, "fed back with the other sign", (("model", "terms", 0, "A", 0, 0), (0.8).hex())
    )
    _set(f"{_base}_without_value", _base, R, "P reads no value", (("P",), lambda P: {"lower": P["lower"][:2]}))
    _set(
        f"{_base}_square_too_large",
        _base,
        R,
        "no form is y - d l",
        (("curves", 0, "forms", 0, "lower", 0), number(1.125)),
    )
    _set(f"{_base}_square_of_a_form_that_falls", _base, R, "y - 1.125 tanh y falls",
         (("curves", 0, "forms", 0, "lower", 0), number(1.125)), _l(1, 1, -1.125),
         (("curves", 0, "forms", 1, "lower"), None), (_densities, lambda listed: listed[:1]))  # fmt: skip
    _set(f"{_base}_too_steep", _base, R, "tanh has slope 1", _l(1, 0.999, -1), *_free)
    _set(f"{_base}_density_negative", _base, M, "mu is negative", ((*_densities, 0, 1), [-1, -4]))
    _set(f"{_base}_density_of_the_other_sign", _base, R, "-tanh falls", _l(0, 0, -1), *_free)
    _set(f"{_base}_density_alone", _base, R, "no fact about a step", (_step, []), (("facts", "value"), []))
    _set(f"{_base}_slope", _base, R, "slopes are facts of flows", (("facts", "slope"), [[0, 0, 1, [1, -30]]]))
    _set(f"{_base}_sign", _base, M, "signs are -1, 0 and 1", ((*_step, 0, 2), 2))
    _set(f"{_base}_negative", _base, M, "a multiplier is negative", ((*_step, 0, 5), [-1, -20]))
    _set(f"{_base}_short", _base, M, "a fact has six numbers", ((*_step, 0), [0, 0, 1, [1, 0]]))
    _set(f"{_base}_of_no_point", _base, M, "there is one point", ((*_step, 0, 1), 1))
    _set(f"{_base}_value_sign", _base, R, "the other sign", (("P", "lower", 2, 0), lambda pair: [1 - pair[0], pair[1]]))
    _set(f"{_base}_dropped", _base, R, "its row of M is not zero", (("dropped",), [2]))
_set("steps_density_of_a_sector_form", SV, R, "a sector form may fall", _is(0, "sector"), (_step, []), *_no_bounds)
_set("steps_step_of_a_sector_form", SV, R, "a sector form says nothing of two moments", _is(1, "sector"), *_no_bounds,
     (_densities, lambda listed: listed[:1]))  # fmt: skip
_set("steps_value_raised", SV, R, "it is not 0 at x*", *_f("tanh(x)+1"), (_densities, []), *_no_bounds)
_set("steps_value_shifted", SV, R, "it is not 0 at x*", *_f("tanh(x+1)"), (_densities, []), *_no_bounds)
_set("steps_values_upper", SK, R, "with a rate the integral needs a bound", (("curves", 0, "forms", 0, "upper"), None))
_set("steps_values_kappa", SK, R, "faster than the linearisation", (("kappa",), [1, -2]))
_set("steps_values_gamma", SK, R, "the gain is below the truth", (("gamma",), [1, -4]))
_set("steps_values_p", SK, R, "Pt > p I fails", (("p",), [16, 0]))
_set("steps_as_flow", SV, R, "steps are no facts of a flow", (("model",), lambda model: {
    name: value for name, value in model.items() if name not in ("time", "dt")}))  # fmt: skip
_set("flow_with_a_step", "slopes", R, "steps are no facts of a flow", (("facts", "step"), [[0, 0, -1, 0, 1, [1, -30]]]))
_set("flow_with_a_value_after_a_step", "slopes", R, "the same", (("facts", "step"), [[0, 0, 0, 0, 1, [1, -30]]]))
_set("steps_two_points_and_no_sign", SA, R, "two points have no common sign", ((*_step, 2, 2), 0))
_set("steps_sum_of_a_relu", SA, R, "a relu is not odd", *_f("relu(x)"))
_set("steps_of_two_curves", SA, R, "two points of one curve are needed", (("curves",), lambda listed: listed * 2),
     (("points", 1, "curve"), 1))  # fmt: skip
_set("steps_apart_without_a_value", SA, R, "P reads one of the two", (("P",), lambda P: {
    "lower": P["lower"][:3], "channels": [0]}))  # fmt: skip
_set("steps_offset_density", "steps_practical", R, "it may fall", (("points", 0, "densities"), [[1, [1, -6]]]),
     (("curves", 0, "forms", 1, "upper"), None))  # fmt: skip
_set("steps_region_level", SR, R, "the level set leaves the strip", (("level",), [1, 0]))
_set("steps_region_bound", SR, R, "a step may leave the region", (("input_bound",), [1, -4]))
_set("steps_region_domain", SR, R, "slopes beyond 1", (("curves", 0, "domain"), [[-2, 0], [2, 0]]))
_set("steps_region_of_all_states", SR, R, "a domain belongs to a region", (("claim",), "rate-and-gain"),
     (("level",), [0, 0]), (("input_bound",), [0, 0]))  # fmt: skip
_set("steps_region_twice", SR, R, "how the function goes on beyond two domains is not clear",
     (("points",), lambda listed: [*listed, listed[0] | {"densities": []}]))  # fmt: skip
