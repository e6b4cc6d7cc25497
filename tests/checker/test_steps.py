"""Ledgers of models in discrete time: random models of known truth, sequences that obey, and what format 1 may say."""

import copy
import json
import random
from collections import Counter
from contextlib import suppress
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from checker import known_ledgers, named
from checker.drawn import outcomes
from checker.independent import Model
from checker.known_steps import as_steps, bounds_of_region, steps_model
from checker.ledgers import Sketch, curve, data, number, point
from checker.sampled import Sampled
from persid.certificates.ledger import with_proof
from persid.errors import RoundingError
from persid_check import Accepted, Malformed, Rejected, canonical_model, check, model_sha256
from persid_check.results import FormatError, NotProvedError

FUNCTIONS = {  # with forms that are nondecreasing
    "tanh(x)": ((0, 1), (1, -1)),
    "arctan(x)": ((0, 1), (1, -1)),
    "relu(x)": ((0, 1), (1, -1)),
    "sat(x)": ((0, 1), (1, -1)),
    "deadzone(x)": ((0, 1), (1, -1)),
    "x**3": ((0, 1),),
    "sin(x)": ((1, -1), (1, 1)),
    "softsign(x)": ((0, 1), (1, -1)),
}


def _network(choose: random.Random, n: int) -> Sketch:
    """x+ = A0 x + A f(R x) + u with random numbers, value facts of every channel and differences of equal functions."""
    rng = np.random.default_rng(choose.randrange(2**32))
    text, count = choose.choice(list(FUNCTIONS)), choose.randrange(1, n + 2)
    scale = choose.uniform(0.2, 1.2)
    A0, A = scale * rng.normal(size=(n, n)) / np.sqrt(n), rng.normal(size=(n, count)) / np.sqrt(n) * scale
    R = np.round(rng.normal(size=(count, n)) * 4) / 4 + 0.125
    model = steps_model([(text, R.tolist(), A.tolist())], A0.tolist(), np.eye(n).tolist(), n=n)
    forms = [(row, "nondecreasing") for row in FUNCTIONS[text]] + [((1, 0), "nondecreasing")]
    facts: list[tuple[Any, ...]] = [
        ("value", p, k, q) for p in range(count) for k in range(len(forms)) for q in range(k)
    ]
    facts += [("difference", p, q, -1, 0, len(forms) - 2) for p in range(count) for q in range(p)]
    points = [point(0, dict(enumerate(row.tolist())), [c], []) for c, row in enumerate(R)]
    kappa = choose.choice((0, Fraction(1, 8)))
    return Sketch(model, [curve([(text, 1)], *forms)], points, facts, "rate-and-gain" if kappa else "iss", kappa)


def _settles(content: dict[str, Any]) -> bool:
    """Whether far and near starts come to 0 without inputs, and no linearisation at a start's size grows at 0."""
    m, rng = Model(content["model"]), np.random.default_rng(0)
    near = float(np.abs(np.linalg.eigvals(m.J(np.full(m.n, 1e-9)))).max())
    if near >= 1:
        return False
    steps = int(min(max(4000, 5 / (1 - near)), 60000))
    for size in (1e-3, 1.0, 30.0):
        for x in size * rng.normal(size=(4, m.n)):
            start = np.linalg.norm(x)
            with np.errstate(all="ignore"):
                for _ in range(steps):
                    x = m.F(x, m.u_ref)
            if not np.linalg.norm(x) < 0.1 * start:
                return False
    return True


def _random(count: int, sizes: tuple[int, ...], seed: int) -> Counter[str]:
    return outcomes(lambda choose: _network(choose, choose.choice(sizes)), _settles, count, seed)


def test_accepted_random_models_of_one_state_settle() -> None:
    """Of random recursions of one state, every one that is accepted settles from near and far, and its bounds hold."""
    assert _random(16, (1,), seed=1)["Accepted"] >= 3


@pytest.mark.long
def test_accepted_random_models_of_several_states_settle() -> None:
    """The same for two and three states."""
    assert _random(40, (2, 3), seed=2)["Accepted"] >= 5


@pytest.mark.slow
def test_accepted_random_models_settle_of_two_thousand() -> None:
    """The same for 2,000 models of one to four states."""
    assert _random(2000, (1, 2, 3, 4), seed=3)["Accepted"] > 200


_SLOPED = ("tanh(x)", "sat(x)", "relu(x)", "deadzone(x)", "softsign(x)", "softplus(x)-0.6931471805599453", "sin(x)",
           "pwl(x; -1: -0.5, 0: 0, 2: 0.25, 3: 1.25)", "expm1(x)")  # fmt: skip


