"""The words of the command line: types of arguments, and the options that several commands share."""

import csv
import re
from collections.abc import Callable, Sequence
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from persid._text import SECONDS
from persid.commands.exit_codes import TIME_UNIT
from persid.identification.estimators import METHODS

if TYPE_CHECKING:
    ParamType = click.ParamType[Any]
else:
    ParamType = click.ParamType  # click 8.1 has no [...] here


Command = Callable[..., int | None]  # a function behind a command: takes its options by name, returns its exit code
Chosen = dict[str, Any]  # options by name, as click has read them: each has the type that its kind below returns

MISSING = ("error", "split", "drop", "interpolate")


class Names(ParamType):
    """Names separated by commas; a name that holds a comma stands in double quotes."""

    name = "names"

    def convert(
        self, value: str | Sequence[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> list[str]:
        """Split at commas."""
        names = next(csv.reader([value], skipinitialspace=True), []) if isinstance(value, str) else value
        if not all(str(name).strip() for name in names):
            self.fail(f"{value!r} holds an empty name; write names separated by commas, such as x1,x2", param, ctx)
        return [name.strip() for name in names]


class Entry(ParamType):
    """A coefficient by the names of a state and a column, and its number."""

    name = "state,column=number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Split at the comma and at the last equality sign."""
        pair, _, number = value.rpartition("=")
        names = [name.strip() for name in next(csv.reader([pair], skipinitialspace=True), [])]
        try:
            state, column = names
            return (state, column), float(number)
        except ValueError:
            self.fail(f"{value!r} is no coefficient; write state,column=number, such as x,v=1", param, ctx)


class Numbers(ParamType):
    """Numbers separated by commas."""

    name = "numbers"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> list[float]:
        """Split at commas and read each number."""
        try:
            return [float(part) for part in value.split(",")]
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers such as 1,3", param, ctx)


class Delays(ParamType):
    """Dead times of inputs, such as u=2.0 or "u=2 min, v=300 ms", separated by commas."""

    name = "name=time"

    def convert(
        self, value: str | dict[str, float], param: click.Parameter | None, ctx: click.Context | None
    ) -> dict[str, float]:
        """Return seconds by the name of the input."""
        if not isinstance(value, str):
            return value
        found = {}
        for part in next(csv.reader([value], skipinitialspace=True), []):
            match = re.fullmatch(r"(.+?)\s*=\s*([-+.\d]+(?:e[-+]?\d+)?)\s*([^\W\d]*)", part.strip())
            if match is None or (match[3] or "s") not in SECONDS:
                units = ", ".join(SECONDS)
                self.fail(f'{part.strip()!r} is no dead time such as u=2.0 or "u=300 ms" ({units})', param, ctx)
            found[match[1].strip()] = float(match[2]) * SECONDS[match[3] or "s"]
        return found


def split_outside(text: str, mark: str) -> list[str]:
    """Split a text at a mark that stands in no parentheses."""
    return re.split(rf"{mark}(?![^(]*\))", text)


class Functions(ParamType):
    """Expressions separated by commas; with semicolons, one such list for each state."""

    name = "list"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[str] | list[list[str]]:
        """Split at semicolons, then at commas, but not within parentheses: a table holds both."""
        lists = [[part.strip() for part in split_outside(one, ",")] for one in split_outside(value, ";")]
        if not all(part for one in lists for part in one):
            self.fail(f'{value!r} holds an empty expression; write, for example, "x,x**3,tanh(x)"', param, ctx)
        return lists if len(lists) > 1 else lists[0]


class Ridge(ParamType):
    """A number >= 0, or "auto"."""

    name = "number|auto"

    def convert(self, value: str | float, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        """Read the number."""
        try:
            return value if value == "auto" else float(value)
        except ValueError:
            self.fail(f'{value!r} is neither "auto" nor a number', param, ctx)


class Count(ParamType):
    """A whole number."""

    def __init__(self, name: str) -> None:
        self.name = name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read the number."""
        return click.INT.convert(value, param, ctx)


class Given(ParamType):
    """A value of another type, or "auto"."""

    def __init__(self, kind: ParamType) -> None:
        self.kind, self.name = kind, f"{kind.name}|auto"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> object:
        """Read the value."""
        return value if value == "auto" else self.kind.convert(value, param, ctx)


class Velocities(ParamType):
    """Pairs of a state and its derivative, "auto" or "none"."""

    name = "pairs|auto|none"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | dict[str, str] | None:
        """Split at commas and read each pair."""
        if value in ("auto", None):
            return value
        if value.lower() == "none":
            return None
        pairs = [[part.strip() for part in pair.split("=")] for pair in value.split(",")]
        if any(len(pair) != 2 or not all(pair) for pair in pairs):
            self.fail(f'{value!r} is no list of pairs such as "phi=omega"', param, ctx)
        return dict(pairs)


class Pattern(ParamType):
    """Rows of 0 and 1, separated by semicolons."""

    name = "rows"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> list[list[bool]]:
        """Split at semicolons, then at commas."""
        rows = [[part.strip() for part in row.split(",")] for row in value.split(";")]
        if any(len(row) != len(rows) for row in rows) or any(part not in ("0", "1") for row in rows for part in row):
            self.fail(f'{value!r} is no square pattern; write rows of 0 and 1, such as "1,0; 1,1"', param, ctx)
        return [[part == "1" for part in row] for row in rows]


class Auto(ParamType):
    """A whole number, or "auto"."""

    name = "integer|auto"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str | int:
        """Read the number."""
        try:
            return value if value == "auto" else int(value)
        except ValueError:
            self.fail(f'{value!r} is neither "auto" nor a whole number', param, ctx)


def together(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    return lambda command: reduce(lambda made, option: option(made), reversed(options), command)


SHELLS = ("bash", "zsh", "fish")
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
NEW_FILE = click.Path(dir_okay=False, path_type=Path)
NEW_FOLDER = click.Path(file_okay=False, path_type=Path)
MEASUREMENTS = click.argument(
    "data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DATA.csv..."
)  # files, folders, patterns in quotes

talking = together(
    click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout and nothing else."),
    click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors; the exit code tells the outcome."),
    click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error."),
)
states = click.option("--states", type=Names(), required=True, help="Columns of the states, such as x1,x2.")
inputs = click.option("--inputs", type=Names(), default=[], help="Columns of the inputs, such as u.")
COLUMN = (
    'Column of the time, dates or numbers; without it, one named like a time. "t [h]" says the unit where the column '
    "does not."
)
DISCRETE = "discrete"
time = click.option("--time", metavar="NAME", help=COLUMN)
times = click.option(
    "--time", metavar="NAME|discrete", multiple=True,
    help=COLUMN + " The word discrete, in its place or beside it in a second --time, asks for discrete time: the state "
    "one step later, straight from samples, without a logarithm.",
)  # fmt: skip
cells = together(
    click.option("--dt", type=float, help="Sampling step in s, where there is no column of time."),
    click.option("--gap", type=float, help="Step in s above which a new run starts; by default ten median steps."),
    click.option("--missing", type=click.Choice(MISSING), default="error", show_default=True,
                 help="Empty cells and NaN: an error; split: a run ends; drop: the row is left out (slow and fast "
                      "channels in one file); interpolate: states by straight lines, inputs held."),
    click.option("--na", type=Names(), default=[], help="Values that mean missing, too, such as -9999."),
    click.option("--delay", type=Delays(), default={}, metavar="NAME=TIME",
                 help='Dead time of an input, such as u=2.0 in s, or "u=2 min": u(t - 2) then stands beside x(t).'),
    click.option("--run-column", "run", metavar="NAME", help="Column that tells runs apart."),
)  # fmt: skip
columns = together(inputs, time, cells)
columns_of_fit = together(inputs, times, cells)
reading = together(states, columns_of_fit)
measuring = together(
    click.option("--states", type=Names(), help="Columns of the states, such as x1,x2."),
    click.option("--outputs", type=Names(), help="Columns of the outputs, where the state was not measured."),
    click.option("--algebraic", type=Names(),
                 help="With --states: columns of algebraic variables, without a derivative; --functions and --pattern "
                      "then count them behind the states."),
    columns_of_fit,
    click.option("--order", type=Auto(), help="With --outputs: number of states; by default it is chosen."),
    click.option("--neurons", type=Auto(), help="With --outputs: number of neurons; by default it is chosen."),
    click.option("--output-map", type=click.Choice(["abs"]), help="With --outputs: a sensor that ignores the sign."),
    click.option("--foh", "foh", is_flag=True, help="With --outputs: inputs run in straight lines between samples."),
    click.option("--min-rate", type=float, help="With --outputs: a rate in 1/s that is to be certified."),
    click.option("--warm-start", type=FILE,
                 help="With --outputs: the model.json of an earlier fit to go on from; nothing is searched."),
    click.option("--measured", type=Names(), help="With --outputs: those of them that are states themselves."),
    click.option("--fixed", type=Entry(), multiple=True,
                 help="With --measured: a known coefficient, such as x,v=1; column f: all neurons; may be repeated."),
    click.option("--max-output-gain", type=Numbers(),
                 help="With --outputs: the largest gain that is to be certified; one number, or one for each output."),
    click.option("--test", type=click.Path(path_type=Path), multiple=True,
                 help="A file that is kept from the fit and foretold by the delivered model; may be repeated."),
)  # fmt: skip
OUTPUT_OPTIONS = (
    "order",
    "neurons",
    "output_map",
    "foh",
    "min_rate",
    "max_output_gain",
    "measured",
    "fixed",
    "warm_start",
)


def output_options(how: Chosen) -> Chosen:
    """Take the options of a fit to inputs and outputs that were given out of all options."""
    found = {name: how.pop(name) for name in OUTPUT_OPTIONS}
    found["fixed"] = dict(found["fixed"] or ()) or None
    return {name: value for name, value in found.items() if value is not None and value is not False}


appending = together(
    click.option("--derivatives", type=click.IntRange(0, 1), is_flag=False, flag_value=1, default=0,
                 show_default=True, help="1 appends smoothed velocities to the states."),
    click.option("--delays", type=click.IntRange(min=0), default=0, show_default=True,
                 help="Append copies of the states delayed by 1 to so many samples."),
)  # fmt: skip
fitting = together(
    click.option("--functions", type=Functions(), default="x,x**3,sinh(x),tanh(x)", show_default=True,
                 help='Functions of the states; "f,g; h" gives one list a state; pwl is learned from the data. '
                      "With --outputs: what the neurons may be, tanh, softsign, arctan, pwl; by default tanh."),
    click.option("--ridge", type=Ridge(), default="auto", show_default=True,
                 help="Strength of the ridge on scaled columns; auto chooses it by validation. More ridge is easier "
                      "to certify and fits less well."),
    click.option("--method", type=click.Choice(METHODS), default="weak", show_default=True,
                 help="Integrals over windows; smoothed derivatives; or the Koopman matrix and its logarithm."),
    click.option("--stride", type=Given(Count("samples")), default="auto", show_default=True,
                 help="Samples of one step in discrete time; auto chooses by free runs."),
    click.option("--hold", type=click.Choice(["zoh", "paper"]), default="zoh", show_default=True,
                 help="Inputs are held from sample to sample, or vary between samples."),
    click.option("--instruments", is_flag=True,
                 help="Earlier windows stand in for the one that is fitted: unbiased where noise acts on the plant, "
                      "less precise where it does not."),
    appending,
    click.option("--window", type=Given(Count("even number")), default="auto", show_default=True,
                 help="Samples of a window of the weak form, even."),
    click.option("--x-ref", type=Given(Numbers()), default="auto", show_default=True,
                 help="Reference point of the functions' arguments."),
    click.option("--scale", type=Given(Numbers()), default="auto", show_default=True,
                 help="Scales of the functions' arguments, one a state."),
    click.option("--constant/--no-constant", default=True, show_default=True, help="Whether there is a constant term."),
    click.option("--pattern", type=Pattern(),
                 help='Which state may influence which: rows of 0 and 1, such as "1,0; 1,1".'),
    click.option("--velocities", type=Velocities(), default="auto", show_default=True,
                 help="States that are derivatives of others, whose equations are then known: phi=omega; auto: those "
                      "that --derivatives appends; none."),
    click.option("--shared", is_flag=True, help="One set of coefficients along a chain of equal nodes."),
    click.option("--one-curve", is_flag=True,
                 help='Learned functions ("pwl") are one curve, with a factor for each state in each equation.'),
    click.option("--allow-underdetermined", is_flag=True,
                 help="Take the smallest of many exact fits instead of refusing."),
)  # fmt: skip
FIT_OPTIONS = ("stride", "hold", "derivatives", "delays", "window", "x_ref", "scale", "constant", "pattern", "shared",
               "velocities", "one_curve", "allow_underdetermined", "instruments")  # fmt: skip


def fit_options(how: Chosen) -> Chosen:
    """Take the options of a fit that commands hand through out of all options; the column of the time stays there.

    Raises:
        click.UsageError: several columns were given.
    """
    names = [name for name in how["time"] if name != DISCRETE]
    if len(names) > 1:
        raise click.UsageError(f"--time names {len(names)} columns; give one, and the word discrete beside it or not")
    time = DISCRETE if DISCRETE in how["time"] else "continuous"
    how["time"] = names[0] if names else None
    return {"time": time, **{name: how.pop(name) for name in FIT_OPTIONS}}


refining = together(
    click.option("--refine", is_flag=True,
                 help="Continue from that fit by free runs over pieces of the data: slower, often closer."),
)  # fmt: skip
where = together(
    click.option("--engine", type=click.Choice(["memory", "chunks", "dask"]), default="memory", show_default=True,
                 help="All data in memory; chunk by chunk in this process; or chunk by chunk on Dask."),
    click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://10.0.0.1:8786; else threads."),
)  # fmt: skip
batching = together(
    click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True,
                 help="Models that are decided at the same time, each in a process of its own."),
    click.option("--engine", type=click.Choice(["processes", "dask"]), default="processes", show_default=True,
                 help="Where they are decided."),
    click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://10.0.0.1:8786."),
)  # fmt: skip


def _per_second(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    """Return a rate in 1/s that was given in the unit of time of the command."""
    return None if value is None else value / SECONDS[ctx.meta.get(TIME_UNIT, "s")]


proving = together(
    click.option("--operating-point", type=Numbers(),
                 help="State near the equilibrium that is meant; by default the one nearest to x_ref."),
    click.option("--u-op", type=Numbers(), help="Nominal constant input; by default u_ref."),
    click.option("--domain", type=click.Choice(["global", "auto", "data"]), default="global", show_default=True,
                 help="Ask for all states first, for the largest region found, or for one in the box of the data."),
    click.option("--time-limit", type=click.FloatRange(min=0), default=60.0, show_default=True,
                 help="Seconds for each verdict."),
    click.option("--rate", type=click.FloatRange(min=0, min_open=True), callback=_per_second,
                 help="A rate that the proof is to have at least, in 1/s or per --time-unit, with the smallest gain "
                      "that is found; by default about half of the best one that is proved."),
    click.option("--time-unit", type=click.Choice(list(SECONDS)), default="s", show_default=True, expose_value=False,
                 is_eager=True, callback=lambda ctx, param, value: ctx.meta.__setitem__(TIME_UNIT, value),
                 help="Unit of time of rates and of the axes of figures; model, proofs and --json stay in s."),
)  # fmt: skip
simulating = together(
    click.option("--x0", type=Numbers(), help="Initial state, such as 1,3."),
    click.option("--y-init", type=FILE, help="CSV with the first measured outputs, in place of --x0."),
    click.option("--input", "signals", multiple=True, metavar="EXPRESSION",
                 help='Input as a function of t in s, such as "0.5*sin(t)"; once for each input, in order.'),
    click.option("--inputs-csv", "table", type=FILE, help="Inputs from a file, each value held until the next."),
    click.option("--time", help="Column of the time in that file; without it, a column named t or time."),
    click.option("--t-end", type=float, help="Last time in s; with --inputs-csv, by default that of the file."),
    click.option("--dt", type=float, help="Step of the output in s; by default a thousandth of the time."),
)  # fmt: skip
resampling = together(
    click.option("--count", type=click.IntRange(min=1), default=200, show_default=True, help="Number of refits."),
    click.option("--seed", type=int, default=0, show_default=True, help="Seed of the draws."),
)
