"""Ledgers of models with algebraic variables: every forged one is refused in the way that is due."""

import copy
import json
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any

import pytest

import persid as ps
from checker.ledgers import data, number
from descriptors import loop, network
from persid.certificates.encoding import heading
from persid.certificates.ledger import with_proof
from persid.errors import RoundingError
from persid_check import Accepted, FormatError, Malformed, Rejected, check, model_sha256
from persid_check.results import NotProvedError

Content = dict[str, Any]
ONE, ZERO = [1, 0], [0, 0]


@cache
def _written(gain: float = 0.5) -> str:
    verdict = ps.certify(loop(gain) if gain else network(2, 2, 0))
    assert verdict.is_certified
    return json.dumps(verdict.certificate.content)


def _content(gain: float = 0.5) -> Content:
    return dict(json.loads(_written(gain)))


def _with(content: Content, path: tuple[Any, ...], value: Any, *, refactored: bool = True) -> Content:
    """The content with one place set; its hash fits, and where factors can be made for it they are."""
    content = copy.deepcopy(content)
    at: Any = content
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    with suppress(FormatError):
        content["model_sha256"] = model_sha256(content["model"])
    with suppress(RoundingError, FormatError, NotProvedError):
        content = with_proof(content) if refactored else content
    return content


def test_the_ledger_that_is_forged_is_a_good_one() -> None:
    """It is accepted, and says that the equations have one solution and what is proved of the state."""
    for gain in (0.5, 0.0):
        content = _content(gain)
        answer = check(data(content))
        assert isinstance(answer, Accepted), answer
        assert "exactly one solution" in answer.statement
        assert any("form of differences" in step for step in answer.steps)
        assert isinstance(check(data(with_proof(content))), Accepted)


SOLVABLE, ONE = ("algebraic", "solvable"), [1, 0]
FORGED: dict[str, tuple[type, tuple[Any, ...], Any]] = {
    "gain_2": (Rejected, ("model", "terms", 0, "R", 0, 1), (2.0).hex()),
    "another_argument": (Rejected, ("model", "terms", 0, "R", 0, 0), (3.0).hex()),
    "no_equation_left": (Rejected, ("model", "A0", 1), [(0.0).hex()] * 2),
    "singular": (Rejected, ("model", "A0", 1, 1), (0.5).hex()),
    "other_sign": (Rejected, ("model", "terms", 0, "A", 0, 0), (9.0).hex()),
    "unstable": (Rejected, ("model", "A0", 0, 0), (1.0).hex()),
    "no_multipliers_of_solvable": (Rejected, (*SOLVABLE, "multipliers"), [[]]),
    "multiplier_of_solvable_negated": (Rejected, (*SOLVABLE, "multipliers"), [[[1, ONE]]]),
    "multiplier_reads_a_state": (Rejected, (*SOLVABLE, "multipliers"), [[[0, ONE], [1, [-1, 0]]]]),
    "products_too_large": (Rejected, (*SOLVABLE, "products", 0, 3), [1, 20]),
    "no_factor": (Rejected, (*SOLVABLE, "proof"), []),
    "no_equations": (Rejected, ("algebraic", "equations"), [[]]),
    "equations_negated": (Rejected, ("algebraic", "equations"), None),
    "another_field": (Malformed, ("algebraic", "bounds"), []),
    "region": (Malformed, ("claim",), "region"),
    "practical": (Rejected, ("claim",), "practical"),
    "strip_of_an_algebraic_variable": (Rejected, ("strips",), [[[[1, ONE]], [-1, 0], ONE]]),
    "density_that_reads_it": (Rejected, ("points", 0, "densities"), [[0, ONE]]),
    "kappa": (Rejected, ("kappa",), [4, 0]),
    "point_with_another_row": (Rejected, ("points", 0, "row"), [[0, ONE]]),
    "not_solvable_by_words": (Malformed, ("algebraic", "solvable"), True),
    "tau_below_0": (Malformed, (*SOLVABLE, "products", 0, 3), [-1, 0]),
    "equation_of_inputs_beyond": (Malformed, ("algebraic", "equations"), [[[9, ONE]]]),
    "two_rows_for_one_equation": (Malformed, ("algebraic", "equations"), [[], []]),
    "no_row": (Malformed, (*SOLVABLE, "multipliers"), []),
    "P_of_all_variables": (Malformed, ("P",), {"diagonal": [ONE, ONE]}),
    "deviations": (Malformed, ("deviations",), [{"columns": [], "C": [], "s": ONE, "epsilon": ONE}]),
    "no_algebraic_variable": (Malformed, ("model", "algebraic"), []),
    "a_state_twice": (Malformed, ("model", "algebraic"), ["x1"]),
    "in_steps": (Malformed, ("model", "time"), "discrete"),
    "everything_else": (Malformed, ("algebraic",), {}),
}


