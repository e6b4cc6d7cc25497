"""Draw docs/images/benchmarks/*.svg from benchmarks/results/*.json; nothing is measured here.

python benchmarks/pictures.py
"""

import json
from collections.abc import Callable
from typing import Any

import matplotlib as mpl

mpl.use("svg")
import matplotlib.pyplot as plt
import numpy as np
from children import PICTURES, RESULTS
from matplotlib.axes import Axes
from matplotlib.figure import Figure

BLUE, RED, GREY, GREEN = "#1b6ca8", "#b04a3a", "#6b6b6b", "#3c8d5a"
STYLE = {
    "font.size": 9,
    "svg.hashsalt": "persid",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}


def growth(content: dict[str, Any]) -> Figure:
    """Draw time and memory against size, with the floors."""
    names = [entry["varied"] for entry in content["exponents"]]
    orders = {entry["varied"]: entry["time"] for entry in content["exponents"]}
    figure, axes = plt.subplots(2, len(names), figsize=(14, 5.6), sharex="col")
    lines = {
        "seconds": ("measured", BLUE, "o-"),
        "function_floor": ("floor: the functions by NumPy", RED, "-."),
        "gram_floor": ("floor: Gram at the rate of BLAS", RED, "--"),
        "read_floor": ("floor: reading the data", GREY, ":"),
        "bandwidth_floor": ("floor: memory bandwidth", GREY, ":"),
    }
    for k, name in enumerate(names):
        rows = [row for row in content["rows"] if row["varied"] == name]
        size = np.array([row["size"] for row in rows], float)
        for key, (label, colour, style) in lines.items():
            if key in rows[0]:
                axes[0, k].loglog(size, [row[key] for row in rows], style, color=colour, label=label, markersize=4)
        axes[1, k].loglog(size, [row["memory_MB"] for row in rows], "o-", color=BLUE, markersize=4)
        axes[1, k].set_ylim(0.5, 500)
        axes[0, k].set_ylim(1e-5, 10)
        axes[0, k].set_title(f"{name}: time ∝ size$^{{{orders[name]:.2f}}}$")
        axes[1, k].set_xlabel("states of the ring" if name == "sparse product" else name)
    axes[0, 0].set_ylabel("processor time, s")
    axes[1, 0].set_ylabel("new memory, MB")
    handles = {
        label: line for k in (0, -1) for line, label in zip(*axes[0, k].get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=5)
    return figure


def peers_identification(content: dict[str, Any]) -> Figure:
    """Draw four figures of merit of every tool at the largest number of samples, one run and 1,000."""
    rows = content["rows"]
    most = max(row["samples"] for row in rows)
    sizes, tools = sorted({row["n"] for row in rows}), list(dict.fromkeys(row["tool"] for row in rows))
    titles = {
        "seconds": "processor time, s",
        "memory_MB": "new memory, MB",
        "coefficient_error": "error of coefficients",
        "free_run_error": "error of free runs",
    }
    figure, axes = plt.subplots(len(sizes), 4, figsize=(12, 2.4 * len(sizes) + 0.4), sharey=True, squeeze=False)
    for i, n in enumerate(sizes):
        for k, (key, title) in enumerate(titles.items()):
            for runs, colour, marker in ((1, GREY, "s"), (1000, BLUE, "o")):
                part = [
                    r for r in rows if (r["n"], r["samples"], r["runs"]) == (n, most, runs) and r.get(key) is not None
                ]
                places = [tools.index(r["tool"]) for r in part]
                axes[i, k].plot(
                    [r[key] for r in part], places, marker, color=colour, label=f"{runs:,} run{'s' * (runs > 1)}"
                )
            axes[i, k].set(xscale="log", title=f"n = {n}: {title}")
            axes[i, k].grid(axis="both", color="#e4e4e4", linewidth=0.6)
            axes[i, k].xaxis.set_minor_formatter("")
            _whole_decades(axes[i, k])
        axes[i, 0].set_yticks(range(len(tools)), tools)
    axes[0, 0].invert_yaxis()
    figure.suptitle(f"{most:,} samples with 1 % of noise; a missing mark: no such figure, or no model", fontsize=9)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _whole_decades(axes: Axes) -> None:
    """Widen a logarithmic axis to powers of ten, so that at least two numbers stand at it."""
    low, high = np.log10(axes.get_xlim())
    axes.set_xlim(10 ** np.floor(low), 10 ** np.ceil(high))


def admits_failure(content: dict[str, Any]) -> Figure:
    """Draw the share of models called stable: of those that are not, and of the control."""
    totals = content["totals"]
    figure, axes = plt.subplots(figsize=(9, 0.45 * len(totals) + 1.2))
    places = np.arange(len(totals))
    for shift, key, of, colour, label in (
        (-0.19, "not_ISS_called_stable", "of", RED, "models that are NOT input-to-state stable: wrong"),
        (0.19, "ISS_called_stable", "of_", BLUE, "models that are: right"),
    ):
        shares = [100 * row[key] / max(row[of], 1) for row in totals]
        bars = axes.barh(places + shift, shares, 0.36, color=colour, label=label)
        axes.bar_label(bars, [f"{row[key]} of {row[of]}" for row in totals], padding=3, fontsize=8)
    axes.set_yticks(places, [row["tool"] for row in totals])
    axes.invert_yaxis()
    axes.set(xlabel="called stable, %", xlim=(0, 118))
    axes.set_xticks(range(0, 101, 20))
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.4, -0.16), ncols=2)
    return figure