def _loop(choose: random.Random) -> Sketch:
    """A plant of two or three states in a loop with a function, which mostly has slopes from 0 to 1, values in V."""
    n, f, k = choose.choice((2, 3)), choose.choice(_SLOPED), choose.choice((0.125, 0.5, 2.0))
    rng = np.random.default_rng(choose.randrange(10**6))
    A0 = rng.normal(size=(n, n))
    A0 = (A0 * choose.uniform(0.3, 1.02) / np.abs(np.linalg.eigvals(A0)).max()).round(3)
    row, column = (k * rng.normal(size=n)).round(3), rng.normal(size=(n, 1)).round(3)
    model = steps_model([(f, [row.tolist()], column.tolist())], A0.tolist(), np.eye(n)[:, :1].tolist(), n=n)
    kappa = choose.choice((0, Fraction(1, 32)))
    bounds = [{"upper": (1, 0), "lower": (1, j)} if choose.random() < 0.8 else {"upper": (1, 0)} for j in (1, 0)]
    forms = curve([(f, 1)], ((0, 1), "nondecreasing", bounds[0]), ((1, -1), "nondecreasing", bounds[1]))
    at = point(0, {i: v for i, v in enumerate(row.tolist()) if v}, [0], [0, 1])
    signs = (-1, 0, 1) if f in ("tanh(x)", "sat(x)", "deadzone(x)", "softsign(x)") else (-1, 0)
    facts = [("value", 0, 0, 1), *(("step", 0, 0, sign, 0, 1) for sign in signs), ("step", 0, 0, -1, 0, 0)]
    return Sketch(model, [forms], [at], facts, "rate-and-gain" if kappa else "iss", kappa, inside=(0,))


@pytest.mark.long
def test_accepted_loops_in_steps_settle() -> None:
    """Of random loops with values and integrals in V, every one that is accepted settles, and its bounds hold."""
    assert outcomes(_loop, _settles, 60, seed=1)["Accepted"] >= 8


@pytest.mark.slow
def test_accepted_loops_in_steps_settle_of_three_thousand() -> None:
    """The same for 3,000 loops."""
    assert outcomes(_loop, _settles, 3000, seed=2)["Accepted"] > 400


def test_integrals_rise_no_more_in_a_step_than_is_said() -> None:
    """Between any two arguments the integral of a function of slopes in [0, 1] rises no more than its bound (I)."""
    y, after = 2 * np.random.default_rng(0).normal(size=(2, 20000))
    for f, F in (
        (np.tanh, lambda t: np.log(np.cosh(t))),
        (lambda t: np.clip(t, -1, 1), lambda t: np.where(np.abs(t) < 1, t * t / 2, np.abs(t) - 0.5)),
        (lambda t: np.maximum(t, 0), lambda t: np.maximum(t, 0) ** 2 / 2),
    ):
        rise, square = F(after) - F(y), (f(after) - f(y)) ** 2 / 2
        assert (rise <= f(after) * (after - y) - square + 1e-12).all()
        assert (rise > f(after) * (after - y) - 1.05 * square).any()  # no larger d would do


@pytest.mark.parametrize("name", ["steps_network", "steps_ball", "steps_region", "steps_values_of_kinks"])
def test_sequences_obey_the_printed_bound(name: str) -> None:
    """|x_k - x*| stays below its bound in every step, for inputs as large as are admitted and chosen at random."""
    content = known_ledgers.load(name)
    assert isinstance(check(data(content)), Accepted)
    look, rng = Sampled(content), np.random.default_rng(3)
    kappa, p, gamma = (float(Fraction(m) * Fraction(2) ** e) for m, e in (content[k] for k in ("kappa", "p", "gamma")))
    for size in (0.0, 0.03):
        x = 0.3 * rng.normal(size=look.model.n)
        V = look.V(x)
        for k in range(80):
            bound = np.sqrt(V / p) * (1 - kappa) ** (k / 2) + np.sqrt(gamma / (kappa * p)) * size
            assert np.linalg.norm(x) <= bound * (1 + 1e-9) + 1e-12
            x = look.rise(x, size * rng.choice([-1.0, 1.0], look.model.m))


