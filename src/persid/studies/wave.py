"""The paper's wave study: GPS against ARX, polynomials and radial functions. Paper: Sec. 5.2, its table and Figure 2.

    x_t = x_yy + B u + 0.5 sin x + 0.3 cos 2x + 0.05 x^2 + d on [0, 3 pi], Neumann, 100 points, 100 steps of 0.03 s,
    B = 1 on the middle fifth; the paper's run has x(y, 0) = sin y, u = sin t + 0.5 cos 2t, and d = 0.1 sin 3t

Despite its name a diffusion equation. Every model is fitted to runs with random smooth initial profiles and inputs and
the same d; its ridge is tuned on separate runs; free runs are scored on held-out runs and on the paper's own, by
several seeds. "One run" is the paper's setting: the fit and the score on its run alone.
"""

import time
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from typing import Literal, NotRequired, TypedDict

import numpy as np
from matplotlib.figure import Figure
from numpy import ndarray

import persid as ps
from persid import plots
from persid.identification.baselines import OneStepRegressor
from persid.identification.free_runs import Score, free_run_score, one_step, score
from persid.models.steps import runge_kutta
from persid.reports.figures import Drawing
from persid.reports.record import versions
from persid.studies.cells import Rows, ScoreCell, VerdictCell, errors
from persid.studies.parts import Parts
from persid.studies.tables import Figures, Study, Table, number, protocol, spread

REVISION = 3  # raised with every change of what is computed: parts of other revisions are not reused

DT, STEPS, SUBSTEPS = 0.03, 100, 20
SEEDS = 5
TIME_LIMIT = 30.0  # s for the verdict on a model
PLAIN = ("x", "x**3", "sinh(x)", "tanh(x)")
TRANSLATED = ("x", "x**3", "tanh(x)", "tanh(x - 1)", "tanh(x + 1)", "tanh(x - 2)", "tanh(x + 2)")
Fitted = ps.PersidskiiIdentifier | OneStepRegressor
RIDGES = {"gps": (1e-4, 1e-2, 0.1), "one step": (1e-2, 1.0, 100.0, 1e4), "poly": (100.0, 1e4)}


class Options(TypedDict):
    """How a model is identified: its functions; whether neighbours alone count, with coefficients that all share."""

    functions: Sequence[str]
    stencil: NotRequired[bool]
    shared: NotRequired[bool]


GPS: dict[str, Options] = {
    "GPS, full": {"functions": PLAIN},
    "GPS, stencil": {"functions": PLAIN, "stencil": True},
    "GPS, shared stencil": {"functions": PLAIN, "stencil": True, "shared": True},
    "GPS, shared, translated functions": {"functions": TRANSLATED, "stencil": True, "shared": True},
}
BASELINES = {"ARX(2, 2)": "arx", "POLY-2": "poly", "RBF-50": "rbf"}
SHARED = "GPS, shared stencil"
QUICK = ("GPS, full", SHARED, "ARX(2, 2)", "RBF-50")
PAPER = {
    "ARX(2, 2)": "1.0329 / -5.0861",
    "POLY-2": "0.7528 / -2.7528",
    "RBF-50": "0.7489 / -2.7567",
    "GPS, full": "0.1125 / 0.9163",
}


@dataclass(frozen=True)
class Size:
    """Sizes of the study: points of the grid, and runs to fit, to tune and to score."""

    points: int = 100
    fit: int = 50
    tune: int = 3
    held_out: int = 10


class Cell(TypedDict):
    """What one model does for one seed: errors by kind of run, the ridge, seconds of a fit, the paper's run."""

    scores: dict[str, ScoreCell]
    ridge: float
    seconds: float
    run: Rows


class OneRun(TypedDict):
    """Errors on the paper's run of a fit to that run alone: of the free run, and one step ahead."""

    free: ScoreCell
    one_step: float | None


class Cost(TypedDict):
    """Seconds of the processor and largest new memory of a fit."""

    seconds: float
    bytes: int


@dataclass(frozen=True)
class Found:
    """All that the study computes, by model; no verdicts and no costs where it is quick."""

    cells: Mapping[str, Sequence[Cell]]
    single: Mapping[str, OneRun]
    verdicts: Mapping[str, VerdictCell]
    costs: Mapping[str, Cost]