AS_IT_IS = ("no_factor",)  # new factors would mend these


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_ledger_is_refused(name: str) -> None:
    """As malformed where the format forbids it, else as not proved, even with factors made for it."""
    expected, path, value = FORGED[name]
    content = _content()
    if name == "equations_negated":
        value = [[[i, [-m, e]] for i, (m, e) in row] for row in content["algebraic"]["equations"]]
    answer = check(data(_with(content, path, value, refactored=name not in AS_IT_IS)))
    assert isinstance(answer, expected), answer


def _sector(content: Content) -> None:
    for form in content["curves"][0]["forms"]:
        form["is"] = "sector"


def _without(content: Content) -> None:
    del content["algebraic"]


def _ordinary(content: Content) -> None:
    names = content["model"].pop("algebraic")
    content["model"]["states"] += names
    content["model_sha256"] = model_sha256(content["model"])


def _first_format(content: Content) -> None:
    content |= {"format": "persid-certificate-1", "claim": "G"}


@pytest.mark.parametrize("change", [_sector, _without, _ordinary, _first_format])
def test_what_a_proof_rests_on_cannot_be_left_out(change: Callable[[Content], None]) -> None:
    """Nondecreasing forms, the field itself, the equations of the model, the format that knows of them."""
    content = _content()
    change(content)
    answer = check(data(content))
    assert isinstance(answer, Rejected | Malformed), answer


def test_a_certificate_of_other_equations_is_refused() -> None:
    """With --model; and the model without algebraic variables, of the same numbers, is another one."""
    certificate = ps.certify(loop(0.5)).certificate
    assert isinstance(ps.check(certificate, loop(0.5)), Accepted)
    assert isinstance(ps.check(certificate, loop(0.25)), Rejected)
    assert isinstance(ps.check(certificate, loop(0.5).rows), Rejected)


def test_an_index_of_2_is_never_solvable() -> None:
    """x' = w with 0 = x + u says nothing of w: no multipliers make a form of w alone."""
    model = ps.DescriptorModel([[-1.0, 1.0], [1.0, 0.0]], [], [[0.0], [1.0]], algebraic=["w"])
    assert not ps.certify(model).is_certified
    content = _content()
    content["model"]["A0"] = [[(-1.0).hex(), (-1.0).hex()], [(1.0).hex(), (0.0).hex()]]
    content["model"]["terms"][0]["A"] = [[(0.0).hex()], [(0.0).hex()]]
    for row in ([[1, number(1)]], [[1, number(-8)]]):
        forged = _with(content, ("algebraic", "solvable", "multipliers"), [row])
        assert isinstance(check(data(forged)), Rejected)


def test_a_variable_that_does_not_rest_at_its_reference_is_not_said_to() -> None:
    """x' = -x + u tends to 0 whatever w = cos(x) does, and w tends to 1: only the state's rest is named."""
    zero, minus = float(0).hex(), float(-1).hex()
    one = float(1).hex()
    model = {
        "format": "persid-model-1", "states": ["x"], "inputs": ["u"], "x_ref": [zero, zero], "u_ref": [zero],
        "A0": [[minus, zero], [zero, minus]], "B": [[one], [zero]], "b": [zero, zero], "domain": None,
        "terms": [{"f": "cos(x)", "R": [[one, zero]], "A": [[zero], [one]]}], "algebraic": ["w"],
    }  # fmt: skip
    curve = {"functions": [["cos(x)", ONE]], "shift": None, "domain": None, "continuous": [0, [-8, 8]]}
    content = _content() | {
        "model": model, "model_sha256": model_sha256(model), "gamma": [2, 0], "dropped": [1, 2],
        "curves": [curve | {"forms": [], "products": []}], "kappa": [1, -1], "p": [1, -1],
        "points": [{"curve": 0, "row": [[0, ONE]], "channels": [0], "densities": []}],
        "facts": {kind: [] for kind in ("value", "one_signed", "difference", "constant")}, "P": {"lower": [[ONE]]},
        "algebraic": {"solvable": {"multipliers": [[[1, [-1, 0]]]], "products": [], "proof": []}, "equations": [[]]},
    }  # fmt: skip
    answer = check(data(with_proof(content)))
    assert isinstance(answer, Accepted), answer
    assert "about x* = x_ref = (0) for u* = u_ref = (0)" in answer.statement


def test_values_of_functions_in_V_are_refused_before_anything_is_assembled() -> None:
    """P over the states and a channel has another size than V of a model with equations."""
    content = _content()
    content["P"] = {"lower": [*content["P"]["lower"], [[0, 0], ONE]], "channels": [0]}
    answer = check(data(content))
    assert isinstance(answer, Rejected)
    assert "P is over the states" in answer.why


