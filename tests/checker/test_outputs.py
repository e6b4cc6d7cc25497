"""What certificates of the first format say of outputs and of any two solutions: accepted where true, refused else."""

import copy
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import pytest

from checker import named
from checker.maker import Wanted, data, make, model
from persid_check import Accepted, check
from persid_check.canonical import canonical_outputs
from persid_check.model import sha256_of
from persid_check.outputs import FIELDS, FORMAT

Certificate = dict[str, Any]
PLAIN = {"outputs": ["y"], "C": [[2.0]], "D": [[0.5, 0.0]], "d": [1.0]}
MAPPED = {"outputs": ["y", "z"], "C": [[1.0], [-1.0]], "output_map": ["tanh(x)", "x"]}
ENOUGH = [5, 0]  # V = x^2 and C = 2: more than 4 V bounds (C x)^2


def hashed(certificate: Certificate) -> Certificate:
    """Write the hash of the outputs that stand in a certificate."""
    block = certificate["outputs"]
    form = {name: block[name] for name in FIELDS}
    block["sha256"] = sha256_of({"format": FORMAT, "dynamics": certificate["model"], **form})
    return certificate


def stated(base: str, outputs: Certificate, constants: Any, lipschitz: Any = None) -> Certificate:
    """Return a kept certificate with outputs: x' = -x + u1 + u2, V = x^2, or the pair e_mixed_pair."""
    certificate = named.load(base)
    n, m = len(certificate["model"]["states"]), len(certificate["model"]["inputs"])
    form = canonical_outputs(outputs, n, m)
    certificate["outputs"] = {**form, "constants": constants, "lipschitz": lipschitz}
    return hashed(certificate)


def plain() -> Certificate:
    return stated("e_gains", PLAIN, [ENOUGH])


def mapped() -> Certificate:
    return stated("e_gains", MAPPED, [ENOUGH, ENOUGH], [[1, 0], [1, 0]])


def test_outputs_are_stated() -> None:
    """The bound of each output is a sentence of its own, with the gain of each input and what D passes on at once."""
    result = check(data(plain()))
    assert isinstance(result, Accepted), result
    assert "outputs keep to |'y' - y*| <= " in result.statement
    assert "sup|u1 - u1*| + " in result.statement.partition("outputs keep to")[2]
    assert any("c > C M^-1 C'" in step for step in result.steps)


def test_maps_are_as_steep_as_stated() -> None:
    """A map of an output counts with its Lipschitz constant, which is proved."""
    result = check(data(mapped()))
    assert isinstance(result, Accepted), result
    assert any("|h(a) - h(b)| <= L |a - b|" in step for step in result.steps)


def test_outputs_in_a_region_and_without_inputs() -> None:
    """A region bounds outputs as well; without inputs the bound has no gain; many outputs and inputs are cut short."""
    region = stated("r_gains", PLAIN, [ENOUGH])
    assert isinstance(check(data(region)), Accepted)
    many = stated("e_gains", {"outputs": [f"y{i}" for i in range(40)], "C": [[1.0]] * 40}, [ENOUGH] * 40)
    result = check(data(many))
    assert isinstance(result, Accepted), result
    assert "... (40 outputs)" in result.statement
    alone = model([("tanh(x)", None, [[-1]])], [[-1]], [[]])
    certificate = make(Wanted(alone, [[(1, 0), (0, 1)]], "E", c=[[Fraction(1, 2), 1]], kappa=Fraction(1, 2)))
    form = canonical_outputs({"outputs": ["y"], "C": [[1.0]]}, 1, 0)
    result = check(data(hashed(certificate | {"outputs": {**form, "constants": [[100, 0]], "lipschitz": None}})))
    assert isinstance(result, Accepted), result
    assert "sup|" not in result.statement.partition("outputs keep to")[2]
    joint = stated("e_mixed_pair", {"outputs": ["y"], "C": [[1.0, 0.0]], "D": [[0.5, 0.5]]}, [[1, 40]])
    result = check(data(joint))
    assert isinstance(result, Accepted), result
    assert "sup|u - u*|" in result.statement


def test_any_two_solutions() -> None:
    """Without densities, and with nondecreasing forms alone, the bounds hold between any two solutions."""
    certificate = plain() | {"incremental": True}
    result = check(data(certificate))
    assert isinstance(result, Accepted), result
    assert "between any two solutions: with x, y and u of the other one" in result.statement
    assert "any two solutions: with x and u" in check(data(named.load("e_gains") | {"incremental": True})).statement


FORGED: dict[str, tuple[str, str, Callable[[], Certificate]]] = {}


