"""The paper's study of basis functions: four combinations on a heat equation, in sample and split. Paper: Sec. 5.3.

    x_t = x_yy + B u + f + d on [0, pi] x [0, 2], Dirichlet, 300 points and 300 samples, x(y, 0) = sin y - 0.7,
    f = sin(w t) sin z + 0.5 cos(2 w t) cos 2z with w = pi/2, and d = 0.1 (sin t cos 2t, cos t sin 2t) on the two halves

The paper leaves open whether z is the state or the place y, and prints a spatial step of 1 where the interval
has pi/299; all four readings are shown. "In sample" is a free run over the data of the fit, "split" a free run over the
last 30 % of the time by a fit to the first 70 %.
"""

from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import TypedDict

import numpy as np
from matplotlib.figure import Figure
from numpy import ndarray

import persid as ps
from persid import plots
from persid.identification.free_runs import free_run_score
from persid.models.integration import lsoda_steps, passed
from persid.reports.figures import Drawing
from persid.reports.record import versions
from persid.studies.cells import ScoreCell, errors
from persid.studies.parts import Parts
from persid.studies.tables import Figures, Study, Table, number, protocol

REVISION = 2  # raised with every change of what is computed: parts of other revisions are not reused

END, OMEGA = 2.0, np.pi / 2
RIDGE = 1e-2  # the paper gives none; this one reproduces the order of its errors
SHARE = 0.7  # of the time, for the fit of a split
COMBINATIONS = {
    "1": ["sinh(x)", "tanh(x)"],
    "2": ["sinh(x)", "tanh(x)", "x"],
    "3": ["sinh(x)", "tanh(x)", "x", "x**3"],
    "4": ["sinh(x)", "x", "x**3", "x**5"],  # and the constant 1
}
PAPER = {"1": 0.0086, "2": 0.0067, "3": 0.0043, "4": 0.0021}
READINGS = ("state", "place")
STEPS = ("1", "pi/299")  # of space: as printed, and of the interval


class Cell(TypedDict):
    """What one combination does on one reading: errors by kind of score, the rank of the states, the unknowns."""

    scores: dict[str, ScoreCell]
    rank: int
    columns: int


Cells = Mapping[tuple[str, str], Mapping[str, Cell]]  # by reading and step, then by combination


def run(parts: Parts, quick: bool = False, seeds: int | None = None) -> Study:
    """Run the study. With `quick`: 60 points and samples, the printed step, f of the state; `seeds` is not used."""
    size = 60 if quick else 300
    cases = [(r, s) for r in READINGS[: 1 if quick else 2] for s in STEPS[: 1 if quick else 2]]
    parts = parts.of(len(cases) * len(COMBINATIONS))
    cells = {case: {name: _cell(parts, name, *case, size) for name in COMBINATIONS} for case in cases}
    return Study(
        name="bases",
        title="Bases: four combinations of functions",
        protocol=protocol(__doc__),
        tables=_tables(cells),
        drawings=(_drawing(cells),),
        figures=_figures(cells),
        remarks=REMARKS,
        seconds=parts.total,
        quick=quick,
        versions=versions(),
    )


@cache
def heat(reading: str, step: str, size: int) -> ps.Trajectories:
    """Return the one run of the heat equation at `size` points and samples."""
    y, t = np.linspace(0, np.pi, size), np.linspace(0, END, size)
    dx = 1.0 if step == "1" else np.pi / (size - 1)
    middle = (np.abs(y - np.pi / 2) <= np.pi / 10).astype(float)
    left = y < np.pi / 2

    def rate(s: float, x: ndarray) -> ndarray:
        padded = np.concatenate([[0.0], x, [0.0]])
        z = x if reading == "state" else y
        f = np.sin(OMEGA * s) * np.sin(z) + 0.5 * np.cos(2 * OMEGA * s) * np.cos(2 * z)
        d = 0.1 * np.where(left, np.sin(s) * np.cos(2 * s), np.cos(s) * np.sin(2 * s))
        return np.asarray(np.diff(padded, 2) / dx**2 + middle * signal(s) + f + d)

    states = [np.sin(y)[None] - 0.7]
    for solver in lsoda_steps(rate, states[0][0], (0.0, END), rtol=1e-8, atol=1e-10, band=1):
        states.append(passed(solver, t, sum(map(len, states))))
    return ps.Trajectories.from_arrays(np.concatenate(states), signal(t), t=t)


def signal(t: float | ndarray) -> ndarray:
    """Return the input u(t)."""
    return np.asarray(np.sin(t) + 0.5 * np.cos(2 * t))


def _cell(parts: Parts, combination: str, reading: str, step: str, size: int) -> Cell:
    """Return the scores of one combination on one reading of the paper."""
    parameters = {"functions": COMBINATIONS[combination], "ridge": RIDGE, "share": SHARE, "size": size}
    name = f"combination {combination}, f of the {reading}, step {step.replace('/', ' over ')}"
    return parts.part(name, parameters, partial(_compute, combination, reading, step, size))


