"""Evidence beside an undecided verdict: what simulations from bounded states do at the nominal input. No proof."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import islice

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json
from persid.lyapunov.operating_points import usual_box
from persid.models.integration import HUGE, has_left, lsoda_steps, quiet
from persid.models.model import PersidskiiModel

RUNS = 8  # initial states, drawn from a box
STEPS = 300  # of the solver, in one run
ITERATIONS = 1000  # steps of a model in discrete time, in one run
SPAN = 100.0  # a run lasts so many times the inverse of the largest rate of the linearisation
STILL = 0.01  # of its largest speed: a run that is slower at its end has come to rest
FAR = 1e4  # a state beyond so many times the size of the box has diverged


@dataclass(frozen=True)
class Evidence:
    """What `runs` simulations did: how many diverged, with initial state and time (s) of the first, and how many others
    were still moving at their end, at more than a hundredth of their largest speed."""

    runs: int
    diverged: int
    x0: tuple[float, ...] | None = None
    time: float | None = None
    moving: int = 0

    def to_dict(self) -> Json:
        """Return it as an object of JSON; `from_dict` is the way back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Json) -> "Evidence":
        """Return what `to_dict` was called on."""
        return cls(**{**data, "x0": data["x0"] and tuple(data["x0"])})

    def __str__(self) -> str:
        moving = f"; {self.moving} had not come to rest at their end" if self.moving else ""
        if self.time is None or self.x0 is None:
            return f"None of {self.runs} simulated runs diverged{moving}, which proves nothing."
        start = ", ".join(f"{v:.4g}" for v in self.x0[:6]) + (", …" if len(self.x0) > 6 else "")
        return (
            f"In simulations at the nominal input {self.diverged} of {self.runs} runs diverged, the first one from"
            f" ({start}) at t = {self.time:.4g} s{moving}; this is evidence, not a proof."
        )


def simulated(
    model: PersidskiiModel, u: Float[ndarray, " m"], box: Float[ndarray, "n 2"] | None = None, seed: int = 0
) -> Evidence:
    """Simulate from states of a box: that which was asked about, else that of the data, else a few units of functions.

    A run ends after a fixed number of steps, so that the time this takes is bounded; the state may diverge later.
    """
    box = usual_box(model) if box is None else box
    starts = np.random.default_rng(seed).uniform(box[:, 0], box[:, 1], (RUNS, model.n))
    starts[0] = box[:, 1]
    far = FAR * (1 + float(np.abs(box).max()))
    if model.is_discrete:
        return _evidence(starts, [_sequence(model, u, x0, far) for x0 in starts])
    with np.errstate(all="ignore"):
        rates = np.abs(np.linalg.eigvals(np.nan_to_num(model.jacobian(model.x_ref))))
    span = SPAN / (float(rates.max()) or 1.0)
    dot, force = model.field.drift(), model.field.forcing(u)

    def rate(_: float, x: ndarray) -> ndarray:
        return np.asarray(np.nan_to_num(dot(x) + force, nan=HUGE))

    return _evidence(starts, [_run(rate, x0, span, far) for x0 in starts])


def _evidence(starts: Float[ndarray, "r n"], runs: Sequence[tuple[float | None, bool]]) -> Evidence:
    """Count how runs from the starts ended."""
    times, moving = [time for time, _ in runs], sum(moves for _, moves in runs)
    first = next((k for k, time in enumerate(times) if time is not None), None)
    diverged = sum(time is not None for time in times)
    if first is None:
        return Evidence(RUNS, 0, moving=moving)
    return Evidence(RUNS, diverged, tuple(float(v) for v in starts[first]), times[first], moving)


def _run(rate: Callable[[float, ndarray], ndarray], x0: ndarray, span: float, far: float) -> tuple[float | None, bool]:
    """Return the time at which a run has left every reasonable bound, or None, and whether it moves at its end."""
    fastest = float(np.abs(rate(0.0, x0)).max())
    with quiet():
        for solver in islice(lsoda_steps(rate, x0, (0.0, span), rtol=1e-4, atol=1e-6), STEPS):
            if has_left(solver, far):
                return float(solver.t), False
            fastest = max(fastest, float(np.abs(rate(solver.t, solver.y)).max()))
    return None, bool(np.abs(rate(solver.t, solver.y)).max() > STILL * fastest)


def _sequence(
    model: PersidskiiModel, u: Float[ndarray, " m"], x0: Float[ndarray, " n"], far: float
) -> tuple[float | None, bool]:
    """The same of a model in discrete time, over a fixed number of its steps."""
    x, fastest, speed = x0, 0.0, 0.0
    for k in range(1, ITERATIONS + 1):
        after = np.nan_to_num(model.rhs(x, u), nan=HUGE, posinf=HUGE, neginf=-HUGE)
        if not np.abs(after).max() < far:
            return k * float(model.dt or 0.0), False
        speed, x = float(np.abs(after - x).max()), after
        fastest = max(fastest, speed)
    return None, speed > STILL * fastest
