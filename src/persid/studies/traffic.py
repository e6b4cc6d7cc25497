"""The paper's traffic study: four disturbances, every estimator, free runs and verdicts. Paper: Sec. 5.1, Figure 1.

    x' = A x + B u + (sin x1, cos x2) + d,   x(0) = (1, 3),   u = sin t,   1000 samples on [0, 30] s

Models are fitted to the disturbed data and run freely without d. The error "on the data" is that of the run from (1, 3)
against the disturbed data; runs from near and far starts are scored against the true system without d.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Literal, TypedDict, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray
from scipy.integrate import solve_ivp

import persid as ps
from persid import plots
from persid.certified_fits.identifier import CertifiedIdentifier
from persid.identification.free_runs import free_run_score
from persid.reports.figures import Drawing
from persid.reports.record import versions
from persid.studies.cells import Refused, Rows, ScoreCell, VerdictCell, errors
from persid.studies.parts import Parts
from persid.studies.tables import Figures, Study, Table, number, protocol

A = np.array([[-0.1, 0.05], [0.05, -0.15]])
B = np.array([0.5, 0.3])
T = np.linspace(0, 30, 1000)
START = (1.0, 3.0)
NEAR = [(1.5, 3.0), (0.5, 3.0), (1.0, 3.5), (1.0, 2.5), (1.5, 2.5)]
FAR = [(6.0, 6.0), (-6.0, 6.0), (6.0, -6.0), (-6.0, -6.0), (8.0, 0.0), (-8.0, 0.0), (0.0, 8.0), (0.0, -8.0)]
TIME_LIMIT = 20.0  # s for each verdict
REGION = [[1.9, 4.2], [0.4, 2.9]]
REST = (2.922, 1.493)  # near this the true system has the equilibrium that is certified regionally

DISTURBANCES = ("d1", "d2", "d3", "d4")
SMOOTH: dict[str, Callable[[float], ndarray]] = {
    "d1": lambda t: 0.05 * np.array([np.sin(2 * t), np.cos(2 * t)]),
    "d3": lambda t: 0.1 * np.array([np.sin(t) * np.cos(2 * t), np.cos(t) * np.sin(2 * t)]),
    "d4": lambda t: np.array([np.sin(2 * t), np.cos(2 * t)]),
}
PAPER = {"d1": "0.0489 / 0.9954", "d2": "0.0059 / 0.9999", "d3": "0.0419 / 0.9966", "d4": "—"}
PAPER_VERDICTS = {"d1": "ISS", "d2": "ISS", "d3": "ISS", "d4": "not verified"}

REVISION = 2  # raised with every change of what is computed: parts of other revisions are not reused

PLAIN = {"x_ref": 0.0, "scale": 1.0}  # the functions of x itself, as in the paper
LITERAL, COORDINATES, DEFAULT = "EDMD + log, literal Γ", "EDMD + log, coordinates", "default"
ESTIMATORS: dict[str, dict[str, Any]] = {  # keywords of an identifier
    LITERAL: PLAIN | {"method": "edmd", "gamma": "literal"},
    COORDINATES: PLAIN | {"method": "edmd"},
    "least squares on derivatives": PLAIN | {"method": "derivative", "ridge": 0.0},
    "weak form, ridge 1e-05": PLAIN | {"ridge": 1e-5},
    "weak form, ridge 0.02": PLAIN | {"ridge": 0.02},
    DEFAULT: {},
    "default, refined": {"refine": True},
}
UNDER = "fitted under the certificate"
FIT_LIMIT = 60.0  # s for each fit under the certificate
STRENGTHS = (1e-5, 1e-3, 0.005, 0.02, 0.05, 0.2, 0.5)
QUICK = (COORDINATES, "weak form, ridge 1e-05", "weak form, ridge 0.02", DEFAULT)


class Cell(TypedDict):
    """What one estimator does under one disturbance: errors on the data and from other starts, the run, the verdict."""

    on_data: ScoreCell
    near: ScoreCell
    far: ScoreCell
    run: Rows
    verdict: VerdictCell


class Truth(TypedDict):
    """Verdicts on the true right-hand side, by scope, and its equilibria."""

    verdicts: dict[str, VerdictCell]
    equilibria: Rows


Tried = Cell | Refused  # refused: the Koopman matrix has no real logarithm


@dataclass(frozen=True)
class Found:
    """All that the study computes: cells by estimator and disturbance, the path of the ridge, the true system."""

    names: Sequence[str]
    cells: Mapping[str, Mapping[str, Tried]]
    strengths: Sequence[float]
    path: Mapping[str, Sequence[Cell]]
    truth: Truth


def run(parts: Parts, quick: bool = False, seeds: int | None = None) -> Study:
    """Run the study. With `quick`: d1 and d4, four estimators, two strengths, nothing fitted under the certificate.

    `seeds` is not used: the one random disturbance, d2, has its seed.
    """
    names = ("d1", "d4") if quick else DISTURBANCES
    estimators = {label: ESTIMATORS[label] for label in (QUICK if quick else ESTIMATORS)}
    strengths = (1e-5, 0.02) if quick else STRENGTHS
    parts = parts.of(len(_asked(names, estimators, strengths)) + (1 if quick else 1 + len(names)))
    cells: dict[str, dict[str, Tried]] = {
        label: {name: _cell(parts, label, options, name) for name in names} for label, options in estimators.items()
    }
    if not quick:
        cells[UNDER] = {name: _under_the_certificate(parts, name) for name in names}
    path = {name: [_weak(parts, r, name) for r in strengths] for name in names}
    truth = parts.part("true system", {"region": REGION, "limit": TIME_LIMIT}, partial(_truth_verdicts, parts))
    found = Found(names, cells, strengths, path, truth)
    return Study(
        name="traffic",
        title="Traffic: one system under four disturbances",
        protocol=protocol(__doc__),
        tables=_tables(found),
        drawings=_drawings(found),
        figures=_figures(found),
        remarks=REMARKS,
        seconds=parts.total,
        quick=quick,
        versions=versions(),
    )


def _asked(names: Sequence[str], estimators: Iterable[str], strengths: Sequence[float]) -> set[tuple[str, str]]:
    """Return the pairs of estimator and disturbance; the ridge path shares some with the table of estimators."""
    return {(label, name) for label in (*estimators, *map(_ridge, strengths)) for name in names}


def _ridge(strength: float) -> str:
    return f"weak form, ridge {strength:g}"


def true_rate(t: float, x: ndarray, d: ndarray) -> ndarray:
    """Return x' of the traffic system. Paper: eq:traffic_model."""
    return np.asarray(A @ x + B * np.sin(t) + np.array([np.sin(x[0]), np.cos(x[1])]) + d)