def forged(where: str, expected: str = "Rejected") -> Callable[[Callable[[], Certificate]], Callable[[], Certificate]]:
    """Enter a function that makes a file which must be refused at a place."""

    def enter(forge: Callable[[], Certificate]) -> Callable[[], Certificate]:
        FORGED[forge.__name__] = (where, expected, forge)
        return forge

    return enter


def changed(certificate: Certificate, **entries: Any) -> Certificate:
    """Return it with entries of its outputs set, and the hash that belongs to them."""
    certificate = copy.deepcopy(certificate)
    certificate["outputs"] |= entries
    return hashed(certificate)


@forged("outputs.constants[0]")
def a_constant_is_too_small() -> Certificate:
    return changed(plain(), constants=[[4, 0]])


@forged("outputs.lipschitz[0]")
def a_map_is_steeper_than_stated() -> Certificate:
    return changed(mapped(), lipschitz=[[1, -1], [1, 0]])


@forged("outputs.lipschitz[1]")
def a_falling_map_is_steeper_than_stated() -> Certificate:
    return changed(mapped(), output_map=["tanh(x)", "-2*x"])


@forged("outputs.sha256")
def the_hash_is_another() -> Certificate:
    certificate = plain()
    certificate["outputs"]["sha256"] = "0" * 64
    return certificate


@forged("outputs.D", "Malformed")
def the_form_is_another() -> Certificate:
    return changed(plain(), D=None)


@forged("outputs.lipschitz", "Malformed")
def a_map_has_no_constant() -> Certificate:
    return changed(mapped(), lipschitz=None)


@forged("outputs.lipschitz", "Malformed")
def a_constant_has_no_map() -> Certificate:
    return changed(plain(), lipschitz=[[1, 0]])


@forged("outputs.outputs", "Malformed")
def there_is_no_output() -> Certificate:
    return changed(plain(), outputs=[], C=[], D=[], d=[], constants=[])


@forged("outputs.output_map[0]", "Malformed")
def a_map_is_no_text() -> Certificate:
    return changed(mapped(), output_map=[1, "x"])


@forged("outputs.output_map[1]", "Malformed")
def a_map_is_no_expression() -> Certificate:
    return changed(mapped(), output_map=["tanh(x)", "x +"])


@forged("outputs.C", "Malformed")
def a_row_is_missing() -> Certificate:
    return changed(mapped(), C=plain()["outputs"]["C"])


@forged("outputs")
def a_constant_moves_the_point_that_nothing_states() -> Certificate:
    moved = model([("tanh(x)", None, [[-1]])], [[-1]], b=[0.5])
    certificate = make(Wanted(moved, [[(1, 0), (0, 1)]], "E", c=[[Fraction(1, 2), 1]], kappa=Fraction(1, 2)))
    form = canonical_outputs({"outputs": ["y"], "C": [[1.0]]}, 1, 1)
    certificate["outputs"] = {**form, "constants": [[100, 0]], "lipschitz": None}
    return hashed(certificate)


@forged("incremental", "Malformed")
def incremental_is_no_true() -> Certificate:
    return plain() | {"incremental": 1}


@forged("incremental")
def incremental_with_integrals() -> Certificate:
    return named.load("e_mixed_pair") | {"incremental": True}


@forged("incremental")
def incremental_with_a_form_that_falls() -> Certificate:
    """y + 2 sin(y) has the sign of y and is not nondecreasing."""
    swinging = model([("sin(x)", None, [[0.25]])], [[-2]], [[1]])
    forms, none = [[(1, 2), (1, -1)]], [[None, None]]
    return make(Wanted(swinging, forms, "E", c=none, kappa=Fraction(1, 2))) | {"incremental": True}


@pytest.mark.parametrize("name", sorted(FORGED))
def test_a_false_output_is_refused(name: str) -> None:
    """A certificate that is false or malformed in one entry about outputs is refused at that place."""
    where, expected, forge = FORGED[name]
    result = check(data(forge()))
    assert type(result).__name__ == expected, result
    assert result.where == where


def output_model(**changes: Any) -> bytes:
    """Return the file of the model of `plain`."""
    dynamics = named.load("e_gains")["model"]
    return data({"format": FORMAT, "dynamics": dynamics, **PLAIN, "hold": "zoh", **changes})


def test_another_output_model_is_noticed() -> None:
    """With --model outputs are compared as well; a certificate of the states belongs to every output model."""
    assert isinstance(check(data(plain()), output_model()), Accepted)
    assert isinstance(check(data(named.load("e_gains")), output_model()), Accepted)
    assert check(data(plain()), output_model(C=[[3.0]])).where == "model"
    elsewhere = named.load("e_shifted")["model"] | {"inputs": ["u1", "u2"], "u_ref": [0, 0], "B": [[1, 1]]}
    assert check(data(named.load("e_gains")), output_model(dynamics=elsewhere)).where == "model"