def run(parts: Parts, quick: bool = False, seeds: int | None = None) -> Study:
    """Run the study. With `quick`: 30 points, 12 runs, one seed, four models, no verdict."""
    size = Size(30, 12, 2, 3) if quick else Size()
    models = [label for label in (*GPS, *BASELINES) if label in QUICK or not quick]
    count = seeds or (1 if quick else SEEDS)
    parts = parts.of(len(models) * (count + 1) + (0 if quick else len(GPS) + len(models)))
    cells = {(label, seed): _cell(parts, label, size, seed) for seed in range(count) for label in models}
    found = Found(
        cells={label: [cells[label, seed] for seed in range(count)] for label in models},
        single={label: _single(parts, label, size) for label in models},
        verdicts={} if quick else {label: _verdict(parts, label, size) for label in GPS},
        costs={} if quick else {label: _cost(parts, label, size) for label in models},
    )
    return Study(
        name="wave",
        title="Wave: generalized Persidskii models against three baselines",
        protocol=protocol(__doc__),
        tables=_tables(found),
        drawings=(_drawing(found.cells, size),),
        figures=_figures(found),
        remarks=REMARKS,
        seconds=parts.total,
        quick=quick,
        versions=versions(),
    )


@cache
def runs(points: int, count: int, seed: int) -> ps.Trajectories:
    """Return random runs: smooth initial profiles and inputs, the paper's disturbance."""
    rng = np.random.default_rng(seed)
    y, t = np.linspace(0, 3 * np.pi, points), np.arange(STEPS) * DT
    modes = np.cos(np.outer(np.arange(8), y) / 3) / (1 + np.arange(8) / 3)[:, None]
    start = rng.normal(0, 0.4, (count, 8)) @ modes  # about as large as the paper's sin y
    size, pace, phase = (
        rng.normal(0, 0.6, (count, 3)),
        rng.uniform(0.5, 4, (count, 3)),
        rng.uniform(0, 6.28, (count, 3)),
    )
    return _integrate(y, t, start, lambda s: (size * np.sin(pace * s + phase)).sum(axis=1))


@cache
def paper_run(points: int) -> ps.Trajectories:
    """Return the paper's one run."""
    y, t = np.linspace(0, 3 * np.pi, points), np.arange(STEPS) * DT
    return _integrate(y, t, np.sin(y)[None], lambda s: np.array([np.sin(s) + 0.5 * np.cos(2 * s)]))


def _integrate(y: ndarray, t: ndarray, start: ndarray, u: Callable[[float], ndarray]) -> ps.Trajectories:
    """Integrate all runs at once by Runge-Kutta, with steps well inside the stability limit of diffusion."""
    dx, middle = y[1] - y[0], (np.abs(y - 1.5 * np.pi) <= 0.3 * np.pi).astype(float)

    def rate(x: ndarray, s: float) -> ndarray:
        ghost = np.hstack([x[:, 1:2], x, x[:, -2:-1]])  # x_y = 0 at both ends
        f = 0.5 * np.sin(x) + 0.3 * np.cos(2 * x) + 0.05 * x**2 + 0.1 * np.sin(3 * s)
        return np.asarray(np.diff(ghost, 2) / dx**2 + u(s)[:, None] * middle + f)

    x, states, h = start, [start], DT / SUBSTEPS
    for s in t[:-1]:
        for k in range(SUBSTEPS):
            now = s + k * h
            x = runge_kutta(rate, x, h, (now, now + h / 2, now + h))
        states.append(x)
    found, inputs = np.stack(states, axis=1), np.stack([u(s) for s in t], axis=1)
    return ps.Trajectories.from_arrays(list(found), list(inputs), t=[t] * len(found))


def _fit(label: str, data: ps.Trajectories, ridge: float, seed: int = 0) -> Fitted:
    if label in BASELINES:
        return OneStepRegressor(BASELINES[label], ridge, seed).fit(data)
    options = GPS[label]
    place = np.arange(len(data.states))
    pattern = np.abs(place[:, None] - place) <= 1 if options.get("stencil") else None
    return ps.PersidskiiIdentifier(
        options["functions"], ridge=ridge, window=2, x_ref=0.0, scale=1.0, hold="paper", pattern=pattern,
        shared=options.get("shared", False), holdout=0.0, allow_underdetermined=True,
    ).fit(data)  # fmt: skip


@dataclass(frozen=True)
class Coarse:
    """A model whose runs are integrated to five digits: errors here are seen in the second."""

    model: ps.PersidskiiModel

    def simulate(self, x0: object, t: ndarray, u: object = None) -> ps.Trajectories:
        """Return the run from x0."""
        return self.model.simulate(x0, t, u, rtol=1e-5, atol=1e-7)


def _free_runs(model: Fitted, data: ps.Trajectories) -> Score:
    if isinstance(model, OneStepRegressor):
        return model.free_run(data)
    return free_run_score(Coarse(model.model_), data, "paper")


def _strengths(label: str) -> Sequence[float]:
    if label in GPS:
        return RIDGES["gps"]
    return RIDGES["poly" if label == "POLY-2" else "one step"]


