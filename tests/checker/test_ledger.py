"""Ledgers of every kind are accepted and say what is proved; every forged one is refused in the way that is due."""

import copy
import json
import re

import numpy as np
import pytest
from scipy.optimize import least_squares

from checker import known_ledgers
from checker.false_ledgers import FALSEHOODS
from checker.ledgers import data, seeing
from checker.sampled import Sampled, faults, number
from persid_check import Accepted, Rejected, check, model_sha256


@pytest.mark.parametrize("name", known_ledgers.NAMES)
def test_a_known_ledger_is_accepted(name: str) -> None:
    """Every known ledger is accepted, names the model's hash, and is explained in the order of the page."""
    content = known_ledgers.load(name)
    result = check(data(content))
    assert isinstance(result, Accepted), result
    assert content["model_sha256"] in result.statement
    numbers = [int(step.split(".")[0]) for step in result.steps]
    assert numbers == sorted(numbers)
    assert {1, 4, 6, 7} <= set(numbers)
    assert max(map(len, result.steps)) <= 120


@pytest.mark.parametrize("name", known_ledgers.NAMES)
def test_a_known_ledger_is_true_along_the_model(name: str) -> None:
    """V, its derivative along the model, and all bounds of a known ledger hold at sampled states and inputs."""
    assert faults(known_ledgers.load(name), samples=1000) == []


@pytest.mark.parametrize("falsehood", FALSEHOODS, ids=lambda falsehood: falsehood.name)
def test_a_forged_ledger_is_refused(falsehood) -> None:
    """A ledger with one false entry is rejected or malformed, as its row says, with a place and a reason."""
    result = check(falsehood.content())
    assert type(result).__name__ == falsehood.expected, (falsehood.why, result)
    assert result.where
    assert result.why


def test_a_point_may_look_either_way() -> None:
    """Row, factors and odd places of the forms with the other sign are the same point: both files are accepted."""
    content = copy.deepcopy(known_ledgers.load("mirrored"))
    content["points"][0]["row"] = [[0, [-1, 0]]]
    for function, sign in zip(content["curves"][0]["functions"], (-1, 1), strict=True):
        function[1] = [sign, 0]
    for form in content["curves"][0]["forms"]:  # (r -> -r, l'phi -> -l'phi) in l_0 y + l_1 f(y) + l_2 f(-y)
        form["l"] = [form["l"][0], *([-value, e] for value, e in form["l"][1:])]
    content["curves"][0]["continuous"][1] = [-cut for cut in content["curves"][0]["continuous"][1][::-1]]
    assert isinstance(check(data(content)), Accepted)


def test_forgeries_are_many_and_different() -> None:
    """The table of forgeries holds more than 150 rows with different names."""
    assert len({falsehood.name for falsehood in FALSEHOODS}) == len(FALSEHOODS) >= 150


def test_integrals_in_V_forgo_the_incremental_sentence() -> None:
    """Any two solutions are spoken of only where V has no integral and every form is nondecreasing."""
    assert "any two solutions" in check(data(known_ledgers.load("incremental"))).statement
    assert "any two solutions x, x~ of one such model" in check(data(known_ledgers.load("plant"))).statement
    for name in ("e_mixed_pair", "g_linear", "difference", "region", "slopes_of_kinks"):
        statement = check(data(known_ledgers.load(name))).statement
        assert "any two solutions" not in statement
        assert "exactly one equilibrium" not in statement


@pytest.mark.parametrize("u", [-3.0, 0.0, 0.7, 40.0])
def test_one_equilibrium_for_every_constant_input(u: float) -> None:
    """Where the sentence stands, far starts come to one point, and V of the distance to it falls as it says."""
    content = known_ledgers.load("incremental")
    assert "For every constant input there is exactly one equilibrium" in check(data(content)).statement
    sampled, inputs = Sampled(content), np.array([u])
    starts = ([0.0, 0.0], [90.0, -50.0], [-70.0, 80.0])
    rests = [
        least_squares(sampled.model.F, start, args=(inputs,), xtol=1e-14, ftol=None, gtol=None) for start in starts
    ]
    assert all(abs(rest.fun).max() < 1e-9 and np.allclose(rest.x, rests[0].x, atol=1e-8) for rest in rests)
    for d in np.random.default_rng(0).normal(0, 5, (200, 2)):
        slope = 2 * d @ sampled.P @ sampled.model.F(rests[0].x + d, inputs)
        assert slope <= -number(content["kappa"]) * (d @ sampled.P @ d)