def peers_accuracy(content: dict[str, Any]) -> Figure:
    """Draw the errors of near and far runs as tables of shades, blow-ups in words."""
    rows = content["rows"]
    systems = list(dict.fromkeys(row["system"] for row in rows))
    figure, axes = plt.subplots(2, 2, figsize=(13, 6.2), sharex="col")
    for i, kind in enumerate(("same", "own")):
        part = [row for row in rows if row["functions"] == kind]
        tools = list(dict.fromkeys(row["tool"] for row in part))
        for k, place in enumerate(("near", "far")):
            found = {(row["tool"], row["system"]): row for row in part}
            _shades(axes[i, k], tools, systems, found, place)
            axes[i, k].set_title(f"{'the same functions' if kind == 'same' else 'own defaults'}, {place} starts")
    return figure


def _cell(row: dict[str, Any], place: str) -> tuple[float, str]:
    """Return the logarithm of an error (NaN: none) and the words for it."""
    if row["answer"] != "done":
        return np.nan, row["answer"]
    if not row[f"{place}_runs"]:
        return np.nan, "—"
    error, lost = row[f"{place}_error"], row[f"{place}_blow_ups"]
    words = [*([] if error is None else [f"{error:.2g}"]), *([f"{lost} blew up"] if lost else [])]
    return np.nan if error is None else np.log10(error), "\n".join(words)