def _refuted(model: ps.DescriptorModel, witness: Content) -> bytes:
    """The file of a refutation without an input."""
    return data({**heading(model, "refuted", "It is not stable."), "u": [[0, 0]], "witness": witness})


def _place(*x: int) -> Content:
    return {"x": [[v, 0] for v in x], "radius": [0, 0]}


def test_solutions_of_the_equations_at_one_state_refute_nothing() -> None:
    """x' = -x with 0 = w - w^3 has three places of rest at x = 0, and its state is stable: the pair is refused."""
    folded = ps.DescriptorModel(
        [[-1.0, 0.0], [0.0, 1.0]], [("x**3", [[0.0, 1.0]], [[0.0], [-1.0]])], [[1.0], [0.0]], algebraic=["w"]
    )
    for other in (1, -1):
        answer = check(_refuted(folded, {"kind": "two-equilibria", "points": [_place(0, 0), _place(0, other)]}))
        assert isinstance(answer, Rejected)
        assert "disjoint in the states" in answer.why
    apart = {"kind": "two-equilibria", "points": [_place(0, 0), _place(1, 1)]}  # where it does not rest
    assert isinstance(check(_refuted(folded, apart)), Rejected)


@pytest.mark.parametrize(
    "witness",
    [
        {"kind": "unstable-linear-part"},
        {"kind": "marginal-direction", "direction": [[1, 0]]},
        {"kind": "cooperative-growth", "point": _place(0, 0), "start": [[1, 0]]},
        {"kind": "invariant-line", "direction": [[1, 0]], "offset": [1, 0]},
    ],
    ids=lambda witness: witness["kind"],
)
def test_rows_that_are_equations_are_no_derivatives(witness: Content) -> None:
    """x' = -x with 0 = w is stable, though w' = w would not be: every witness that says so is refused for its kind."""
    model = ps.DescriptorModel([[-1.0, 0.0], [0.0, 1.0]], [], [[1.0], [0.0]], algebraic=["w"])
    if witness["kind"].startswith("unstable"):
        witness = witness | {"S": [[[1, 0]]], "sigma": [1, -1], "direction": [[1, 0]], "T": [[1]]}
    answer = check(_refuted(model, witness))
    assert isinstance(answer, Rejected)
    assert answer.where == "witness.kind"


@cache
def _unstable() -> str:
    """x' = x - w with w = x/2 - w^3: its linearisation is x' = x/2. The second state makes the forms of size 3."""
    verdict = ps.certify(_run_away(1.0))
    assert isinstance(verdict, ps.Refuted)
    assert verdict.witness.kind == "unstable-equilibrium"
    return json.dumps(verdict.witness.content)


def _run_away(a: float) -> ps.DescriptorModel:
    cube = ("x**3", [[0.0, 0.0, 1.0]], [[0.0], [0.0], [-1.0]])
    A0 = [[a, 0.0, -1.0], [0.25, -1.0, 0.0], [0.5, 0.0, -1.0]]
    return ps.DescriptorModel(A0, [cube], [[1.0], [0.0], [0.0]], algebraic=["w"])


def _forged(path: tuple[Any, ...], value: Any) -> Content:
    content = json.loads(_unstable())
    at: Any = content
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    content["model_sha256"] = model_sha256(content["model"])
    return dict(content)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("witness", "multipliers"), [[ZERO, ZERO, ZERO]]),
        (("witness", "multipliers", 0, 2), [1, 0]),
        (("witness", "multipliers", 0, 0), [1, 6]),
        (("witness", "S", 0, 0), [-1, 0]),
        (("witness", "S", 1, 1), [1, 3]),
        (("witness", "sigma"), [-1, 0]),
        (("witness", "sigma"), [1, 0]),
        (("witness", "direction"), [ZERO, ONE]),
        (("witness", "direction"), [ZERO, ZERO]),
        (("witness", "point", "x", 2), ONE),
        (("witness", "T"), [[1], [0, 1], [0, 0, 1]]),
        (("witness", "T"), [[1]]),
        (("model", "A0", 0, 0), (0.25).hex()),  # x' = -x/4 where the equation is solved: stable
        (("model", "A0", 2, 2), (0.0).hex()),  # 0 = x/2 - w^3: no slope by w
    ],
)
def test_a_forged_unstable_equilibrium_is_refused(path: tuple[Any, ...], value: Any) -> None:
    """Whatever is changed: multipliers, the form, its rate, its direction, the place, the factor, the model."""
    assert isinstance(check(data(json.loads(_unstable()))), Accepted)
    assert isinstance(check(data(_forged(path, value))), Rejected)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("witness", "multipliers"), []),
        (("witness", "multipliers"), [[ZERO, ZERO]]),
        (("witness", "direction"), [ONE, ONE, ZERO]),
        (("witness", "S"), [[ONE]]),
        (("model",), "ordinary"),
    ],
)
def test_multipliers_are_of_every_equation_and_all_variables(path: tuple[Any, ...], value: Any) -> None:
    """Else the file is malformed, as it is where the model has no equations to multiply."""
    if value == "ordinary":
        value = {**json.loads(_unstable())["model"], "states": ["x1", "x2", "w"]}
        del value["algebraic"]
    assert isinstance(check(data(_forged(path, value))), Malformed)