def test_every_operating_point_needs_nondecreasing_forms() -> None:
    """Differences, one-signed forms, deviations and sector forms forgo the sentence about every equilibrium."""
    assert "every equilibrium" in check(data(known_ledgers.load("g_ball"))).statement
    for name in (
        "difference",
        "one_signed",
        "plant",
        "region",
        "practical",
        "m_cubes",
        "slopes",
        "steps_values_of_kinks",
    ):
        assert "every equilibrium" not in check(data(known_ledgers.load(name))).statement


def test_what_stays_without_inputs_is_called_practical() -> None:
    """A plant with a constant deviation, and a model certified with constants, are practically stable, not stable."""
    for name in ("plant", "practical"):
        assert "practically input-to-state stable" in check(data(known_ledgers.load(name))).statement
    content = copy.deepcopy(known_ledgers.load("plant"))
    content["deviations"][0]["epsilon"] = [0, 0]
    statement = check(data(content)).statement
    assert "practically" not in statement
    assert "is assumed, not proved" in statement


def test_a_supply_below_zero_lowers_no_bound() -> None:
    """The printed bound holds at time 0 where V is 1/2 and |x| is 1, though the supply of the facts is negative."""
    statement = check(data(known_ledgers.load("below"))).statement
    numbers = re.search(r"<= (\S+) max\(V\(x\(0\)\), 0\) .* \+ (\S+) for all t", statement)
    assert float(numbers[1]) / 2 + float(numbers[2]) >= 1


def test_outputs_in_a_region_are_bounded_from_points_of_the_region() -> None:
    """A bound of an output in a region speaks of the solutions that start there, with inputs that are small enough."""
    content = copy.deepcopy(known_ledgers.load("region"))
    content = seeing(content, angle=([1, 0], [0]))
    assert "from every x(0) in it the outputs keep to |'angle' - y*| <= " in check(data(content)).statement


def test_names_of_states_are_quoted_where_they_could_mislead() -> None:
    """A name other than x1, x2, … stands in quotes, so that none reads as a part of the sentence."""
    content = copy.deepcopy(known_ledgers.load("region"))
    content["model"]["states"][0] = "0 <= x"
    content["model_sha256"] = model_sha256(content["model"])
    assert "-2 <= ('0 <= x' - '0 <= x'*) <= 2" in check(data(content)).statement


def test_a_region_speaks_of_the_point_that_is_not_known_exactly() -> None:
    """The strips of a region about a ball are about x*, so that the printed set is the one that is proved."""
    result = check(data(known_ledgers.load("region")))
    assert "-2 <= (x1 - x1*) <= 2" in result.statement
    assert "radius" not in result.statement


def test_an_unbounded_strip_needs_no_box() -> None:
    """The pendulum's region is bounded by its level set alone in the direction that no function reads."""
    assert known_ledgers.load("region")["strips"] == []
    assert "x2 - x2*" not in check(data(known_ledgers.load("region"))).statement


def test_a_strip_that_reads_no_state_is_not_printed() -> None:
    """Every x is in the strip of a row of zeros, so the sentence is the same without it."""
    content = known_ledgers.load("region")
    more = content | {"strips": [[[], [-1, 0], [1, 0]]]}
    assert check(data(more)) == check(data(content))


def test_another_model_is_noticed() -> None:
    """A ledger is rejected when it is asked about another model."""
    plain = json.dumps(known_ledgers.load("spring")["model"]).encode()
    other = json.dumps(known_ledgers.load("rated")["model"]).encode()
    assert isinstance(check(data(known_ledgers.load("spring")), plain), Accepted)
    assert isinstance(check(data(known_ledgers.load("spring")), other), Rejected)


def test_the_statement_of_the_file_is_ignored() -> None:
    """What a file says of itself for people changes nothing in the answer."""
    content = copy.deepcopy(known_ledgers.load("spring"))
    content["statement"] = "The moon is made of cheese."
    assert check(data(content)) == check(data(known_ledgers.load("spring")))