def _shades(axes: Axes, tools: list[str], systems: list[str], found: dict[tuple[str, str], Any], place: str) -> None:
    values = np.full((len(tools), len(systems)), np.nan)
    for i, tool in enumerate(tools):
        for k, system in enumerate(systems):
            values[i, k], text = _cell(found.get((tool, system), {"answer": "not asked"}), place)
            axes.text(k, i, text, ha="center", va="center", fontsize=8)
    axes.imshow(values, cmap="RdYlGn_r", vmin=-3, vmax=1, aspect="auto", alpha=0.6)
    axes.set_xticks(range(len(systems)), systems)
    axes.set_yticks(range(len(tools)), tools)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def speed(content: dict[str, Any]) -> Figure:
    """Draw the time to decide one inequality against n: persid, libraries, what ran out, and the floor of flops."""
    runs = content["runs"]
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.8), sharey=True)
    colours = dict(zip(dict.fromkeys(run["solver"] for run in runs), (BLUE, RED, GREY, GREEN, "#7a5195"), strict=False))
    for place, (kind, title) in zip(axes, SPEED.items(), strict=True):
        for solver, colour in colours.items():
            part = [run for run in runs if (run["kind"], run["solver"]) == (kind, solver)]
            ended = [run for run in part if "seconds" in run]
            at = [run["n"] for run in ended]
            place.loglog(at, [run["seconds"] for run in ended], "o-", color=colour, label=solver, markersize=4)
            out = [run["n"] for run in part if "seconds" not in run]
            place.loglog(out, [content["seconds"]] * len(out), "x", color=colour)
        for solver, style in zip((name for name in colours if name.startswith("persid")), ("--", ":"), strict=False):
            own = [run for run in runs if (run["kind"], run["solver"]) == (kind, solver) and "seconds" in run]
            if not own:
                continue
            gflops = own[0].get("gflops", content["gflops"])
            floor = [
                run["iterations"] / run["rounds"] * (run["unknowns"] ** 3 + 2 * (4 * run["n"]) ** 3) / 3e9 / gflops
                for run in own
            ]
            label = f"floor: factorisations of one round of {solver} at {gflops:,.0f} Gflop/s"
            place.loglog([run["n"] for run in own], floor, style, color="black", linewidth=1, label=label)
        place.set(title=title, xlabel="states n", ylim=(1e-5, 400))
    axes[0].set_ylabel("processor time, s (one thread)")
    handles, names = axes[0].get_legend_handles_labels()
    crosses = plt.Line2D([], [], linestyle="none", marker="x", color="black", label="out of time or memory")
    notes = [crosses]
    if not any("cuda" in run["solver"] for run in runs):
        notes.append(plt.Line2D([], [], linestyle="none", label="GPU: to be measured (speed.py --device cuda)"))
    figure.legend(
        [*handles, *notes], [*names, *(note.get_label() for note in notes)], loc="outside lower center", ncols=3
    )
    return figure


SPEED = {"paper": "the paper's multipliers", "forms": "with forms of the functions"}


def public(content: dict[str, Any]) -> Figure:
    """Draw the errors of every seed on every public test, on one line, with the published ones."""
    tests = [(row["benchmark"], test) for row in content["published"] for test in row["errors"]]
    tests = list(dict.fromkeys(tests))
    figure, axes = plt.subplots(len(tests), 1, figsize=(8, 0.75 * len(tests) + 0.6))
    for ax, (name, test) in zip(axes, tests, strict=True):
        ours, theirs = ([row for row in content[key] if row["benchmark"] == name] for key in ("rows", "published"))
        for k, row in enumerate(theirs):
            ax.plot(row["errors"][test], 0, "|", color=GREY, markersize=14)
            lift = (10, -18)[k % 2]
            ax.annotate(
                row["model"], (row["errors"][test], 0), (0, lift), textcoords="offset points", ha="center", fontsize=7,
                color=GREY,
            )  # fmt: skip
        ax.plot([row["errors"][test] for row in ours], [0] * len(ours), "o", color=BLUE, alpha=0.6, markersize=6)
        ax.set_xscale("log")
        ax.set_ylim(-1, 1)
        ax.set_yticks([0], [f"{name}\n{test}, {ours[0]['unit']}"])
        ax.spines["left"].set_visible(False)
        ax.tick_params(axis="y", length=0)
        ax.tick_params(axis="x", which="both", labelsize=7)
        ax.xaxis.set_major_formatter("{x:g}")
        ax.xaxis.set_minor_formatter("{x:g}")
    axes[-1].set_xlabel(
        "root-mean-square error of a free run over the official test; dots: certified models, one a seed"
    )
    return figure


DRAWN: dict[str, Callable[[dict[str, Any]], Figure]] = {
    "growth": growth,
    "public": public,
    "speed": speed,
    "peers_identification": peers_identification,
    "admits_failure": admits_failure,
    "peers_accuracy": peers_accuracy,
}


def main() -> None:
    """Draw every picture whose results are there."""
    mpl.rcParams.update(STYLE)
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name, draw in DRAWN.items():
        path = RESULTS / f"{name}.json"
        if path.is_file():
            figure = draw(json.loads(path.read_text(encoding="utf-8")))
            figure.savefig(PICTURES / f"{name}.svg", metadata={"Date": None})
            print(PICTURES / f"{name}.svg")


if __name__ == "__main__":
    main()