def _data(size: Size, seed: int) -> tuple[ps.Trajectories, ps.Trajectories, ps.Trajectories]:
    """Return the runs to fit, to tune and to score of one seed."""
    all_runs = runs(size.points, size.fit + size.tune + size.held_out, seed)
    return all_runs[: size.fit], all_runs[size.fit : size.fit + size.tune], all_runs[size.fit + size.tune :]


def _tuned(label: str, size: Size, seed: int, say: Callable[[str], None]) -> tuple[Fitted, float, float]:
    """Return the model whose ridge is best on the runs to tune, that ridge, and the seconds of a fit."""
    fit, tune, _ = _data(size, seed)
    tried, seconds = [], 0.0
    for ridge in _strengths(label):
        say(f"ridge {ridge:g}")
        started = time.process_time()
        model = _fit(label, fit, ridge, seed)
        seconds += time.process_time() - started
        found = _free_runs(model, tune)
        tried.append((found.blow_ups, found.rmse, ridge, model))
    _, _, ridge, model = min(tried, key=lambda one: one[:3])
    return model, ridge, seconds / len(tried)


def _cell(parts: Parts, label: str, size: Size, seed: int) -> Cell:
    """Return the scores of one model for one seed."""
    name = f"{label}, seed {seed}"
    return parts.part(name, _parameters(label, size), partial(_compute, label, size, seed, parts.within(name)))


def _parameters(label: str, size: Size) -> dict[str, object]:
    return {"size": asdict(size), "strengths": list(_strengths(label)), "options": GPS.get(label, {})}


def _compute(label: str, size: Size, seed: int, say: Callable[[str], None]) -> Cell:
    model, ridge, seconds = _tuned(label, size, seed, say)
    say("free runs")
    held, paper = _free_runs(model, _data(size, seed)[2]), _free_runs(model, paper_run(size.points))
    own = paper_run(size.points)[0]
    start = own.x[: model.lags] if isinstance(model, OneStepRegressor) else own.x[0]
    found = model.simulate(start, own.t, own.u)[0].x
    return {
        "scores": {"held out": errors(held), "paper run": errors(paper)}, "ridge": ridge, "seconds": seconds,
        "run": np.round(found, 4).tolist() if seed == 0 else [],
    }  # fmt: skip


def _single(parts: Parts, label: str, size: Size) -> OneRun:
    """Return the errors on the paper's run of a fit to that run alone: one step ahead, and in a free run."""

    def compute() -> OneRun:
        data = paper_run(size.points)
        model = _fit(label, data, _strengths(label)[0])
        return {"free": errors(_free_runs(model, data)), "one_step": _one_step(model, data)}

    return parts.part(f"{label}, one run", _parameters(label, size), compute)


def _one_step(model: Fitted, data: ps.Trajectories) -> float | None:
    """Return the RMSE of predictions one step ahead."""
    if isinstance(model, OneStepRegressor):
        return None
    run = data[0]
    return score(run.x[1:], one_step(model.model_, run, "paper", 20)[:-1]).rmse


def _verdict(parts: Parts, label: str, size: Size) -> VerdictCell:
    """Return the verdict on the model of the first seed."""

    name = f"{label}, verdict"

    def compute() -> VerdictCell:
        model = _tuned(label, size, 0, parts.within(name))[0].model_
        verdict = ps.certify(model, time_limit=TIME_LIMIT, progress=parts.within(name))
        return parts.verdict(f"{label}, seed 0", model, verdict)

    return parts.part(name, _parameters(label, size) | {"limit": TIME_LIMIT}, compute)


def _cost(parts: Parts, label: str, size: Size) -> Cost:
    """Return processor seconds and the largest new memory of one fit to the runs of the first seed."""

    def compute() -> Cost:
        data, ridge = _data(size, 0)[0], _strengths(label)[0]
        started = time.process_time()
        _fit(label, data, ridge)
        seconds = time.process_time() - started
        tracemalloc.start()
        _fit(label, data, ridge)
        _, largest = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return {"seconds": seconds, "bytes": largest}

    return parts.part(f"{label}, cost", _parameters(label, size), compute)


