"""Figures of the measurements, and of how a model and its fit stand up to them."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from numpy import ndarray

from persid.identification.diagnostics import Spectrum
from persid.identification.validation import Curve
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.plots.style import DASHES, FIELD, FORM, INK, LEVEL, MEASURED, MODEL, POINTS, limits, short, span, thin, tidy

MOST_RUNS, MOST_GAPS = 40, 200  # drawn in an overview
LONG = 3.0  # a step of so many median steps counts as a gap
LANE = 0.78  # of the distance of two lanes is filled by a curve
APART = 0.015  # of the whole time stands between runs that do not follow each other


def overview(ax: Axes, data: Trajectories, columns: Sequence[int] | None = None) -> Axes:
    """Draw the measurements, each column in a lane of its own scaled to its range, which is written beside it.

    `columns` counts states first, then inputs. Gaps between runs and long steps inside a run are shaded. Runs whose
    times do not follow each other stand side by side, with a line between them; at most 40 are drawn.
    """
    names = [*data.states, *data.inputs]
    columns = range(len(names)) if columns is None else columns
    runs = data[:MOST_RUNS]
    starts, one_clock = _starts(runs)
    values = [np.hstack([run.x, run.u]) for run in runs]
    for lane, c in enumerate(columns):
        low, high = _range([v[:, c] for v in values])
        color, step = (MEASURED, "default") if c < len(data.states) else (INK, "steps-post")
        for start, run, v in zip(starts, runs, values, strict=True):
            t, y = thin(run.t, v[:, c], max(POINTS // len(runs), 30))
            level = -lane + LANE * ((y - low) / (high - low) - 0.5)
            ax.plot(t - run.t[0] + start, level, color=color, lw=0.9, drawstyle=step)
        ax.text(
            1.01, -lane, f"{low:.4g} … {high:.4g}", transform=ax.get_yaxis_transform(), va="center", fontsize="small"
        )
    for a, b in gaps(runs):
        ax.axvspan(a, b, color=MODEL, alpha=0.18, lw=0)
    if not one_clock:
        for start in starts[1:]:
            ax.axvline(start - APART / 2 * starts[-1], color=FIELD, lw=0.8)
    ax.set_yticks([-k for k in range(len(columns))], [short(names[c]) for c in columns])
    ax.set_ylim(0.6 - len(columns), 0.6)
    ax.set_xlabel("t in s" if one_clock else "t in s, runs one after another")
    tidy(ax).grid(axis="y", visible=False)
    return ax


def _starts(runs: Trajectories) -> tuple[list[float], bool]:
    """Return where each run begins on the axis, and whether these are the runs' own times."""
    if all(b.t[0] > a.t[-1] for a, b in pairwise(runs)):
        return [float(run.t[0]) for run in runs], True
    lengths = np.array([run.t[-1] - run.t[0] for run in runs])
    return [0.0, *np.cumsum(lengths[:-1] + APART * lengths.sum()).tolist()], False


def _range(parts: Sequence[Float[ndarray, " _"]]) -> tuple[float, float]:
    low, high = min(float(v.min()) for v in parts), max(float(v.max()) for v in parts)
    return (low, high) if high > low else span(np.array([low]), 0.5)


def gaps(runs: Trajectories) -> list[tuple[float, float]]:
    """Return where nothing was measured, as times of the overview: long steps in runs, and between runs on one clock.

    A step is long beyond three median steps of its run; at most 200 are returned.
    """
    found, (starts, one_clock) = [], _starts(runs)
    for start, run in zip(starts, runs, strict=True):
        steps, t = np.diff(run.t), run.t - run.t[0] + start
        found += [(float(t[k]), float(t[k + 1])) for k in np.flatnonzero(steps > LONG * np.median(steps))]
    if one_clock:
        found += [(float(a.t[-1]), float(b.t[0])) for a, b in pairwise(runs)]
    return found[:MOST_GAPS]


FOUND: dict[str, object] = {"color": MODEL, "lw": 1.3, "ls": DASHES, "label": "model, free run"}
BESIDE: dict[str, Any] = {"color": FORM, "lw": 1.2, "ls": ":", "label": "free fit"}


def free_run(
    ax: Axes,
    measured: Trajectory,
    found: Trajectory | Sequence[Trajectory],
    state: int,
    name: str = "x",
    beside: Trajectory | None = None,
) -> Axes:
    """Draw one state as measured and as the model predicts it from the first sample and the inputs; mark a blow-up.

    `found` may be several runs that start again along the measured one. `beside` is the run of another model, such as
    the free fit beside one under the certificate.
    """
    runs = [found] if isinstance(found, Trajectory) else list(found)
    ax.plot(*thin(measured.t, measured.x[:, state]), color=MEASURED, lw=1.6, label="measured")
    low, high = span(measured.x[:, state], 0.6)
    looks = [*([(beside, BESIDE)] if beside is not None else []), (runs[0], FOUND)]
    looks += [(run, FOUND | {"label": None}) for run in runs[1:]]
    for run, look in looks:
        inside = np.clip(run.x[:, state], low - (high - low), high + (high - low))
        ax.plot(*thin(run.t, inside), **look)
    ax.set_ylim(*limits(measured.x[:, state], np.concatenate([run.x[:, state] for run in runs])))
    if len(runs) == 1 and runs[0].diverged_at is not None:
        blow_up(ax, runs[0].diverged_at)
    ax.set_xlabel("t in s")
    ax.set_ylabel(short(name, 15))
    return tidy(ax)