def true_model() -> ps.PersidskiiModel:
    """Return the system without disturbance as a model: its sine and cosine are functions of single states."""
    terms = [("sin(x)", [[1, 0]], [[1], [0]]), ("cos(x)", [[0, 1]], [[0], [1]])]
    return ps.PersidskiiModel(A, terms, B[:, None], domain=REGION)


@cache
def disturbed(name: str, seed: int = 0) -> ps.Trajectories:
    """Return the run under a disturbance; d2 is white, drawn anew for every sample and held over its step."""
    if name in SMOOTH:
        d = SMOOTH[name]
        x = solve_ivp(lambda t, x: true_rate(t, x, d(t)), (0, 30), START, t_eval=T, rtol=1e-9, atol=1e-11).y.T
    else:
        noise = np.random.default_rng(seed).normal(0, 0.05, (len(T), 2))
        states = [np.array(START)]
        for k in range(len(T) - 1):
            step = solve_ivp(true_rate, (T[k], T[k + 1]), states[-1], args=(noise[k],), rtol=1e-9, atol=1e-11)
            states.append(step.y[:, -1])
        x = np.array(states)
    return ps.Trajectories.from_arrays(x, np.sin(T), t=T)


@cache
def undisturbed(starts: tuple[tuple[float, float], ...]) -> ps.Trajectories:
    """Return the true runs without d from several starts."""
    runs = [
        solve_ivp(true_rate, (0, 30), x0, t_eval=T, args=(np.zeros(2),), rtol=1e-9, atol=1e-11).y.T for x0 in starts
    ]
    return ps.Trajectories.from_arrays(runs, [np.sin(T)] * len(runs), t=[T] * len(runs))