def _tables(found: Found) -> tuple[Table, ...]:
    errors = tuple(
        (
            label, PAPER.get(label, "—"), _spread(column, "paper run", "rmse"), _spread(column, "paper run", "r2"),
            _spread(column, "held out", "rmse"), str(sum(cell["scores"]["held out"]["blow_ups"] for cell in column)),
            f"{column[0]['ridge']:g}", f"{column[0]['seconds']:.1f}",
        )
        for label, column in found.cells.items()
    )  # fmt: skip
    alone = tuple(
        (label, number(cell["one_step"]), "blows up" if cell["free"]["blow_ups"] else number(cell["free"]["rmse"]))
        for label, cell in found.single.items()
    )
    proofs = tuple(
        (label, v["verdict"], v["reason"] or f"scope {v['scope']}", f"{v['seconds']:.0f}")
        for label, v in found.verdicts.items()
    )
    head = (
        "model",
        "paper: RMSE / R2",
        "paper's run: RMSE",
        "R2, pooled",
        "held out: RMSE",
        "blow-ups",
        "ridge",
        "s a fit",
    )
    tables = (
        Table("errors", "Free runs; median (least … largest) over the seeds", head, errors),
        Table(
            "one-run",
            "Fitted to the paper's run alone and scored on it",
            ("model", "one step: RMSE", "free run: RMSE"),
            alone,
        ),
    )
    if not proofs:
        return tables
    sizes = tuple((label, f"{c['seconds']:.2f}", f"{c['bytes'] / 2**20:.0f}") for label, c in found.costs.items())
    return (
        *tables,
        Table("verdicts", "Verdicts on the models of the first seed", ("model", "verdict", "reason", "s"), proofs),
        Table("costs", "One fit: processor time and largest new memory", ("model", "s", "MiB"), sizes),
    )


def _spread(column: Sequence[Cell], kind: str, what: Literal["rmse", "r2"]) -> str:
    scores = [cell["scores"][kind] for cell in column]
    if what == "r2" and any(score["blow_ups"] for score in scores):
        return "—"
    return spread([None if score["blow_ups"] else score[what] for score in scores])


def _figures(found: Found) -> Figures:
    figures: Figures = {}
    for label, column in found.cells.items():
        for seed, cell in enumerate(column):
            for kind in ("paper run", "held out"):
                figures[f"{label}, seed {seed}, {kind}: RMSE"] = _error(cell["scores"][kind])
    figures |= {f"{label}, one run: RMSE": _error(cell["free"]) for label, cell in found.single.items()}
    return figures | {f"{label}: verdict": verdict["verdict"] for label, verdict in found.verdicts.items()}


def _error(score: ScoreCell) -> float | None:
    return None if score["blow_ups"] else score["rmse"]


def _drawing(cells: Mapping[str, Sequence[Cell]], size: Size) -> Drawing:
    """Draw the paper's run and every model's, at the last time over space and at the middle over time."""
    own, y = paper_run(size.points)[0], np.linspace(0, 3 * np.pi, size.points)
    figure = Figure(figsize=(10, 2.6 * len(cells)), layout="constrained")
    for k, (label, column) in enumerate(cells.items()):
        found, middle = np.array(column[0]["run"]), size.points // 2
        left, right = figure.add_subplot(len(cells), 2, 2 * k + 1), figure.add_subplot(len(cells), 2, 2 * k + 2)
        left.plot(own.t, own.x[:, middle], color=plots.MEASURED, label="data")
        left.plot(own.t[: len(found)], found[:, middle], color=plots.MODEL, ls="--", label=label)
        left.set(xlabel="t in s", ylabel="x in the middle")
        right.plot(y, own.x[len(found) - 1], color=plots.MEASURED, label="data")
        right.plot(y, found[-1], color=plots.MODEL, ls="--", label=label)
        right.set(xlabel="y", ylabel=f"x at {own.t[len(found) - 1]:.2f} s")
        left.legend(frameon=False, fontsize="small")
    return Drawing(
        "figure-2",
        figure,
        "Predictions of every model beside the paper's run, over time in the middle and over space at the end",
        "The paper's Figure 2: free runs of each model (red, dashed) against the data (blue), first seed.",
    )


REMARKS = (
    "That GPS is seven times better than every baseline did not reproduce. With the ridge tuned on separate runs, "
    "ARX(2, 2) is the best model on held-out runs. On the paper's run the full GPS comes to the paper's own figure for "
    "one seed and misses it twentyfold for another. (The paper's text has other figures: 0.1139 / 0.9488.)",
    "On the paper's run the errors of the full GPS and of ARX change by an order of magnitude from seed to seed. Its "
    "initial profile has a slope at the ends, which the boundary condition forbids and no run of the fit has.",
    "Fitted to the paper's run alone, 100 samples against 402 unknowns in an equation, models reproduce that run; "
    "this says nothing about another one.",
    "Odd functions about 0 cannot represent cos 2x and x squared; translated functions lower the held-out error of the "
    "shared model. Sharing coefficients along the chain is wrong at its two ends, where the Neumann condition has "
    "another stencil, so that shared models stay behind the full one on the paper's run.",
    "No verdict on a model: no equilibrium at the nominal input was found. The true system blows up at about "
    "14 s, so that a good model of it is not input-to-state stable.",
)
