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
        {"kind": "unstable-equilibrium", "point": _place(0, 0)},
        {"kind": "unstable-linear-part"},
        {"kind": "marginal-direction", "direction": [[1, 0], [0, 0]]},
        {"kind": "cooperative-growth", "point": _place(0, 0), "start": [[0, 0], [1, 0]]},
        {"kind": "invariant-line", "direction": [[0, 0], [1, 0]], "offset": [1, 0]},
    ],
    ids=lambda witness: witness["kind"],
)
def test_rows_that_are_equations_are_no_derivatives(witness: Content) -> None:
    """x' = -x with 0 = w is stable, though w' = w would not be: every witness that says so is refused for its kind."""
    model = ps.DescriptorModel([[-1.0, 0.0], [0.0, 1.0]], [], [[1.0], [0.0]], algebraic=["w"])
    if witness["kind"].startswith("unstable"):
        grows = {"S": [[[-1, 0]], [[0, 0], [1, 0]]], "sigma": [1, -1], "direction": [[0, 0], [1, 0]]}
        witness = witness | grows | {"T": [[1], [0, 1]]}
    answer = check(_refuted(model, witness))
    assert isinstance(answer, Rejected)
    assert answer.where == "witness.kind"


def test_nothing_is_called_infeasible_of_a_model_with_equations() -> None:
    """Obstructions know no equations: such a file is malformed."""
    model = ps.DescriptorModel([[-1.0, 0.0], [0.0, 1.0]], [], [[1.0], [0.0]], algebraic=["w"])
    content = heading(model, "infeasible", "None.") | {"family": "diagonal", "groups": [], "L": [[1], [1]], "proof": {}}
    assert isinstance(check(data(content)), Malformed)