def blow_up(ax: Axes, time: float) -> Axes:
    """Mark the time at which a free run diverges."""
    ax.axvline(time, color=MODEL, lw=0.8)
    ax.plot([time], [0.93], marker="X", ms=8, color=MODEL, transform=ax.get_xaxis_transform(), clip_on=False)
    low, high = ax.get_xlim()
    left = time - low > 0.6 * (high - low)  # the words stand where there is room for them
    ax.annotate(f"blows up at {time:.4g} s", (time, 0.93), xycoords=ax.get_xaxis_transform(),
                xytext=(-7 if left else 7, -3), ha="right" if left else "left", textcoords="offset points",
                color=MODEL)  # fmt: skip
    return ax


def residuals(ax: Axes, t: Float[ndarray, " N"], residual: Float[ndarray, " N"], name: str = "x") -> Axes:
    """Draw what is left of one state after predicting it one step ahead, over time in s."""
    ax.axhline(0, color=FIELD, lw=0.8)
    ax.plot(*thin(t, residual), color=MEASURED, lw=0.8)
    ax.set_ylim(*limits(residual))
    ax.set_xlabel("t in s")
    ax.set_ylabel(short(name, 15))
    return tidy(ax)


def validation_curve(ax: Axes, curve: Curve, chosen: float | None = None) -> Axes:
    """Draw the free-run error on left-out blocks against the ridge; crosses mark strengths at which runs blow up."""
    strengths, errors, blown = (np.array(part) for part in (curve.strengths, curve.errors, curve.blow_ups))
    ax.loglog(strengths, errors, color=MODEL, marker="o", ms=4, lw=1.4, label="error of free runs")
    if (blown > 0).any():
        ax.loglog(strengths[blown > 0], errors[blown > 0], "X", ms=9, color=FORM, ls="none", label="some runs blow up")
    if chosen:
        ax.axvline(chosen, color=FIELD, lw=1, ls=":", label=f"used: {chosen:.3g}")
    ax.set_xlabel("ridge (relative to scaled columns)")
    ax.set_ylabel("RMSE in widths of the data")
    ax.legend(frameon=False)
    return tidy(ax)


def koopman_spectrum(ax: Axes, spectrum: Spectrum) -> Axes:
    """Draw the eigenvalues of a Koopman matrix in the complex plane, the unit circle, and where aliasing begins.

    In the shaded sector an eigenvalue turns so far in one sample that its sense and its frequency are not to be told.
    """
    values = np.array(spectrum.values)
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 241))
    ax.plot(circle.real, circle.imag, color=FIELD, lw=1, label="unit circle")
    reach = max(1.25, 1.1 * float(np.hypot(*values.T).max()))
    edge = 3 * reach * np.exp(1j * np.linspace(spectrum.limit, 2 * np.pi - spectrum.limit, 3))
    ax.fill([0, *edge.real], [0, *edge.imag], color=FORM, alpha=0.25, lw=0, label="aliasing")
    ax.plot(*values.T, "o", ms=6, mfc="none", mew=1.4, color=MODEL, label="eigenvalues")
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal")
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return tidy(ax)


def fits(ax: Axes, r2: dict[str, Sequence[float]], states: Sequence[str]) -> Axes:
    """Draw R² of free runs, a row a state, for fits by their names: the free one and the one under the certificate."""
    for k, (name, values) in enumerate(r2.items()):
        shown = np.maximum(np.asarray(values[: len(states)], float), 0)
        ax.plot(shown, -np.arange(len(shown)), "os^D"[k % 4], ms=8 - 2 * (k > 0), mfc="none" if k == 0 else None,
                mew=1.6, color=(MODEL, LEVEL, MEASURED, FORM)[k % 4], label=name, clip_on=False, zorder=3)  # fmt: skip
    ax.set_yticks([-k for k in range(len(states))], [short(name) for name in states])
    ax.set_ylim(0.5 - len(states), 0.5)
    ax.set_xlim(right=1.0)
    ax.locator_params(axis="x", nbins=4)
    ax.set_xlabel("R² of free runs")
    ax.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    return tidy(ax)


def candidates(ax: Axes, names: Sequence[str], errors: Sequence[float | None], certified: Sequence[bool]) -> Axes:
    """Draw the errors of candidate fits, the best on top; those without a certificate are hollow.

    An error is None where no fit was feasible.
    """
    keep = sorted((e, name, good) for name, e, good in zip(names, errors, certified, strict=True) if e is not None)
    for k, (error, _, good) in enumerate(keep):
        ax.plot(error, -k, "o", ms=7, mew=1.6, color=LEVEL if good else MODEL, mfc=None if good else "none")
    ax.set_yticks([-k for k in range(len(keep))], [short(name, 48) for _, name, _ in keep])
    ax.set_ylim(0.6 - max(len(keep), 1), 0.6)
    ax.set_xlim(left=0)
    ax.locator_params(axis="x", nbins=6)
    ax.set_xlabel("error on samples that the fit had not seen")
    return tidy(ax)


def attempts(ax: Axes, names: Sequence[str], seconds: Sequence[float]) -> Axes:
    """Draw how long each attempt at a verdict took, in s, the first on top."""
    places = -np.arange(len(names))
    ax.barh(places, seconds, color=FIELD, height=0.6)
    for place, time in zip(places, seconds, strict=True):
        ax.annotate(f"{time:.2g} s", (time, place), xytext=(4, 0), textcoords="offset points", va="center")
    ax.set_yticks(places, [short(name, 48) for name in names])
    ax.set_xlim(0, 1.12 * max([*seconds, 1e-9]))
    ax.set_xlabel("time in s")
    tidy(ax).grid(axis="y", visible=False)
    return ax
