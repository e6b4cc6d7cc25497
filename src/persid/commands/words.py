"""Words: what the library says of its arguments, said of the options of the command line."""

import re
from collections.abc import Mapping

import click

from persid._files import Json

OPTIONS = {
    name: "--" + name.replace("_", "-")
    for name in (
        "missing", "dt", "time", "gap", "na", "ridge", "functions", "method", "window", "scale", "x_ref", "pattern",
        "shared", "velocities", "delays", "derivatives", "allow_underdetermined", "hold", "constant", "refine",
        "operating_point", "u_op", "delay", "domain", "time_limit", "select", "engine", "scheduler", "gains", "order",
        "neurons", "instruments", "bound", "min_rate", "max_output_gain", "measured", "fixed", "stride",
        "one_curve",
    )
} | {"run": "--run-column", "output": "--output-map"}  # fmt: skip
ARGUMENT = re.compile(rf"""(?<![\w.])({"|".join(OPTIONS)})=("[^"]*"|'[^']*'|\[[^\]]*\]|\.\.\.|[-+\w]+(?:\.\w+)*|)""")
SAID = ("note", "warning", "but", "error", "verdict", "hint")
KEYS = ("notes", "warnings", "caution", "error", "reason")


def as_given() -> list[str]:
    """Return the words behind "persid" in the command that is running; none outside one."""
    context = click.get_current_context(silent=True)
    return [] if context is None else list(context.find_root().obj or [])


def spoken(text: str) -> str:
    """Return a sentence of the library as the command line says it: missing="drop" becomes --missing drop."""
    text = text.replace('scope="regional"', "--domain data")
    return ARGUMENT.sub(_option, text)


def _option(match: re.Match[str]) -> str:
    name, value = OPTIONS[match[1]], match[2].strip("\"'")
    if value.startswith("["):
        value = '"' + ",".join(re.findall(r"""["'](.*?)["']""", value)) + '"'
    if value in ("True", "False"):
        return name if value == "True" else name.replace("--", "--no-")
    return f"{name} {value}" if value else name


def spoken_object(content: Mapping[str, object]) -> Json:
    """Return what is printed as JSON with its sentences as the command line says them."""
    return {name: _entry(entry) if name in KEYS else entry for name, entry in content.items()}


def _entry(entry: object) -> object:
    if isinstance(entry, list | tuple):
        return [_entry(part) for part in entry]
    return spoken(entry) if isinstance(entry, str) else entry