def _cell(parts: Parts, label: str, options: Mapping[str, Any], name: str) -> Tried:
    """Return scores, run and verdict of one estimator under one disturbance."""
    parameters = {"options": dict(options), "limit": TIME_LIMIT}
    return parts.part(f"{label}, {name}", parameters, partial(_compute, parts, label, options, name))


def _weak(parts: Parts, strength: float, name: str) -> Cell:
    """Return a cell of the weak form, which takes no logarithm that could be refused."""
    return cast("Cell", _cell(parts, _ridge(strength), PLAIN | {"ridge": strength}, name))


def _compute(parts: Parts, label: str, options: Mapping[str, Any], name: str) -> Tried:
    data = disturbed(name)
    try:
        fit = ps.PersidskiiIdentifier(**options).fit(data)
    except ps.GeneratorError as error:
        return {"refused": str(error)}
    part = f"{label}, {name}"
    verdict = ps.certify(fit.model_, time_limit=TIME_LIMIT, progress=parts.within(part))
    return _scored(fit.model_, data, parts.verdict(part, fit.model_, verdict))


def _under_the_certificate(parts: Parts, name: str) -> Cell:
    """Return scores, run and verdict of the best certified model under one disturbance."""

    def compute() -> Cell:
        data = disturbed(name)
        free = ps.PersidskiiIdentifier(**ESTIMATORS[DEFAULT])
        fit = CertifiedIdentifier(free, time_limit=FIT_LIMIT, progress=parts.within(f"{UNDER}, {name}")).fit(data)
        return _scored(fit.model_, data, parts.verdict(f"{UNDER}, {name}", fit.model_, fit.verdict_))

    return parts.part(f"{UNDER}, {name}", {"limit": FIT_LIMIT}, compute)


def _scored(model: ps.PersidskiiModel, data: ps.Trajectories, verdict: VerdictCell) -> Cell:
    """Return the scores on the data, from near and from far starts, the free run itself, and the verdict."""
    return {
        "on_data": errors(free_run_score(model, data)),
        "near": errors(free_run_score(model, undisturbed(tuple(NEAR)))),
        "far": errors(free_run_score(model, undisturbed(tuple(FAR)))),
        "run": np.round(model.simulate(START, T, data[0].u)[0].x, 5).tolist(),
        "verdict": verdict,
    }


def _truth_verdicts(parts: Parts) -> Truth:
    """Ask about the true right-hand side: on all of the plane, and in a box about one of its equilibria."""
    model, say = true_model(), parts.within("true system")
    everywhere = ps.certify(model, time_limit=TIME_LIMIT, progress=say)
    region = ps.certify(model, operating_point=REST, domain=REGION, time_limit=TIME_LIMIT, progress=say)
    return {
        "verdicts": {
            "global": parts.verdict("true system, global", model, everywhere),
            "regional": parts.verdict("true system, regional", model, region),
        },
        "equilibria": [point.x.tolist() for point in ps.find_operating_point(model)],
    }


def _tables(found: Found) -> tuple[Table, ...]:
    names = found.names

    def rows(show: Callable[[Tried], str]) -> tuple[tuple[str, ...], ...]:
        return tuple((label, *(show(row[name]) for name in names)) for label, row in found.cells.items())

    errors = (("paper", *(PAPER[name] for name in names)), *rows(_errors))
    verdicts = (("paper", *(PAPER_VERDICTS[name] for name in names)), *rows(_verdict))
    ridge = tuple(
        (f"{r:g}", *(f"{_short(column[k]['on_data'])}, {_verdict(column[k])}" for column in found.path.values()))
        for k, r in enumerate(found.strengths)
    )
    true = tuple((scope, _words(v), v["reason"] or "") for scope, v in found.truth["verdicts"].items())
    return (
        Table("errors", "Free-run RMSE on the data / pooled R2 / mean R2 of the states", ("estimator", *names), errors),
        Table("starts", f"{len(NEAR)} near and {len(FAR)} far starts: RMSE against the true system, or blow-ups",
              ("estimator", *names), rows(_starts)),
        Table("verdicts", "Verdicts, each with its checked proof where there is one", ("estimator", *names), verdicts),
        Table("ridge", "The ridge path (weak form): free-run RMSE and verdict", ("ridge", *names), ridge),
        Table("truth", "The true system, without disturbance", ("scope", "verdict", "reason"), true),
    )  # fmt: skip


