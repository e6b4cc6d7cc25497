"""Tables, drawings and figures of the power study."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from persid import plots
from persid.plots.style import tidy
from persid.reports.figures import Drawing
from persid.studies.grid import Grid
from persid.studies.nine_bus import CASE
from persid.studies.phasors import FRAMES, shown
from persid.studies.power_cells import Edges, Fault, Fit, Found, Load, Loads, Region, Step
from persid.studies.tables import Figures, Table, number

KINDS = {"steps": "new load steps", "rings": "after new short circuits"}


def tables(found: Found) -> tuple[Table, ...]:
    """Return all tables; those of load steps and of ten machines only where they were asked about."""
    kept = [
        Table("free-runs", "Free runs on records that no fit has seen: error of angles and of frequencies (rms)",
              ("model", *KINDS.values()), tuple(_run_rows(found.fits))),
        Table("clearing", "Short circuits: critical clearing time by simulation and by certificate, and the largest "
              "angle between two machines at these times", ("bus, certificate of", "simulated", "certified", "share",
              "angle, simulated", "angle, certified"), tuple(_fault_rows(found.regions))),
        Table("loads", "One load varies in whatever way: what the certificate admits, and the largest deviations in "
              "simulations in which it switches in time with the grid's own swings, with their proved bounds",
              ("load", "admitted", "angles: seen, proved", "frequencies: seen, proved"),
              tuple(_load_rows(found.loads))),
    ]  # fmt: skip
    if found.large:
        kept.append(
            Table("ten-machines", "Ten machines, 39 buses: free runs on records that no fit has seen (rms)",
                  ("model", *KINDS.values()), tuple(_run_rows(found.large)))
        )  # fmt: skip
    if found.steps:
        kept.append(
            Table("steps", "One step of a load: largest deviations from the new rest, seen and proved",
                  ("step", "verdict", "angles: seen, proved", "frequencies: seen, proved"),
                  tuple(_step_rows(found.steps)))
        )  # fmt: skip
    return tuple(kept)


def _run_rows(fits: Mapping[str, Fit]) -> Iterator[tuple[str, ...]]:
    first = next(iter(fits.values()))
    yield ("how far all goes from rest", *(_pair(first["runs"][kind]["size"]) for kind in KINDS))
    for label, fit in fits.items():
        errors = (fit["runs"][kind]["errors"] for kind in KINDS)
        yield (label, *("falls out of step" if pair is None else _pair(pair) for pair in errors))


def _pair(errors: Sequence[float]) -> str:
    return f"{errors[0]:.3f}°, {errors[1]:.1f} mHz"


def _fault_rows(regions: Mapping[str, Region]) -> Iterator[tuple[str, ...]]:
    for label, region in regions.items():
        for bus, fault in sorted(region["faults"].items()):
            angles = [number(angle, 0) + "°" for angle in fault["angles"]]
            times = [_milliseconds(seconds) for seconds in (fault["critical"], fault["certified"])]
            share = "—" if fault["certified"] is None else f"{fault['certified'] / fault['critical']:.0%}"
            yield (f"{bus}, {label}", *times, share, *angles)


def _milliseconds(seconds: float | None) -> str:
    return "—" if seconds is None else f"{1e3 * seconds:.0f} ms"


def _load_rows(found: Loads) -> Iterator[tuple[str, ...]]:
    for k, (load, each) in enumerate(found["loads"].items()):
        admitted = f"±{each['admitted']:.1f} MW ({each['admitted'] / CASE.nominal[k]:.0%})"
        yield (f"{load} ({CASE.nominal[k]:.0f} MW)", admitted, *_seen_and_proved(each["seen"], found["proved"]))


def _step_rows(steps: Mapping[str, Step]) -> Iterator[tuple[str, ...]]:
    for name, step in steps.items():
        proved = None if step["proved"] is None else step["proved"][0]
        yield (name, step["verdict"]["verdict"], *_seen_and_proved(step["seen"], proved))


def _seen_and_proved(seen: Sequence[float], proved: Sequence[float] | None) -> Iterator[str]:
    """Yield the largest of angles, seen and proved, then that of frequencies."""
    for part, unit, digits in ((slice(3), "°", 1), (slice(3, None), " Hz", 2)):
        yield ", ".join("—" if v is None else f"{max(v[part]):.{digits}f}{unit}" for v in (seen, proved))


def figures(found: Found) -> Figures:
    """Return every number and verdict by name."""
    figures: Figures = {}
    for label, fit in {**found.fits, **found.large}.items():
        for kind, words in KINDS.items():
            angle, frequency = fit["runs"][kind]["errors"] or (None, None)
            figures |= {f"{label}, {words}: degrees": angle, f"{label}, {words}: mHz": frequency}
    for label, region in found.regions.items():
        figures[f"{label}: verdict"] = region["verdict"]["verdict"]
        for bus, fault in region["faults"].items():
            figures |= _fault_figures(f"{label}, short circuit at bus {bus}", fault)
    figures["loads that vary: verdict"] = found.loads["verdict"]["verdict"]
    for load, each in found.loads["loads"].items():
        figures[f"load {load}: admitted, MW"] = each["admitted"]
        figures[f"load {load}: largest share of a proved bound"] = _share(each, found.loads["proved"])
    for name, step in found.steps.items():
        share = _share(step, step["proved"][0]) if step["proved"] else None
        figures |= {f"{name}: verdict": step["verdict"]["verdict"], f"{name}: largest share of a proved bound": share}
    return figures


def _fault_figures(name: str, fault: Fault) -> Figures:
    return {
        f"{name}: simulated, s": fault["critical"],
        f"{name}: certified, s": fault["certified"],
        f"{name}: keeps step when so cleared": "yes" if fault["keeps_step"] else "no",
    }


def _share(seen: Load | Step, proved: Sequence[float]) -> float:
    return float(np.max(np.array(seen["seen"]) / np.array(proved)))


def drawings(found: Found) -> tuple[Drawing, ...]:
    """Return all drawings that there is something for."""
    drawn, steps = [_free_runs(next(iter(found.fits.values())))], found.steps
    if found.edges is not None:
        drawn.append(_regions(next(iter(found.regions.values())), found.edges))
    if any(each["faults"] for each in found.regions.values()):
        drawn.append(_clearing_times(found.regions))
    name = max(steps, key=lambda step: float(max(steps[step]["seen"][:3])), default=None)
    if name is not None and steps[name]["proved"] is not None:
        drawn.append(_ways(name, steps[name]))
    return tuple(drawn)


def _free_runs(fit: Fit) -> Drawing:
    return Drawing(
        "free-run",
        _free_run(fit),
        "Angle and frequency of the grid and of the model's free run over a record of load steps",
        "Load steps that the fit has not seen: the grid (blue) and the free run of the identified model (red, dashed) "
        "from the first state and the load steps alone.",
    )


def _regions(region: Region, edges: Edges) -> Drawing:
    return Drawing(
        "region",
        _region(region, edges),
        "Region of angles that is certified, inside that from which simulations keep step",
        "Angles from which, with all frequencies at 60 Hz, the grid keeps step: certified (green) and in simulations "
        "(grey). Lines are the ways of the angles during short circuits (number: bus), up to the certified time "
        "(solid) and to the critical one (dotted); frequencies are not at 60 Hz on them.",
    )


def _clearing_times(regions: Mapping[str, Region]) -> Drawing:
    return Drawing(
        "clearing",
        _clearing(regions),
        "Bars of clearing times, certified and simulated, for each bus",
        "Clearing times: what the certificate admits, and what simulations of the grid admit.",
    )


def _ways(name: str, step: Step) -> Drawing:
    return Drawing(
        "step",
        _step(step),
        "Deviations after a load step, within the bounds that are proved",
        f"What follows a step ({name}), as the way from the model's new rest, and the bounds that are proved.",
    )


def _free_run(fit: Fit) -> Figure:
    figure = Figure(figsize=(8, 4.6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    true, run = (np.array(fit["runs"]["steps"][name]) for name in ("true", "run"))
    for ax, k, label in zip(axes, (0, 3), ("d21 in degrees", "f1 in Hz from 60"), strict=True):
        for curve, color, style, name in ((true, plots.MEASURED, "-", "grid"), (run, plots.MODEL, "--", "model")):
            ax.plot(2 * np.arange(len(curve)) / FRAMES, curve[:, k], color=color, ls=style, lw=1.2, label=name)
        ax.set_ylabel(label)
    axes[0].legend(frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    axes[1].set_xlabel("t in s")
    return _tidy(figure)


def _region(region: Region, edges: Edges) -> Figure:
    figure = Figure(figsize=(6.4, 5.4), layout="constrained")
    ax = figure.add_subplot()
    for angles, color, label in ((edges["simulated"], plots.FIELD, "keeps step in simulations"),
                                 (edges["proved"], plots.LEVEL, "certified")):  # fmt: skip
        edge = np.array(angles)
        ax.fill(edge[:, 0], edge[:, 1], facecolor=color, alpha=0.18, edgecolor=color, lw=1.6, label=label)
    for bus, fault in sorted(region["faults"].items()):
        path, steps = np.array(fault["path"]), round(1e3 * (fault["certified"] or 0.0))
        ax.plot(*path[: steps + 1].T, color=plots.INK, lw=1.4)
        ax.plot(*path[steps:].T, color=plots.INK, lw=0.9, ls=":")
        ax.annotate(bus, path[-1], fontsize="small", ha="left", va="bottom")
    ax.set(xlabel="d21 in degrees", ylabel="d31 in degrees")
    ax.legend(frameon=False, loc="upper left")
    return _tidy(figure)


def _clearing(regions: Mapping[str, Region]) -> Figure:
    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    ax = figure.add_subplot()
    rows = [(f"{bus}" if label == next(iter(regions)) else f"{bus},\n{label}", fault)
            for label, region in regions.items() if label != "equations known"
            for bus, fault in sorted(region["faults"].items())]  # fmt: skip
    simulated, certified = ([fault["critical"] for _, fault in rows], [fault["certified"] or 0.0 for _, fault in rows])
    for k, (times, color) in enumerate(((simulated, plots.FIELD), (certified, plots.LEVEL))):
        bars = ax.bar(np.arange(len(rows)) + 0.4 * k - 0.2, 1e3 * np.array(times), 0.38, color=color,
                      label=("simulated", "certified")[k])  # fmt: skip
        ax.bar_label(bars, fmt="%.0f", fontsize="small")
    ax.set_xticks(range(len(rows)), [label for label, _ in rows])
    ax.set(xlabel="bus of the short circuit", ylabel="clearing time in ms")
    ax.legend(frameon=False, ncols=2, loc="upper right")
    return _tidy(figure)


def _step(step: Step) -> Figure:
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    axes = figure.subplots(1, 2)
    away, proved = np.array(step["away"]), np.array(step["proved"])
    t = 6 * np.arange(len(away)) / FRAMES
    for ax, part, unit in zip(axes, (slice(3), slice(3, None)), ("degrees", "Hz"), strict=True):
        for k, color in zip(range(6)[part], (plots.MEASURED, plots.MODEL, plots.FORM), strict=True):
            ax.plot(t, away[:, k], color=color, lw=1.1, label=shown(Grid(CASE))[k])
        bound = proved[:, part].max(axis=1)
        for sign in (1, -1):
            ax.plot(t, sign * bound, color=plots.LEVEL, lw=1.8, label="bound" if sign > 0 else None)
        ax.set(xlabel="t in s", ylabel=f"from the new rest, in {unit}")
        ax.legend(frameon=False, fontsize="small", ncols=2, loc="upper right")
    return _tidy(figure)


def _tidy(figure: Figure) -> Figure:
    for ax in figure.axes:
        tidy(ax)
    return figure


REMARKS = (
    "Load steps of 25 % move the angles by a degree or so. They tell how the grid swings about its operating point and "
    "nothing of the sines beyond: the model that is identified from them alone foretells load steps and falls out of "
    "step after a short circuit. Three ring-downs of ten seconds mend that.",
    "A load step changes the admittances between the machines; the model knows a power in its place. That is the error "
    "that remains on load steps, for the identified model and for the known equations alike, and the grid may leave by "
    "it a bound that is proved for the model. All scores are against simulations with the changed admittances.",
    "Between the clearing times that are certified and those that are simulated lies a factor of about two. The "
    "certificate is of the model; that the grid keeps step when it is cleared in that time was simulated, not proved.",
    "The classical model knows no voltage regulators, governors, saliency or protection, loads are constant "
    "admittances, and every machine is damped in proportion to its inertia, so that nothing in the swings between "
    "machines reads the frequency of the whole grid.",
)