def _compute(combination: str, reading: str, step: str, size: int) -> Cell:
    data = heat(reading, step, size)
    cut = round(SHARE * size)
    whole, split = _fit(combination, data), _fit(combination, _part(data, slice(0, cut)))
    return {
        "scores": {
            "in sample": errors(free_run_score(whole.model_, data, "paper")),
            "split": errors(free_run_score(split.model_, _part(data, slice(cut - 1, size)), "paper")),
        },
        "rank": int(np.linalg.matrix_rank(data[0].x, tol=1e-6 * np.linalg.norm(data[0].x, 2))),
        "columns": size * len(COMBINATIONS[combination]) + 1 + (combination == "4"),
    }


def _part(data: ps.Trajectories, rows: slice) -> ps.Trajectories:
    return ps.Trajectories((data[0][rows],), data.states, data.inputs)


def _fit(combination: str, data: ps.Trajectories) -> ps.PersidskiiIdentifier:
    return ps.PersidskiiIdentifier(
        COMBINATIONS[combination],
        ridge=RIDGE,
        window=2,
        x_ref=0.0,
        scale=1.0,
        hold="paper",
        constant=combination == "4",
        holdout=0.0,
        allow_underdetermined=True,
    ).fit(data)


def _tables(cells: Cells) -> tuple[Table, ...]:
    columns = ("combination", "paper", *(f"f of the {r}, step {s}" for r, s in cells))
    tables = [
        Table(
            kind.replace(" ", "-"),
            f"Free-run RMSE, {kind}",
            columns,
            tuple(
                (name, number(PAPER[name]), *(_error(column[name]["scores"][kind]) for column in cells.values()))
                for name in COMBINATIONS
            ),
        )
        for kind in ("in sample", "split")
    ]
    ranks = tuple(
        (name, *(f"{column[name]['rank']} of {column[name]['columns']}" for column in cells.values()))
        for name in COMBINATIONS
    )
    facts = "Rank of the states in the data (to a relative 1e-6), and the unknowns of each equation"
    return (*tables, Table("rank", facts, (columns[0], *columns[2:]), ranks))


def _error(score: ScoreCell) -> str:
    return "blows up" if score["blow_ups"] else number(score["rmse"])


def _figures(cells: Cells) -> Figures:
    found: Figures = {}
    for (reading, step), column in cells.items():
        for name, cell in column.items():
            for kind in ("in sample", "split"):
                score = cell["scores"][kind]
                label = f"combination {name}, f of the {reading}, step {step}, {kind}: RMSE"
                found[label] = None if score["blow_ups"] else score["rmse"]
    return found


def _drawing(cells: Cells) -> Drawing:
    figure = Figure(figsize=(9, 3.4 * -(-len(cells) // 2)), layout="constrained")
    for k, ((reading, step), column) in enumerate(cells.items()):
        ax = figure.add_subplot(-(-len(cells) // 2), min(2, len(cells)), k + 1)
        names = list(COMBINATIONS)
        ax.semilogy(names, [PAPER[name] for name in names], color=plots.FIELD, marker="s", ls=":", label="paper")
        for kind, color in (("in sample", plots.MEASURED), ("split", plots.MODEL)):
            ax.semilogy(names, _errors(column, kind), color=color, marker="o", label=f"ours, {kind}")
        ax.set(xlabel="combination", ylabel="free-run RMSE", title=f"f of the {reading}, step {step}")
        ax.legend(frameon=False, fontsize="small")
    return Drawing(
        "combinations",
        figure,
        "Free-run error of four combinations of basis functions, in sample and split, beside the paper's",
        "More functions fit the data of the fit better; on the part of the run that the fit has not seen the order is "
        "another.",
    )


def _errors(column: Mapping[str, Cell], kind: str) -> Sequence[float]:
    scores = [column[name]["scores"][kind] for name in COMBINATIONS]
    return [np.nan if score["blow_ups"] else score["rmse"] for score in scores]


REMARKS = (
    "The paper does not say whether its errors are in sample. With the printed step of 1 their order, and their size "
    "within a factor of nine, reproduce in sample in both readings of f.",
    "On the last 30 % of the run, which the fit has not seen, errors are ten to two hundred times larger. With f of "
    "the state the order is gone and combination 4 is the worst; with f of the place, where f does not depend on the "
    "state, the order stays.",
    "With the step pi/299 of the interval nothing reproduces: the data are those of a stiff system, and with f of the "
    "state the models of combinations 1 and 2 blow up in sample.",
    "One run lies, to six digits, in a space of 8 to 15 dimensions against 601 to 1202 unknowns in an equation: many "
    "models fit it exactly, and the ridge chooses among them. EDMD has no unique Koopman matrix here, so the models "
    "are fitted by the weak form with a ridge of 0.01.",
    "Combination 4 holds the constant 1, which is no sector function, and the paper calls x cubed a quadratic term.",
    "The paper speaks of the traffic model; the equations are those of its second experiment. Its disturbance has two "
    "components for 300 states; here each acts on one half.",
)
