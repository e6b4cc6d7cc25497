"""A certificate says the same in both formats of its file."""

import json
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from checker.named import VALID
from checker.translated import as_ledger
from persid.certificates.certificate import Certificate
from persid.certificates.encoding import encode
from persid.certificates.ledger import with_proof
from persid.errors import PersidError
from persid_check.version_1.format import WORDS
from problems import BY_NAME

FILES = sorted(path for path in VALID.glob("*.json") if json.loads(path.read_bytes())["claim"] in WORDS)


def both(path: Path) -> tuple[Certificate, Certificate]:
    """Return a certificate of version 1, and the same claim as a ledger."""
    one = Certificate.accept(path.read_bytes())
    return one, Certificate.accept(encode(as_ledger(one.content)))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_same_numbers(path: Path) -> None:
    """Claim, point, P, V, rate, gains, level and input bound are equal, to the last bit."""
    one, two = both(path)
    assert (one.claim, one.scope, one.rate, one.gain) == (two.claim, two.scope, two.rate, two.gain)
    assert (one.level, one.input_bound, one.counts_b) == (two.level, two.input_bound, two.counts_b)
    assert np.array_equal(one.operating_point, two.operating_point)
    assert np.array_equal(one.input, two.input)
    assert np.array_equal(one.P, two.P)
    x = one.operating_point + np.random.default_rng(0).normal(size=(5, one.model.n))
    assert np.allclose(one.V(x), two.V(x), rtol=1e-12)
    if one.gains is not None and two.gains is not None:
        assert np.array_equal(one.gains, two.gains)


@pytest.mark.parametrize("path", [path for path in FILES if path.stem[0] in "er"], ids=lambda path: path.stem)
def test_the_same_bound(path: Path) -> None:
    """From a start near the operating point the bound over time is the same."""
    one, two = both(path)
    x0, size = one.operating_point + 0.01, 0.1 * (one.input_bound or 1.0)
    assert np.allclose(one.bound(x0, size, [0.0, 1.0]), two.bound(x0, size, [0.0, 1.0]), rtol=1e-12)


@pytest.mark.parametrize("path", [path for path in FILES if path.stem[0] == "r"], ids=lambda path: path.stem)
def test_a_region_refuses_the_same_starts(path: Path) -> None:
    """A start far outside the region has no bound, in either format."""
    for certificate in both(path):
        with pytest.raises(PersidError, match="region"):
            certificate.bound(certificate.operating_point + 100.0, 0.0, [0.0])


def test_any_two_solutions() -> None:
    """The ledger shows by itself what version 1 states: the bounds hold between any two solutions."""
    path = VALID / "e_gains.json"
    content = json.loads(path.read_bytes()) | {"incremental": True}
    one = Certificate.accept(encode(content))
    assert one.is_incremental
    assert Certificate.accept(encode(as_ledger(content))).is_incremental
    assert not Certificate.accept(path.read_bytes()).is_incremental


def test_bounds_of_plants_hold_their_constant_deviations() -> None:
    """Every number of a certificate of plants counts what the constant part of a deviation adds."""
    plain = as_ledger(json.loads((VALID / "e_gains.json").read_bytes()))
    deviation = {"columns": [[[0, [1, -20]]]], "C": [], "s": [1, -3], "epsilon": [3, 0]}
    model, plants = (Certificate.accept(encode(with_proof(plain | {"deviations": each}))) for each in ([], [deviation]))
    x0 = model.operating_point + 1.0
    unit = float(plants.stated.kappa * plants.stated.p)
    assert plants.spread == pytest.approx(np.sqrt(9 / 8 / unit), rel=1e-12)
    assert model.spread == 0.0
    assert plants.bound(x0, 0.0, [2.0]) - model.bound(x0, 0.0, [2.0]) == pytest.approx(plants.spread, rel=1e-9)


def test_certify_writes_the_ledger() -> None:
    """A certificate of states is a ledger, about a shifted point too, where it holds about any centre."""
    verdict = ps.certify(ps.PersidskiiModel([[-1.0]], [("x**3", None, [[-0.2]])], [[1.0]], b=[1.0]))
    assert isinstance(verdict, ps.Certified)
    content = verdict.certificate.content
    assert (content["format"], content["claim"]) == ("persid-certificate-2", "rate-and-gain")
    assert content["curves"][0]["shift"] is not None


def test_a_state_that_enters_through_functions_alone_is_a_ledger() -> None:
    """Of relu(x) and x*abs(x) the one that grows to both sides says that V does."""
    terms = [("relu(x)", None, [[-1.0]]), ("x*abs(x)", None, [[-1.1]])]
    verdict = ps.certify(ps.PersidskiiModel([[0.0]], terms, [[0.8]]))
    assert isinstance(verdict, ps.Certified)
    assert isinstance(verdict.certificate, Certificate)
    content = verdict.certificate.content
    ((point, k),) = content["spanning"]
    assert content["dropped"] == [0]
    assert content["curves"][content["points"][point]["curve"]]["forms"][k]["is"] in ("rising", "growing")


def test_a_region_with_a_sharp_bound_of_an_integral_is_a_ledger() -> None:
    """Where a bound holds by 2 %, its partition is fine enough: x' = -x^3 + 3 x^2 - 2.5 x + u about 0, |x| < 1.5."""
    model = BY_NAME["three equilibria elsewhere"].build()
    verdict = ps.certify(model, domain=[[-1.5, 1.5]])
    assert isinstance(verdict, ps.Certified)
    assert isinstance(verdict.certificate, Certificate)
    assert verdict.certificate.content["format"] == "persid-certificate-2"


def test_a_region_that_ends_near_a_zero_of_its_function_is_a_ledger() -> None:
    """The bound of the integral of sin on |x| < 3.05 holds by a hair at the ends: thousands of pieces prove it."""
    pendulum = ps.PersidskiiModel([[0, 1], [0, -0.5]], [("sin(x)", [[1, 0]], [[0], [-1.0]])], [[0.0], [1.0]])
    verdict = ps.certify(pendulum, domain=[[-3.05, 3.05], [-9, 9]])
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.claim == "region"
