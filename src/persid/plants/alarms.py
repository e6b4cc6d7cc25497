"""Alarms: signs in the data that what an estimate assumes does not hold, each with what to do."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy import stats

from persid.errors import UnderdeterminedError
from persid.identification.bias import DOUBT, noise_bias
from persid.identification.estimates import Dictionary, Estimate, Windows, estimate, every_second, windows_of
from persid.measurements.trajectories import Trajectories

CORRELATED = 0.1  # a correlation of residuals below that does not matter
BETTER = 0.9  # share of the squared residual that the other hold leaves where it is the right one
MATTERS = 0.01  # of the size of x': a smaller error of the integrals does not matter
APART = 0.2  # share of the samples at which coarser integrals leave the band


@dataclass(frozen=True)
class Alarm:
    """What is doubtful: `kind` for programs, `text` for people, with what to do."""

    kind: str
    text: str


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data, windows and the estimate from them, as alarms look at them."""

    data: Trajectories
    phi: Dictionary
    windows: Windows
    found: Estimate
    hold: str
    instruments: bool
    confidence: float

    def again(self, data: Trajectories, window: int, hold: str) -> tuple[Windows, Estimate] | None:
        """Return the same from other data or with another hold; None where they are too few."""
        try:
            windows = windows_of(data, self.phi, window, hold, self.instruments)
            return windows, estimate(windows, self.found.used)
        except UnderdeterminedError:
            return None

    @cached_property
    def moved(self) -> Float[ndarray, "p n"] | None:
        """By how much the coefficients move where every second sample is left out; None where too few are left."""
        halved = Trajectories(tuple(every_second(self.data)), self.data.states, self.data.inputs)
        again = self.again(halved, max(2, self.windows.window // 4 * 2), self.hold)
        return None if again is None else again[1].theta - self.found.theta

    @property
    def quadrature(self) -> Float[ndarray, "p n"]:
        """How far the error of integrals may have moved the coefficients: of order h^2 or higher, so by a third of
        what steps of 2 h move them; 0 where that is not known.
        """
        return np.zeros_like(self.found.theta) if self.moved is None else self.moved / 3


def alarms(about: Evidence) -> Iterator[Alarm]:
    """Yield what speaks against an estimate."""
    yield from _disagreement(about)
    yield from _correlation(about)
    yield from _other_hold(about)
    yield from _quadrature(about)
    yield from _noise_bias(about)


def _noise_bias(about: Evidence) -> Iterator[Alarm]:
    """Least squares says something else than instruments do."""
    free = np.asarray(about.found.used.any(axis=0))
    bias = None if about.instruments else noise_bias(about.data, about.phi.model, free, about.hold)
    yield from (Alarm("noise bias", text) for text in (bias.remark(about.phi.model.states) if bias else ()))


def _names(about: Evidence, chosen: Bool[ndarray, " n"]) -> str:
    return ", ".join(name for name, mine in zip(about.phi.model.states, chosen, strict=True) if mine)


def _disagreement(about: Evidence) -> Iterator[Alarm]:
    """Over-identification: instruments that are left over contradict those that were needed."""
    equations = max(int(about.found.used.any(axis=0).sum()), 1)
    doubtful = about.found.agreement < DOUBT / equations
    if doubtful.any():
        yield Alarm(
            "over-identification",
            f"earlier states foretell what the model leaves in {_names(about, doubtful)}: functions or inputs are "
            "missing, or noise has a memory; try other functions, or derivatives and delays among the states",
        )


def _correlation(about: Evidence) -> Iterator[Alarm]:
    """Residuals of windows that share no sample go together."""
    lag, r = about.windows.window + 1, about.found.residual
    products = r[lag:] * r[:-lag]
    blocks = about.windows.block[lag:]
    nb = about.windows.blocks
    means = np.array([products[blocks == b].mean(axis=0) for b in range(nb)])
    power = np.maximum((r**2).mean(axis=0), 1e-300)
    size = means.mean(axis=0) / power
    error = means.std(axis=0, ddof=1) / np.sqrt(nb) / power
    quantile = stats.t.ppf(1 - DOUBT / 2 / r.shape[1], nb - 1)
    doubtful = (np.abs(size) > quantile * error) & (np.abs(size) > CORRELATED) & about.found.used.any(axis=0)
    if doubtful.any():
        yield Alarm(
            "residual correlation",
            f"what the model leaves in {_names(about, doubtful)} has a memory (correlation "
            f"{size[np.abs(size).argmax()]:.2f} of windows that share no sample): something acts that was not "
            "measured, or a function is missing; try other functions, or measure what acts",
        )


def _other_hold(about: Evidence) -> Iterator[Alarm]:
    """The other reading of the inputs between samples leaves less."""
    other = {"zoh": "paper", "paper": "zoh"}[about.hold]
    again = about.again(about.data, about.windows.window, other) if about.data.inputs else None
    if again is None:
        return
    mine, theirs = ((e.residual**2).mean(axis=0) for e in (about.found, again[1]))
    free = about.found.used.any(axis=0)
    better = free & (theirs < BETTER * mine)
    if better.any():
        says = "vary between samples" if other == "paper" else "are held from sample to sample"
        yield Alarm(
            "hold",
            f"inputs that {says} explain {_names(about, better)} better (hold={other!r} leaves "
            f"{100 * float((theirs[better] / mine[better]).min()):.0f} % of the squared residual): fit with it",
        )


def _quadrature(about: Evidence) -> Iterator[Alarm]:
    """With every second sample left out the integrals, and the coefficients, are others."""
    if about.moved is None:
        return
    phi = about.windows.X / about.windows.X[:, -1:]  # the mean of the columns over each window
    phi = phi[:: max(1, len(phi) // 2000)]
    moved = np.abs(phi @ about.moved)
    matters = MATTERS * np.sqrt(((phi @ about.found.theta) ** 2).mean(axis=0))
    share = (moved > np.maximum(about.found.band(phi, about.confidence), matters)).mean(axis=0)
    outside = about.found.used.any(axis=0) & (share > APART)
    if outside.any():
        yield Alarm(
            "quadrature",
            f"with every second sample left out the equation of {_names(about, outside)} leaves its band: "
            "samples are too far apart for integrals; measure faster, or take shorter windows",
        )
