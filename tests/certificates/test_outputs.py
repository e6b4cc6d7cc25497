"""Bounds of outputs, and of any two solutions: true ones hold in simulations, forged ones are refused."""

import copy
import json
import random
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import persid as ps
from checker import known_ledgers
from checker.ledgers import data, rehashed
from checker.sampled import faults
from persid.certificates.certificate import Certificate
from persid.errors import ModelError, PersidError
from persid.verdicts.outputs import certify_fit
from persid_check import Accepted, Malformed, Rejected, check
from stable_fits import random_fit

Content = dict[str, Any]


def certified(seed: int = 0, **how: Any) -> tuple[ps.OutputModel, Certificate]:
    """A model of known truth and its certificate, from its own multipliers."""
    fit = random_fit(seed, **how)
    found = ps.OutputModel.from_fit(fit)
    verdict = certify_fit(fit, found, time_limit=0.0)
    assert isinstance(verdict, ps.Certified)
    assert isinstance(verdict.certificate, Certificate)
    return found, verdict.certificate


TWO = {"outputs": 2, "output_map": "abs"}


@pytest.fixture(scope="module")
def with_density() -> tuple[ps.OutputModel, Certificate]:
    """Two outputs behind |.|, V with integrals."""
    return certified(0, **TWO)


@pytest.fixture(scope="module")
def without_density() -> tuple[ps.OutputModel, Certificate]:
    """Two outputs behind |.|, V without integrals."""
    return certified(1, densities=False, **TWO)


def _scale_C(content: Content, factor: float) -> None:
    row = content["outputs"]["C"][0]
    content["outputs"]["C"][0] = [(factor * float.fromhex(v)).hex() for v in row]


def _swap(content: Content) -> None:
    content["outputs"]["outputs"].reverse()


def _no_D(content: Content) -> None:
    content["outputs"]["D"] = [[(0.0).hex()] * len(row) for row in content["outputs"]["D"]]


@pytest.mark.parametrize(
    "change", [lambda c: _scale_C(c, 0.5), _swap, _no_D], ids=["C smaller", "names swapped", "no D"]
)
def test_outputs_of_another_model_are_refused(
    with_density: tuple[ps.OutputModel, Certificate], change: Callable[[Content], None]
) -> None:
    """A block of outputs that is not the model's is refused by its hash."""
    content = copy.deepcopy(with_density[1].content)
    change(content)
    answer = check(json.dumps(content).encode())
    assert isinstance(answer, Rejected)
    assert answer.where == "outputs.sha256"


def test_one_bit_less_is_refused(with_density: tuple[ps.OutputModel, Certificate]) -> None:
    """The constants that are written are the least of so many digits that the factor in the file proves."""
    content = copy.deepcopy(with_density[1].content)
    content["outputs"]["constants"][0][0] -= 1
    answer = check(json.dumps(content).encode())
    assert isinstance(answer, Rejected)
    assert answer.where == "outputs.constants[0]"


@pytest.mark.parametrize(
    "change", [lambda c: _scale_C(c, 0.5), _swap, _no_D], ids=["C smaller", "names swapped", "no D"]
)
def test_true_bounds_of_other_outputs_are_not_those_of_the_model(
    with_density: tuple[ps.OutputModel, Certificate], change: Callable[[Content], None]
) -> None:
    """A file that is true of other outputs is refused for the model at hand, and accepted for its own."""
    found, certificate = with_density
    content = copy.deepcopy(certificate.content)
    change(content)
    content["outputs"]["constants"] = [[1, 20], [1, 20]]
    content = rehashed(content)
    answer = check(data(content))
    assert isinstance(answer, Accepted)
    given = json.dumps(found.to_dict()).encode()
    assert isinstance(check(json.dumps(content).encode(), given), Rejected)
    assert isinstance(check(certificate.data, given), Accepted)
    assert isinstance(check(certificate.data, json.dumps(found.dynamics.to_dict()).encode()), Accepted)


def test_what_no_claim_speaks_of_may_change(with_density: tuple[ps.OutputModel, Certificate]) -> None:
    """Noise, spread and provenance are not part of what is certified; a broken model file is malformed."""
    found, certificate = with_density
    given = found.to_dict() | {"noise": None, "provenance": {"by": "hand"}, "hold": "foh"}
    assert isinstance(check(certificate.data, json.dumps(given).encode()), Accepted)
    for broken in ({"dynamics": 3}, {"C": [[1.0]]}, {"more": 1}):
        assert isinstance(check(certificate.data, json.dumps(given | broken).encode()), Malformed)
    given.pop("dynamics")
    assert isinstance(check(certificate.data, json.dumps(given).encode()), Malformed)