@pytest.mark.parametrize(("kind", "answer"), [("sector", Accepted), ("offset", Rejected)])
def test_a_lower_bound_in_a_region_holds_along_chords(kind: str, answer: type) -> None:
    """A step may leave the domain: a sector form bounds an integral from below, one whose integral alone is
    known to be positive there does not.
    """
    content = copy.deepcopy(known_ledgers.load("steps_values_region"))
    a = {"sector": Fraction(1, 2), "offset": Fraction(1, 4)}[kind]
    bound = curve([("x**3/3", 1)], ((a, -1), kind), domain=(-1, 1))["forms"][0]
    content["curves"][0]["forms"].append(bound)
    content["curves"][0]["forms"][1]["lower"] = [number(1 - a), 2]
    assert isinstance(check(data(with_proof(content | bounds_of_region(content)))), answer)


def test_format_1_is_not_read_of_models_in_discrete_time() -> None:
    """A certificate of stability in format 1 whose model is in discrete time is malformed, whatever it proves."""
    for name in named.MAKERS:
        content = named.load(name)
        if content["claim"] != "refuted":
            answer = check(data(as_steps(content)))
            assert isinstance(answer, Malformed), name
            assert answer.where.startswith("model")


def test_a_ledger_of_rates_is_none_of_steps() -> None:
    """No ledger of a model in continuous time is accepted when the model is read in discrete time, nor the reverse;
    but of -x/10, which is stable as x' and as x+.
    """
    for name in set(known_ledgers.NAMES) - {"mirrored"}:
        content = known_ledgers.load(name)
        if "time" in content["model"]:
            model = {k: v for k, v in content["model"].items() if k not in ("time", "dt")}
            other = as_steps(content) | {"model": model}
        else:
            other = as_steps(content)
        with suppress(RoundingError, FormatError, NotProvedError, ValueError):
            other = with_proof(other)
        assert not isinstance(check(data(other)), Accepted), name


def test_witnesses_of_rates_refute_no_steps() -> None:
    """Of each kind of witness, one that refutes a field refutes nothing when the model is read in discrete time."""
    for name in ("two", "unstable", "unstable_linear", "marginal", "cooperative", "line"):
        content = named.load(f"refuted_{name}")
        assert isinstance(check(data(content)), Accepted)
        assert isinstance(check(data(as_steps(content))), Rejected), name


def _unstable(**witness: Any) -> bytes:
    """A witness that x+ = -1.25 x + u is unstable at 0, with some of its fields set."""
    model = canonical_model(steps_model([], [[-1.25]]))
    point = {"x": [[0, 0]], "radius": [0, 0]}
    fields = {"kind": "unstable-equilibrium", "point": point, "S": [[[1, 0]]], "sigma": [5, -2], "direction": [[1, 0]]}
    return data({
        "format": "persid-certificate-1", "claim": "refuted", "statement": "for people", "model": model,
        "model_sha256": model_sha256(model), "u": [[0, 0]], "witness": fields | {"T": [[1]]} | witness,
    })  # fmt: skip


@pytest.mark.parametrize(
    ("witness", "why"),
    [
        ({"sigma": [3, -2]}, "less than 1"),
        ({"sigma": [25, -4]}, "not proved positive definite"),
        ({"sigma": [2, 0]}, "not proved positive definite"),
        ({"S": [[[-1, 0]]]}, "not positive"),
        ({"point": {"x": [[1, 0]], "radius": [0, 0]}}, "exactly one equilibrium"),
        ({"direction": [[0, 0]]}, "not positive"),
    ],
)
def test_forged_growth_in_steps_is_refused(witness: dict[str, Any], why: str) -> None:
    """A share below 1 or above what a step gains, a form that is not positive, and a point without rest are refused."""
    assert isinstance(check(_unstable()), Accepted)
    answer = check(_unstable(**witness))
    assert isinstance(answer, Rejected)
    assert why in answer.why


def test_growth_is_proved_on_all_of_a_neighbourhood() -> None:
    """Of a fixed point known only within a ball, the slopes of the whole ball count: a wide one proves nothing."""
    model = canonical_model(steps_model([("x**3", None, [[1.0]])], [[1.125]]))
    content = json.loads(_unstable(T=[[1]], sigma=[9, -3]))
    content |= {"model": model, "model_sha256": model_sha256(model)}
    assert isinstance(check(data(content)), Accepted)
    far = canonical_model(steps_model([("x**3", None, [[-1.0]])], [[1.125]]))  # it rests at 0 and at sqrt(1/8), too
    content |= {"model": far, "model_sha256": model_sha256(far)}
    assert isinstance(check(data(content)), Accepted)
    content["witness"]["point"] = {"x": [[0, 0]], "radius": [1, -1]}
    assert isinstance(check(data(content)), Rejected)
