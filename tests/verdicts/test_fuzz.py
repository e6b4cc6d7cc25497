"""Random models of every kind: certify returns a verdict, simulations never contradict it, and twins have the same."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy import ndarray

import persid as ps
from persid_check.expression import FUNCTIONS

TEXTS = (
    *(f"{name}(x)" for name in sorted(FUNCTIONS)), "x", "x**2", "x**3", "x**1.5", "1/(1+x**2)", "x*abs(x)", "x/(1+x)",
    "tanh(x+0.5)", "sin(x)-x", "-x**3", "x-tanh(x)", "pwl(x; 0: 0, 1: 2, 3: 1)", "1",
)  # fmt: skip
RUNS = 4
FAR = 1e-6  # of a bound that rounding in simulations may pass it by


@dataclass(frozen=True)
class Drawn:
    """A model by its numbers, with a question about it."""

    A0: ndarray
    terms: tuple[tuple[str, ndarray, ndarray], ...]
    B: ndarray
    b: ndarray
    x_ref: ndarray
    more: dict[str, Any]
    asked: dict[str, Any]

    @classmethod
    def of(cls, seed: int) -> "Drawn":
        """Draw a model of one to three states, more often stable than not, and a claim."""
        rng = np.random.default_rng(seed)
        n, m, discrete = int(rng.integers(1, 4)), int(rng.integers(0, 3)), rng.random() < 0.3
        sizes = rng.choice([0.0, 0.3, 1.0, 3.0])
        A0 = rng.normal(size=(n, n)) * (0.3 if discrete else 1.0) - (
            0.0 if discrete else rng.choice([0, 1, 3])
        ) * np.eye(n)
        terms = []
        for text in rng.choice(TEXTS, size=rng.integers(0, 4)):
            k = int(rng.integers(1, 3))
            R = (
                np.eye(n)[rng.integers(0, n, k)] * rng.choice([1, 2, -1], (k, 1))
                if rng.random() < 0.5
                else rng.normal(size=(k, n))
            )
            A = -R.T * rng.choice([0, 0.5, 1]) + sizes * rng.choice([0.1, 0.5]) * rng.normal(size=(n, k))
            terms.append((str(text), R, np.round(A, 3)))
        b, x_ref = (rng.choice([0.0, 0.5]) * rng.normal(size=n) for _ in range(2))
        more = {"time": "discrete", "dt": 0.5} if discrete else {}
        box = [[-float(r), float(r) * 1.5] for r in rng.choice([0.3, 1.0, 4.0], n)]
        asked = rng.choice(
            np.array(
                [
                    {},
                    {},
                    {"domain": box},
                    {"domain": "auto"},
                    {"claim": "incremental"},
                    {"claim": "practical"},
                    {"gains": "each"},
                    {"rate": 0.01},
                ],
                object,
            )
        )
        return cls(np.round(A0, 3), tuple(terms), rng.normal(size=(n, m)), b, x_ref, more, asked)

    @property
    def model(self) -> ps.PersidskiiModel:
        """The model."""
        return ps.PersidskiiModel(self.A0, list(self.terms), self.B, self.b, self.x_ref, **self.more)

    def twin(self, seed: int) -> "Drawn":
        """The same model in another order of the states, with other signs, and powers of two as units."""
        rng, n = np.random.default_rng(seed), len(self.A0)
        order, unit = rng.permutation(n), 2.0 ** rng.integers(-3, 4) * rng.choice([-1.0, 1.0], n)
        T = np.eye(n)[:, order] * unit  # x = T x^
        back = np.eye(n)[order] / unit[:, None]
        terms = tuple((f, R @ T, back @ A) for f, R, A in self.terms)
        asked = dict(self.asked)
        if isinstance(asked.get("domain"), list):
            sides = np.array(asked["domain"])[order] / unit[:, None]
            asked["domain"] = np.sort(sides, axis=1).tolist()
        return Drawn(back @ self.A0 @ T, terms, back @ self.B, back @ self.b, back @ self.x_ref, self.more, asked)


def asked(drawn: Drawn, time_limit: float = 3.0) -> ps.Certified | ps.Refuted | ps.Undecided:
    """Return the verdict on a model."""
    return ps.certify(drawn.model, time_limit=time_limit, **drawn.asked)


def contradicted(drawn: Drawn, verdict: object, seed: int = 0) -> str | None:
    """Return what simulations hold against a certificate, None where nothing."""
    if not isinstance(verdict, ps.Certified) or not isinstance(verdict.certificate, ps.Certificate):
        return None
    found, model, rng = verdict.certificate, drawn.model, np.random.default_rng(seed)
    center = found.operating_point
    u_sup = 0.9 * (found.input_bound if found.input_bound is not None else 1.0) if model.m else 0.0
    t = np.linspace(0, 10, 21)
    for _ in range(RUNS):
        x0 = center + rng.normal(size=model.n) * rng.choice([0.1, 1.0, 5.0])
        if found.scope == "regional":
            x0 = center + (x0 - center) * 1e-3 if found.V(x0[None])[0] >= found.level else x0
            try:
                found.overshoot(x0)
            except ps.PersidError:
                continue
        u = None
        if model.m:
            v = rng.normal(size=(len(t), model.m))
            u = found.input + u_sup * v / np.linalg.norm(v, axis=1, keepdims=True)
        run = model.simulate(x0, t, u)[0]
        if run.diverged_at is not None:
            return f"diverges from {x0.tolist()}"
        if found.rate is not None:
            bound = found.bound(x0, u_sup, t[: len(run.x)])
            over = np.linalg.norm(run.x - center, axis=1) - bound
            if (over > FAR * (1 + bound)).any():
                return f"|x - x*| passes its bound from {x0.tolist()} by {over.max()}"
        elif not found.counts_b:
            free = model.simulate(x0, t, np.tile(found.input, (len(t), 1)) if model.m else None)[0]
            V = found.V(free.x)
            if (np.diff(V) > FAR * (1 + np.abs(V[0]))).any():
                return f"V grows from {x0.tolist()}"
    return None


def differs(drawn: Drawn, verdict: object, seed: int) -> str | None:
    """Return how the verdict on a twin differs, None where it does not."""
    other = asked(drawn.twin(seed))
    one, two = (type(each).__name__ for each in (verdict, other))
    return None if one == two else f"{one}, its twin {two}"


@pytest.mark.long
@pytest.mark.parametrize("seed", range(12))
def test_random_models_have_verdicts_that_simulations_and_twins_share(seed: int) -> None:
    """No exception, no run that contradicts a certificate, and the same verdict in other orders, signs and units."""
    drawn = Drawn.of(seed)
    verdict = asked(drawn)
    assert contradicted(drawn, verdict) is None
    assert differs(drawn, verdict, seed) is None


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=pytest.mark.long if k < 100 else pytest.mark.slow) for k in range(12, 400)]
)
def test_many_random_models_have_verdicts_that_simulations_share(seed: int) -> None:
    """The same for hundreds of models, without twins."""
    drawn = Drawn.of(seed)
    assert contradicted(drawn, asked(drawn)) is None
