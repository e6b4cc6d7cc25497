"""The feedback around a model with outputs that its gains allow: true for known systems, and not to be forged."""

import copy
import json
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import persid as ps
from checker.ledgers import data
from persid_check import Accepted, Rejected, check

SENTENCE = "Any feedback from one output"
LATENT = ps.PersidskiiModel([[-1.0]], [("tanh(x)", None, [[-0.5]])], [[1.0]])
MAPPED = ps.OutputModel(LATENT, C=[[1.0]], D=[[0.25]], outputs=["y"], output_map=["2*tanh(x)"])


def _certificate(model: ps.OutputModel | ps.PersidskiiModel, **how: Any) -> Any:
    verdict = ps.certify(model, **how)
    assert isinstance(verdict, ps.Certified), verdict
    return verdict.certificate


@cache
def _content() -> bytes:
    return _certificate(MAPPED).data


def _halved(number: list[int], times: int = 1) -> None:
    """Halve a dyadic number of the file, so many times (doubled where negative)."""
    number[1] -= times


FORGED: dict[str, Callable[[dict[str, Any]], Any]] = {
    "the constant of the output is halved": lambda c: _halved(c["outputs"]["constants"][0]),
    "the output map is said to be half as steep": lambda c: _halved(c["outputs"]["lipschitz"][0][0]),
    "gamma is a thousandth": lambda c: _halved(c["gamma"], 10),
    "kappa is thirty times as large": lambda c: _halved(c["kappa"], -5),
    "nothing passes through directly": lambda c: c["outputs"].update(D=[[(0.0).hex()]]),
    "another output is bounded": lambda c: c["outputs"].update(C=[[(0.5).hex()]]),
}


@pytest.mark.parametrize("name", FORGED)
def test_no_number_behind_the_limit_can_be_forged(name: str) -> None:
    """The limit is made of c, L, D, gamma and kappa: a file with a better one of them is rejected."""
    assert SENTENCE in check(_content()).statement
    content = copy.deepcopy(json.loads(_content()))
    FORGED[name](content)
    answer = check(data(content))
    assert isinstance(answer, Rejected), answer


def test_what_is_printed_is_what_is_proved() -> None:
    """The sentence and the certificate agree on the limit, each rounded down."""
    certificate = _certificate(MAPPED)
    (margin,), (gain,) = certificate.feedback_margins, certificate.output_gains
    printed = float(certificate.statement.split("bounded v where a < ")[1].split(" ")[0])
    assert 0.9999 * margin < printed <= margin * (1 + 1e-12)
    assert margin * gain <= 1.0


@pytest.mark.parametrize(
    ("model", "how"),
    [
        (LATENT, {}),
        (ps.OutputModel(ps.PersidskiiModel([[-1.0]]), C=[[1.0]]), {}),
        (ps.OutputModel(LATENT, C=[[1.0]]), {"gains": "each"}),
    ],
    ids=["states alone", "no input", "a gain for each input"],
)
def test_elsewhere_the_sentence_is_not_made(model: Any, how: dict[str, Any]) -> None:
    """Without outputs, without inputs, and where gains are of single inputs nothing is said of feedback."""
    certificate = _certificate(model, **how)
    answer = check(certificate.data)
    assert isinstance(answer, Accepted)
    assert SENTENCE not in answer.statement
    assert certificate.feedback_margins is None


@pytest.mark.parametrize("seed", range(10))
def test_no_margin_exceeds_what_a_linear_system_allows(seed: int) -> None:
    """Of random linear systems the peak gain and the H-infinity norm are known: the margin is below one over either."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    A = rng.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + rng.uniform(0.3, 2)) * np.eye(n)
    B, C, D = rng.normal(size=(n, 1)), rng.normal(size=(1, n)), np.array([[rng.normal() * (seed % 2)]])
    model = ps.OutputModel(ps.PersidskiiModel(A, B=B), C=C, D=D)
    (margin,) = _certificate(model, time_limit=20).feedback_margins
    h, T = 0.002, 8 / -np.linalg.eigvals(A).real.max()
    step, state, area = expm(h * A), B, 0.0
    for _ in range(int(T / h)):
        following = step @ state
        area += h * (abs((C @ state).item()) + abs((C @ following).item())) / 2
        state = following
    peak = area + abs(D.item())
    w = np.concatenate([[0.0], np.geomspace(1e-2, 1e3, 2000)])
    infinity = max(abs((C @ np.linalg.solve(1j * k * np.eye(n) - A, B) + D).item()) for k in w)
    assert infinity <= peak * 1.01
    assert 0 < margin <= 1.001 / peak


@pytest.mark.parametrize("seed", range(4))
def test_loops_within_the_limit_keep_to_the_bound(seed: int) -> None:
    """Feedback of the worst sign, delayed or of the largest value so far, at .95 of the limit keeps to the bound."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(2, 2))
    A -= (np.linalg.eigvals(A).real.max() + 1.0) * np.eye(2)
    latent = ps.PersidskiiModel(A, [("tanh(x)", None, 0.2 * rng.normal(size=(2, 2)))], rng.normal(size=(2, 1)))
    model = ps.OutputModel(latent, C=rng.normal(size=(1, 2)))
    certificate = _certificate(model, time_limit=20)
    (margin,), (gain,) = certificate.feedback_margins, certificate.output_gains
    star, h = certificate.operating_point, 0.02
    rest = model.output(star[None], certificate.input[None])[0, 0]
    x, a, delay, seen, largest = star + rng.normal(size=2), 0.95 * margin, 20 * (seed % 3), [], 0.0
    start = float(certificate.output_bound(x, 0.0, np.zeros(1))[0, 0])

    def rate(x: np.ndarray, u: float) -> np.ndarray:
        return latent.rhs(x[None], np.array([[u]]))[0]

    for k in range(2000):
        seen.append(float(model.output(x[None], np.zeros((1, 1)))[0, 0] - rest))
        v = 1.0 if k % 400 < 200 else -1.0
        w = a * (seen[-1 - min(delay, k)] if seed % 2 else v * max(map(abs, seen)))
        u = float(certificate.input[0] + v + w)
        largest = max(largest, abs(v + w))
        k1 = rate(x, u)
        k2 = rate(x + h / 2 * k1, u)
        k3 = rate(x + h / 2 * k2, u)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3, u))
    assert largest <= (1.0 + a * start) / (1 - a * gain) * (1 + 1e-6)
    assert largest > 1.0


@pytest.mark.parametrize(("C", "D", "limits"), [(0.0, 0.0, 1), (0.0, 0.5, 2)])
def test_an_output_that_inputs_do_not_move_has_no_limit(C: float, D: float, limits: int) -> None:
    """A gain of 0 is 0 and is not divided by; alone it leaves nothing to say."""
    both = ps.OutputModel(LATENT, C=[[1.0], [C]], D=[[0.0], [D]], outputs=["y", "z"])
    answer = check(_certificate(both).data)
    assert isinstance(answer, Accepted)
    assert answer.statement.partition(SENTENCE)[2].count(" for '") == limits
    assert "e-1000" not in answer.statement
    alone = check(_certificate(ps.OutputModel(LATENT, C=[[C]], D=[[D]], outputs=["z"])).data)
    assert isinstance(alone, Accepted)
    assert (SENTENCE in alone.statement, "feedback" in alone.further) == (D > 0, D > 0)
