"""Diagnosis on the command line: what the usual remedies give, each as the command to type."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from persid._files import Json
from persid.commands.words import as_given

if TYPE_CHECKING:
    from persid.identification.advice import Advice, Diagnosis

COMMANDS = ("run", "identify", "bootstrap")


def advice_rows(diagnosis: "Diagnosis") -> list[tuple[str, str]]:
    """Return rows: what to try, the best first, and what the measurements tell."""
    from persid.identification.advice import said

    told = (*diagnosis.remedies, *diagnosis.findings)
    rows = [("try" if one.options else "see", said(one, typed(one.options))) for one in told]
    if rows and diagnosis.r2 is not None:
        rows[0] = (rows[0][0], f"{rows[0][1]}\n(now R2 {diagnosis.r2:.4f} over {diagnosis.ahead})")
    return rows


def advice_facts(diagnosis: "Diagnosis") -> Json:
    """Return a diagnosis as one object for programs, with the commands to type."""
    content = {name: getattr(diagnosis, name) for name in ("r2", "error", "ahead", "tried")}
    for group in ("remedies", "findings"):
        content[group] = [
            asdict(one) | {"options": dict(one.options), "command": typed(one.options)}
            for one in getattr(diagnosis, group)
        ]
    return {"diagnosis": content}


def after(diagnosis: "Diagnosis", delay: Mapping[str, float]) -> "Diagnosis":
    """Return a diagnosis of data whose inputs were delayed already: what is advised is the whole dead time."""
    if not delay:
        return diagnosis
    return replace(diagnosis, remedies=tuple(_after(one, delay) for one in diagnosis.remedies))


def _after(one: "Advice", delay: Mapping[str, float]) -> "Advice":
    if one.kind != "dead-time":
        return one
    more = {name: float(seconds) for name, _, seconds in (p.rpartition("=") for p in one.options[0][1].split(","))}
    names = list(dict.fromkeys([*delay, *more]))
    words = ",".join(f"{name}={delay.get(name, 0.0) + more.get(name, 0.0):.6g}" for name in names)
    return replace(one, options=(("--delay", words),))


def typed(options: Sequence[tuple[str, str]], words: Sequence[str] | None = None) -> str:
    """Return the command that was typed with other options; the options alone where none was."""
    given = list(as_given() if words is None else words)
    if not options:
        return ""
    if not given or given[0] not in COMMANDS:
        return shlex.join(part for pair in options for part in pair)
    replaced = {name for name, _ in options}
    if "--outputs" in replaced:
        given[0] = "run"
        replaced |= {"--states", "--functions", "--method", "--derivatives", "--delays"}
    if "--na" in replaced:
        replaced |= {"--missing"}
    kept = _without(given, replaced)
    return "persid " + shlex.join([*kept, *(part for pair in options for part in pair)])


def _without(words: Sequence[str], names: set[str]) -> list[str]:
    """Return words without some options and their values."""
    kept, skip = [], False
    for word, after in zip(words, [*words[1:], ""], strict=True):
        if skip:
            skip = False
        elif word in names:
            skip = not after.startswith("--")
        elif word.partition("=")[0] not in names:
            kept.append(word)
    return kept