def _folded(at: int = 0) -> ps.DescriptorModel:
    """x' = -x with 0 = w^3 - w + at: three solutions for |at| < .385, else one."""
    cube = ("x**3", [[0.0, 1.0]], [[0.0], [1.0]])
    return ps.DescriptorModel([[-1.0, 0.0], [0.0, -1.0]], [cube], [[1.0], [0.0]], b=[0.0, at], algebraic=["w"])


@pytest.mark.parametrize(
    ("points", "holds"),
    [
        ([(3, 0), (3, 1)], True),  # at x = 3, where the model does not rest
        ([(0, -1), (0, 1)], True),
        ([(0, 1), (0, 1)], False),
        ([(0, 0), (1, 1)], False),  # two states
        ([(0, 0), (0, 2)], False),  # no solution
    ],
)
def test_two_solutions_are_of_one_state(points: list[tuple[int, int]], holds: bool) -> None:
    """And differ, and solve the equations: nothing is said of stability, which the model has."""
    witness = {"kind": "two-solutions", "points": [_place(*point) for point in points]}
    answer = check(_refuted(_folded(), witness))
    assert isinstance(answer, Accepted) is holds
    if isinstance(answer, Accepted):
        assert "is not well-posed: at x = " in answer.statement
        assert "instability is not claimed" in answer.statement
        assert "input-to-state" not in answer.statement
    assert isinstance(check(_refuted(_folded(1), witness)), Rejected)


def test_balls_that_touch_are_no_two_solutions() -> None:
    """One solution may lie in both."""
    wide = [{"x": [[0, 0], [v, -4]], "radius": [1, -4]} for v in (1, -1)]
    assert isinstance(check(_refuted(_folded(), {"kind": "two-solutions", "points": wide})), Rejected)


def test_a_free_direction_changes_no_equation() -> None:
    """0 = x + tanh(w1 - w2) tells w1 - w2 alone; along (1, 1) nothing changes, along others it does."""
    tanh = ("tanh(x)", [[0.0, 1.0, -1.0]], [[0.0], [1.0], [0.0]])
    A0 = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, -2.0]]
    model = ps.DescriptorModel(A0, [tanh], [[1.0], [0.0], [0.0]], algebraic=["w1", "w2"])
    for direction, expected in (
        ([ONE, ONE], Accepted),
        ([ZERO, ZERO], Rejected),
        ([ONE, ZERO], Rejected),
        ([ONE, [-1, 0]], Rejected),
        ([ONE, ONE, ONE], Malformed),
    ):
        answer = check(_refuted(model, {"kind": "free-direction", "direction": direction}))
        assert isinstance(answer, expected), (direction, answer)
    told = ps.DescriptorModel(A0, [("tanh(x)", [[0.0, 1.0, 0.0]], tanh[2])], [[1.0], [0.0], [0.0]], algebraic=2)
    answer = check(_refuted(told, {"kind": "free-direction", "direction": [ONE, ONE]}))
    assert isinstance(answer, Rejected)
    assert "argument of channel 0" in answer.why


@pytest.mark.parametrize("kind", ["two-solutions", "free-direction"])
def test_a_model_without_equations_has_no_such_witness(kind: str) -> None:
    """Nothing is said to be solved where nothing is to be."""
    model = ps.PersidskiiModel([[-1.0]], B=[[1.0]])
    fields = {"points": [_place(0), _place(1)]} if kind == "two-solutions" else {"direction": []}
    content = {**heading(model, "refuted", "No."), "u": [[0, 0]], "witness": {"kind": kind, **fields}}
    answer = check(data(content))
    assert isinstance(answer, Rejected)
    assert answer.where == "witness.kind"


def test_nothing_is_called_infeasible_of_a_model_with_equations() -> None:
    """Obstructions know no equations: such a file is malformed."""
    model = ps.DescriptorModel([[-1.0, 0.0], [0.0, 1.0]], [], [[1.0], [0.0]], algebraic=["w"])
    content = heading(model, "infeasible", "None.") | {"family": "diagonal", "groups": [], "L": [[1], [1]], "proof": {}}
    assert isinstance(check(data(content)), Malformed)