def test_integrals_say_nothing_about_two_solutions(with_density: tuple[ps.OutputModel, Certificate]) -> None:
    """Where V holds an integral the sentence about two solutions is not there."""
    certificate = with_density[1]
    assert not certificate.is_incremental
    assert "any two solutions" not in certificate.statement


@pytest.mark.parametrize("seed", range(8))
def test_simulations_keep_to_the_bound(seed: int) -> None:
    """Whatever the start and the inputs, |y - y*| never exceeds the bound; and what is stated is near the floats."""
    how: dict[str, Any] = {"n": 2 + seed % 3, "q": seed % 4, "outputs": 1 + seed % 2, "m": 1 + seed % 2}
    found, certificate = certified(seed, output_map="abs" if seed % 3 == 0 else None, **how)
    rng, t = np.random.default_rng(seed), np.arange(400) * 0.1
    star, u_star = certificate.operating_point, found.dynamics.u_ref
    y_star = found.output(star, u_star)
    for size in (0.0, 1.0, 30.0):
        for x0 in (star, star + 3 * rng.normal(size=found.dynamics.n)):
            v = (
                rng.normal(size=(len(t), found.dynamics.m))
                if size < 2
                else np.sign(rng.normal(size=(len(t), how["m"])))
            )
            v = size * v / max(np.linalg.norm(v, axis=1).max(), 1e-9)
            y = found.simulate(t, u_star + v, x0=x0)[0].x
            bound = certificate.output_bound(x0, size, t)
            assert (np.abs(y - y_star) <= bound + 1e-6 * (1 + np.abs(y))).all()
    c = [1.0 * m * 2.0**e for m, e in certificate.content["outputs"]["constants"]]
    assert np.allclose(c, np.einsum("li,ij,lj->l", found.C, np.linalg.inv(certificate.P), found.C), rtol=1e-9)


@pytest.mark.parametrize("seed", [1, 3])
def test_any_two_simulations_keep_to_the_bound(seed: int) -> None:
    """Where the checker says so, two runs with different starts and inputs stay within the bound of each other."""
    found, certificate = certified(seed, densities=False, outputs=2, n=3)
    assert certificate.is_incremental
    assert "For any two solutions x, x~ with inputs u, u~: the same bounds hold" in certificate.statement
    rng, t = np.random.default_rng(seed), np.arange(300) * 0.1
    starts, u = 5 * rng.normal(size=(2, 3)), 3 * rng.normal(size=(2, len(t), 1))
    a, b = (found.simulate(t, u[k], x0=starts[k])[0].x for k in (0, 1))
    apart = certificate.operating_point + starts[0] - starts[1]  # V of a difference is d'Pd
    bound = certificate.output_bound(apart, float(np.abs(u[0] - u[1]).max()), t)
    assert (np.abs(a - b) <= bound + 1e-6).all()


def test_the_latent_gain_is_not_shown(with_density: tuple[ps.OutputModel, Certificate]) -> None:
    """The certificate of an output model speaks of its outputs, in their unit, and of no gain of its states."""
    certificate = with_density[1]
    assert certificate.gain is None
    assert certificate.gains is None
    assert "|x(t) - x*|" not in certificate.statement
    assert certificate.outputs == ("y1", "y2")
    assert certificate.output_gains is not None
    assert f"{certificate.output_gains[0]:.3g}"[:3] in certificate.statement


@pytest.mark.long
def test_the_unit_of_an_output_scales_its_bound_alone() -> None:
    """An output in millivolts has a thousand times the gain, whatever the coordinates of the states."""
    found, certificate = certified(2)
    T = np.diag([1000.0, 0.01])
    latent = found.dynamics
    terms = [(list(term.f), term.R @ np.linalg.inv(T), T @ term.A) for term in latent.terms]
    moved = ps.PersidskiiModel(T @ latent.A0 @ np.linalg.inv(T), terms, T @ latent.B, T @ latent.b, u_ref=latent.u_ref)
    other = ps.OutputModel(moved, 1000 * found.C @ np.linalg.inv(T), 1000 * found.D, 1000 * found.d)
    verdicts = [ps.certify(each) for each in (found, other)]
    gains = [v.certificate.output_gains[0] for v in verdicts if isinstance(v, ps.Certified)]
    assert len(gains) == 2
    assert 0.3 < gains[1] / gains[0] / 1000 < 3  # the searches differ; the claim does not depend on coordinates
    assert certificate.output_gains is not None