def _errors(cell: Tried) -> str:
    if "refused" in cell:
        return "no logarithm"
    score = cell["on_data"]
    return "blows up" if score["blow_ups"] else f"{number(score['rmse'])} / {score['r2']:.4f} / {score['r2_mean']:.3f}"


def _short(score: ScoreCell) -> str:
    return "blows up" if score["blow_ups"] else number(score["rmse"])


def _starts(cell: Tried) -> str:
    if "refused" in cell:
        return "—"
    return f"{_ensemble(cell['near'], len(NEAR))}; {_ensemble(cell['far'], len(FAR))}"


def _ensemble(score: ScoreCell, count: int) -> str:
    return f"{score['blow_ups']} of {count} blow up" if score["blow_ups"] else number(score["rmse"], 3)


def _verdict(cell: Tried) -> str:
    return "—" if "refused" in cell else _words(cell["verdict"])


def _words(verdict: VerdictCell) -> str:
    """Return a verdict as words: its claim, or why there is none."""
    if verdict["verdict"] != "certified":
        return f"{verdict['verdict']} ({str(verdict['why']).lower().replace('_', ' ').replace('-', ' ')})"
    return _kind(verdict) + (f", gain {verdict['gain']:.3g}" if verdict["gain"] else "")


def _kind(verdict: VerdictCell) -> str:
    return str(verdict["verdict"] + (" regionally" if verdict["scope"] == "regional" else ""))


def _figures(found: Found) -> Figures:
    """Return every number and verdict by name."""
    figures: Figures = {}
    for label, row in found.cells.items():
        for name, tried in row.items():
            figures |= _cell_figures(f"{label}, {name}", tried)
    for name, column in found.path.items():
        for r, cell in zip(found.strengths, column, strict=True):
            figures |= _cell_figures(f"{_ridge(r)}, {name}", cell)
    return figures | {f"true system, {scope}": _kind(v) for scope, v in found.truth["verdicts"].items()}


def _cell_figures(label: str, cell: Tried) -> Figures:
    if "refused" in cell:
        return {f"{label}: verdict": "refused"}
    score = cell["on_data"]
    return {
        f"{label}: RMSE": None if score["blow_ups"] else score["rmse"],
        f"{label}: blow-ups from far": cell["far"]["blow_ups"],
        f"{label}: verdict": _kind(cell["verdict"]),
    }


def _drawings(found: Found) -> tuple[Drawing, ...]:
    return (
        Drawing(
            "figure-1", _trajectories(found.cells[DEFAULT]),
            "True and identified trajectories over time in the plane of the states, one panel a disturbance",
            "The paper's Figure 1: true trajectories (blue, solid) and those of the model identified by default (red, "
            "dashed) in (x1, x2, t).",
        ),
        Drawing(
            "figure-1-paper-method", _trajectories(found.cells[COORDINATES]),
            "True and identified trajectories over time in the plane of the states, one panel a disturbance",
            "The same by the paper's method, EDMD and the matrix logarithm; a run that blows up is cut off.",
        ),
        Drawing(
            "ridge-path", _ridge_path(found.strengths, found.path),
            "Free-run error against the strength of the ridge, with the verdict at each strength",
            "Error and verdict against the strength of the ridge. Whether d1 to d3 are certified and d4 is not is a "
            "matter of the strength, not of the system.",
        ),
    )  # fmt: skip


