"""Suspicions: what the measurements alone tell of a sensor, a file or an experiment that no model can mend."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.measurements.trajectories import Trajectories

FEWEST = 50  # samples that tell something
SATURATED = 0.05  # share of the samples at one extreme of a state
COARSE = 0.05  # of the deviation: a step of a sensor that matters
REPEATED = 0.3  # share of samples that repeat the one before, or that lie on a straight line between neighbours
FAR = 3.0  # widths of the other samples that a code lies away from them
CODES = (9999.0, 999.0, 99999.0, 99.0, 999999.0, 32767.0, 32768.0, 65535.0)
THIN = ("repeated", "interpolated")  # kinds of stretches between measurements
SAME = 1e-7  # of a deviation: as good as equal


@dataclass(frozen=True)
class Suspicion:
    """What is suspicious: `kind` for programs, `text` for people, `column`, and the number that goes with it."""

    kind: str
    text: str
    column: str
    number: float = 0.0


def missing_codes(data: Trajectories) -> Iterator[Suspicion]:
    """Yield values far outside all others that stand again and again in a column: they mean "missing"."""
    values = _all(data)
    for name, column in zip((*data.states, *data.inputs), values.T, strict=True):
        for extreme in {float(column.min()), float(column.max())}:
            at = column == extreme
            rest = column[~at]
            if not len(rest) or at.mean() > 0.5:
                continue
            width = float(np.ptp(rest))
            away = min(abs(extreme - float(rest.min())), abs(extreme - float(rest.max())))
            usual = abs(extreme) in CODES
            if width > 0 and away > FAR * width and (usual or (at.sum() >= 3 and abs(extreme) >= 1e3)):
                text = f"{name} is {extreme:g} in {int(at.sum())} samples, far outside all others: a code for missing?"
                yield Suspicion("missing", text, name, extreme)


def sensor_limits(data: Trajectories) -> Iterator[Suspicion]:
    """Yield states whose samples crowd at an extreme or on few levels."""
    x = _all(data)[:, : len(data.states)]
    for name, column in zip(data.states, x.T, strict=True):
        levels, counts = np.unique(column, return_counts=True)
        if len(column) < FEWEST or len(levels) < 2:
            continue
        step = float(np.diff(levels).min())
        if len(levels) <= len(column) // 4 and step > COARSE * float(column.std()) and _on_grid(levels, step):
            text = f"{name} moves in steps of {step:.3g}, {step / column.std():.2g} of its deviation: a coarse sensor"
            yield Suspicion("quantised", text, name, step)
            continue
        shares = counts / len(column)
        for end, word in ((0, "lowest"), (-1, "highest")):
            if shares[end] >= SATURATED and shares[end] > 5 * float(np.median(shares)):
                share = f"{100 * shares[end]:.0f} % of the samples of {name} are at its {word} value, {levels[end]:.4g}"
                yield Suspicion("saturated", f"{share}: a saturated sensor?", name, float(shares[end]))


def _on_grid(levels: ndarray, step: float) -> bool:
    places = (levels - levels[0]) / step
    return bool((np.abs(places - np.round(places)) < 1e-3).all())


def thin_stretches(data: Trajectories) -> Iterator[Suspicion]:
    """Yield the number of samples between two measurements, where the others repeat or lie on straight lines."""
    for kind, order, what in (("repeated", 1, "repeat the one before"), ("interpolated", 2, "lie on straight lines")):
        flat = [_flat(run.x, order) for run in data if len(run) > order + 2]
        share = float(np.concatenate(flat).mean()) if flat else 0.0
        moving = any(np.ptp(run.x, axis=0).any() for run in data)
        if not moving or share < REPEATED or sum(map(len, flat)) < FEWEST:
            continue
        every = max(2, round(1 / max(1 - share, 1e-3)))
        if every > min(map(len, data)) // 4:  # at rest, not slow
            continue
        text = f"{100 * share:.0f} % of the samples {what}: about every {nth(every)} is a measurement"
        yield Suspicion(kind, text, ", ".join(data.states), float(every))
        return


def _flat(x: Float[ndarray, "N n"], order: int) -> ndarray:
    """Whether differences of some order vanish for all states, while the run moves."""
    size = np.abs(x).max(axis=0) + np.ptp(x, axis=0)
    flat: ndarray = np.abs(np.diff(x, order, axis=0)) <= SAME * np.where(size > 0, size, 1.0)
    return np.asarray(flat.all(axis=1))


def nth(number: int) -> str:
    """Return an ordinal number in words."""
    return {2: "second", 3: "third"}.get(number, f"{number}th")


def differences(data: Trajectories) -> Iterator[Suspicion]:
    """Yield states that are difference quotients of another state, or sums and differences of two others."""
    x = [run.x for run in data if len(run) > 3]
    h = [np.diff(run.t)[:, None] for run in data if len(run) > 3]
    if not x:
        return
    n = len(data.states)
    size = np.concatenate(x).std(axis=0)
    for j in range(n):
        for i in (i for i in range(n) if i != j and size[j] > 0):
            quotients = [np.diff(run[:, i : i + 1], axis=0) / step for run, step in zip(x, h, strict=True)]
            ways = (
                np.concatenate([q[:, 0] - run[1:, j] for q, run in zip(quotients, x, strict=True)]),
                np.concatenate([q[:, 0] - run[:-1, j] for q, run in zip(quotients, x, strict=True)]),
                np.concatenate(
                    [(q[1:, 0] + q[:-1, 0]) / 2 - run[1:-1, j] for q, run in zip(quotients, x, strict=True)]
                ),
            )
            if any(np.median(np.abs(off)) < 1e-5 * size[j] for off in ways):
                text = f"{data.states[j]} is the difference quotient of {data.states[i]}, with all its noise"
                yield Suspicion("differenced", text, data.states[j], float(i))
                return
    yield from _combinations(data, np.concatenate(x), size)


def _combinations(data: Trajectories, x: Float[ndarray, "N n"], size: Float[ndarray, " n"]) -> Iterator[Suspicion]:
    """Yield the last state that is a combination of those before it: it carries nothing of its own."""
    names = data.states
    for j in range(len(names) - 1, 1, -1):
        others = np.column_stack([x[:, :j], np.ones(len(x))])
        weights = np.linalg.lstsq(others, x[:, j], rcond=None)[0]
        off = np.abs(x[:, j] - others @ weights).max()
        if size[j] > 0 and off < SAME * size[j]:
            used = [names[i] for i in range(j) if abs(weights[i]) * size[i] > 1e-6 * size[j]]
            yield Suspicion("combined", f"{names[j]} is a sum or difference of {', '.join(used)}", names[j])
            return


def _all(data: Trajectories) -> Float[ndarray, "N k"]:
    return np.concatenate([np.hstack([run.x, run.u]) for run in data])