def test_outputs_of_a_state_model_in_a_region() -> None:
    """A regional claim bounds outputs, too, of a model whose states are measured."""
    pendulum = ps.PersidskiiModel([[0, 1], [0, -0.5]], [("sin(x)", [[1, 0]], [[0], [-1]])], [[0], [1]])
    height = ps.OutputModel(pendulum, [[1.0, 0.0]], outputs=["angle"])
    verdict = ps.certify(height, domain=[[-1.5, 1.5], [-2, 2]])
    assert isinstance(verdict, ps.Certified)
    certificate = verdict.certificate
    assert isinstance(certificate, Certificate)
    t = np.arange(200) * 0.1
    u = certificate.input_bound
    assert u is not None
    y = height.simulate(t, np.sign(np.sin(t))[:, None] * u, x0=[0.01, 0.0])[0].x
    assert (np.abs(y) <= certificate.output_bound([0.01, 0.0], u, t)).all()
    with pytest.raises(PersidError, match="exceeds what the certificate admits"):
        certificate.output_bound([0.01, 0.0], 2 * u, t)


def test_a_map_without_a_constant_is_refused_at_once() -> None:
    """No bound of the state bounds a square of it."""
    with pytest.raises(ModelError, match="no Lipschitz constant"):
        ps.certify(ps.OutputModel(ps.PersidskiiModel([[-1.0]], [], [[1.0]]), [[1.0]], output_map="x**2"))


@pytest.mark.parametrize("output_map", ["x/(1+x**2)", "x*exp(-x**2)"])
def test_odd_maps_have_cuts_on_both_sides(output_map: str) -> None:
    """One list of cuts proves slopes and continuity, which has no symmetry: it has the pieces below 0, too."""
    latent = ps.PersidskiiModel([[-1.0]], [("tanh(x)", [[1.0]], [[-1.0]])], [[1.0]])
    verdict = ps.certify(ps.OutputModel(latent, [[1.0]], output_map=output_map))
    assert isinstance(verdict, ps.Certified)
    assert isinstance(verdict.certificate, Certificate)
    assert verdict.certificate.outputs == ("y1",)


def test_states_alone_have_no_bound_of_outputs() -> None:
    """A certificate of states says which model has bounds of outputs."""
    verdict = ps.certify(ps.PersidskiiModel([[-1.0]], [], [[1.0]]))
    assert isinstance(verdict, ps.Certified)
    assert isinstance(verdict.certificate, Certificate)
    with pytest.raises(PersidError, match="certify an OutputModel"):
        verdict.certificate.output_bound([1.0], 1.0, [0.0])


def test_outputs_in_discrete_time_decay_by_steps() -> None:
    """In discrete time the bound of an output falls by sqrt(1 - kappa) in each step, whatever its length in s."""
    content = known_ledgers.load("steps_outputs")
    certificate = Certificate.accept(data(content))
    mantissa, exponent = content["kappa"]
    start, later = certificate.output_bound([1.0, -1.0, 0.5], 0.0, [0.0, 5 * 0.125])
    assert np.isclose(later / start, (1 - mantissa * 2.0**exponent) ** 2.5, rtol=1e-9)


def _random_outputs(count: int, seed: int) -> Counter[str]:
    """Random output models: what is certified holds at sampled states, and a constant a millionth less is refused."""
    choose, counts = random.Random(seed), Counter[str]()
    for k in range(count):
        shape = {name: choose.choice((1, 2, 3)) for name in ("outputs", "m")}
        shape |= {"n": choose.choice((2, 3, 4)), "q": choose.choice((0, 1, 3))}
        _, certificate = certified(seed + k, output_map=choose.choice((None, "abs")), **shape)
        content = copy.deepcopy(certificate.content)
        assert content["format"] == "persid-certificate-2"
        assert faults(content, samples=40) == [], k
        counts["certified"] += 1
        i = choose.randrange(shape["outputs"])
        mantissa, exponent = content["outputs"]["constants"][i]
        content["outputs"]["constants"][i] = [mantissa - mantissa // 10**6 - 1, exponent]
        assert isinstance(check(data(content)), Rejected)
        counts["refused a millionth lower"] += 1
    print(dict(counts))
    return counts


@pytest.mark.long
def test_random_outputs_keep_to_their_bounds() -> None:
    """Of random output models every bound is true at sampled states, and the least that its factor proves."""
    assert _random_outputs(20, seed=1000)["certified"] == 20


@pytest.mark.slow
def test_random_outputs_keep_to_their_bounds_of_five_hundred() -> None:
    """The same for 500 models."""
    assert _random_outputs(500, seed=2000)["certified"] == 500