def _trajectories(row: Mapping[str, Tried]) -> Figure:
    figure = Figure(figsize=(9, 4.2 * -(-len(row) // 2)), layout="constrained")
    runs = {name: np.array(cell["run"]) for name, cell in row.items() if "refused" not in cell}
    for k, (name, found) in enumerate(runs.items()):
        ax: Any = figure.add_subplot(-(-len(row) // 2), 2, k + 1, projection="3d")
        true = disturbed(name)[0].x
        centre, width = (true.min(axis=0) + true.max(axis=0)) / 2, true.max(axis=0) - true.min(axis=0)
        near = (np.abs(found - centre) < 1.5 * width).all(axis=1)
        last = len(found) if near.all() else int(np.argmin(near))
        ax.plot(true[::2, 0], true[::2, 1], T[::2], color=plots.MEASURED, lw=1.3, label="true")
        ax.plot(
            found[:last:2, 0], found[:last:2, 1], T[:last:2], color=plots.MODEL, lw=1.3, ls="--", label="identified"
        )
        ax.set_box_aspect(None, zoom=0.86)
        ax.set(xlabel="x1", ylabel="x2", zlabel="t in s", title=name)
        ax.legend(frameon=False, fontsize="small")
    return figure


MARKS: dict[str, tuple[str, Literal["full", "bottom", "none"]]] = {
    "certified": ("o", "full"),
    "certified regionally": ("o", "bottom"),
    "undecided": ("o", "none"),
    "refuted": ("X", "full"),
}


def _ridge_path(strengths: Sequence[float], path: Mapping[str, Sequence[Cell]]) -> Figure:
    figure = Figure(figsize=(7.5, 4.4), layout="constrained")
    ax = figure.add_subplot()
    colors = dict(zip(DISTURBANCES, (plots.MEASURED, plots.LEVEL, plots.FORM, plots.MODEL), strict=True))
    scores = {name: [cell["on_data"] for cell in column] for name, column in path.items()}
    top = 3 * max(score["rmse"] for column in scores.values() for score in column if not score["blow_ups"])
    for name, column in path.items():
        heights = [top if score["blow_ups"] else score["rmse"] for score in scores[name]]
        ax.loglog(strengths, heights, color=colors[name], lw=1.2, label=name)
        for r, height, cell in zip(strengths, heights, column, strict=True):
            marker, fill = MARKS[_kind(cell["verdict"])]
            ax.plot(r, height, marker=marker, fillstyle=fill, ms=7, color=colors[name], ls="none")
    ax.axhline(top, color=plots.FIELD, lw=0.8, ls=":")
    ax.annotate("blows up", (strengths[-1], top), ha="right", va="bottom", color=plots.FIELD)
    ax.set(xlabel="ridge (relative to scaled columns)", ylabel="free-run RMSE")
    _key(ax)
    return figure


def _key(ax: Axes) -> None:
    """Explain the colours, then the marks."""
    lines, labels = ax.get_legend_handles_labels()
    marks = [
        Line2D([], [], marker=marker, fillstyle=fill, color="#000000", ls="none", label=word)
        for word, (marker, fill) in MARKS.items()
    ]
    ax.legend(handles=[*lines, *marks], labels=[*labels, *MARKS], frameon=False, ncols=2, fontsize="small")


REMARKS = (
    "The true system is not input-to-state stable about any point: without input it has several equilibria, and two of "
    "them, proved, refute it. A global certificate of a model of it is a statement about the model. About its "
    "equilibrium (2.922, 1.493) the true system is certified regionally.",
    "By the paper's own method, EDMD and the logarithm, no model is certified under any disturbance: each has several "
    "equilibria and is refuted. The paper's pattern, d1 to d3 verified and d4 not, is a property of the estimator's "
    "regularisation: see the ridge path.",
    "The paper's R2 is pooled over both states about one mean; the mean of the R2 of the states is lower.",
    "The paper does not say how its initial states, its disturbances between samples and its ridge were chosen; its "
    "errors are matched in size, not in digits.",
)
