"""How a command ends: exit codes, errors in words, and the checks before and after the work that all commands share."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from errno import ENOSPC
from pathlib import Path
from typing import TYPE_CHECKING

import click

from persid._files import in_place
from persid._text import SECONDS, above, below, pace
from persid.errors import DataError, ModelError, PersidError

if TYPE_CHECKING:
    from persid.models.descriptor import DescriptorModel
    from persid.models.model import PersidskiiModel
    from persid.models.outputs import OutputModel
    from persid.verdicts.options import AskedAtRate
    from persid.verdicts.verdict import Certified, Verdict

DONE, REFUTED, WRONG, UNDECIDED, INTERNAL, REJECTED, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
EXIT_CODES = {
    DONE: "proved stable, or done",
    REFUTED: "proved not stable (or not well-posed, of equations), and nothing else",
    WRONG: "wrong use, bad input or a malformed file",
    UNDECIDED: 'undecided, or only "no certificate exists" is proved',
    INTERNAL: "internal error",
    REJECTED: "rejected: the proof in the file does not hold",
    INTERRUPTED: "interrupted",
}
TIME_UNIT = "persid.time_unit"  # where a command keeps the unit of time of what it prints
KEPT = "interrupted.json"  # the model of a run that was interrupted after its fit
EXIT = {"certified": DONE, "refuted": REFUTED, "undecided": UNDECIDED}


def explain(error: BaseException) -> tuple[int, str]:
    """Return exit code and message of an exception."""
    if isinstance(error, click.Abort | KeyboardInterrupt):
        hidden = error.__cause__ or error.__context__  # click raises its own over the interruption
        said = str(error) or str(hidden or "")
        return INTERRUPTED, said or "interrupted; nothing was written"
    if isinstance(error, click.ClickException):
        ctx = getattr(error, "ctx", None)
        hint = f"\n{ctx.get_usage()}\nTry: {ctx.command_path} --help" if ctx else ""
        return WRONG, error.format_message() + hint
    if isinstance(error, BrokenPipeError | SystemExit):  # click ends some broken pipes with 1, which means refuted here
        return INTERNAL, "the output was closed before everything was printed"
    if isinstance(error, PersidError):
        return WRONG, str(error)
    if isinstance(error, OSError):
        place = error.filename or ("standard output" if error.errno == ENOSPC else "")  # files name themselves
        where = f"{place}: " if place else ""
        return WRONG, f"{where}{error.strerror or error}; free the place or give another path"
    hint = "this is a fault of persid; run again with --debug and report what it prints"
    return INTERNAL, f"{type(error).__name__}: {error}; {hint}"


def refuse_unwritable(path: Path) -> None:
    """Refuse early what could not be written in the end."""
    if in_place(path):
        return
    existing = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.exists())
    if existing != path.absolute() and not existing.is_dir():
        raise DataError(f"{path} cannot be written: {existing} is a file; give another -o")
    if not os.access(existing, os.W_OK):
        raise DataError(f"{path} cannot be written: no permission at {existing}; give another -o")


@contextmanager
def kept(folder: Path) -> Iterator[Callable[["PersidskiiModel | OutputModel | DescriptorModel"], None]]:
    """Yield what takes a fit that is finished; where the work after it is interrupted, the newest one is written."""
    finished: list[PersidskiiModel | OutputModel | DescriptorModel] = []
    try:
        yield finished.append
    except KeyboardInterrupt:
        if not finished:
            raise
        folder.mkdir(parents=True, exist_ok=True)
        finished[-1].save(folder / KEPT)
        raise KeyboardInterrupt(
            f"interrupted; the fit was finished and is kept in {folder / KEPT}, which persid certify takes; "
            "nothing else was written"
        ) from None


def read_model(path: Path) -> "PersidskiiModel | OutputModel":
    """Read a model without algebraic variables."""
    from persid.models.descriptor import DescriptorModel

    model = read_any_model(path)
    if isinstance(model, DescriptorModel):
        raise ModelError(f"{path}: it has algebraic variables; persid certify, check and simulate take such a model")
    return model


def read_any_model(path: Path) -> "PersidskiiModel | OutputModel | DescriptorModel":
    """Read a model of any kind."""
    from persid.models.files import load_model

    try:
        return load_model(path)
    except (TypeError, AttributeError, LookupError, ValueError) as error:
        raise error if isinstance(error, PersidError) else ModelError(f"{path}: not a model: {error}") from None


def uninterrupted(verdict: "Verdict") -> "Verdict":
    """Turn a verdict that was cut short by Ctrl-C back into the interruption."""
    if getattr(getattr(verdict, "reason", None), "name", "") == "INTERRUPTED":
        raise KeyboardInterrupt
    return verdict


def question(
    operating_point: object, u_op: object, domain: str, time_limit: float | int, rate: float | None = None
) -> "AskedAtRate":
    """Return the arguments of `persid.verdicts.certify`."""
    point = "auto" if operating_point is None else operating_point
    return {"operating_point": point, "u_op": u_op, "domain": domain, "time_limit": time_limit, "rate": rate}


def attempt_rows(verdict: "Verdict") -> list[tuple[str, str]]:
    """Return every attempt at a verdict as an aligned table: what was tried, how it ended, the seconds."""
    from persid.verdicts import summary

    cells = [*summary.attempt_rows(verdict), ("in all", "", f"{verdict.seconds:.2f} s")]
    first, second, third = (max(len(row[k]) for row in cells) for k in range(3))
    lines = [f"{what:<{first}}  {outcome:<{second}}  {seconds:>{third}}" for what, outcome, seconds in cells]
    return [("attempts", "\n".join(lines))]


def named_gains(verdict: "Verdict") -> dict[str, float]:
    """Return the gain of each input of a certified model with a rate; none of another one."""
    from persid.verdicts.verdict import Certified

    certificate = verdict.certificate if isinstance(verdict, Certified) else None
    if certificate is None or certificate.gain is None or certificate.gains is None:
        return {}
    return dict(zip(certificate.model.inputs, certificate.gains.tolist(), strict=True))


def _rate(rate: float) -> str:
    """Return a proved rate, rounded down, in the unit of time that was asked for."""
    return f"{pace(rate, time_unit())} 1/{time_unit()}"


def time_unit() -> str:
    """Return the unit of time that was asked for."""
    ctx = click.get_current_context(silent=True)
    return "s" if ctx is None else str(ctx.meta.get(TIME_UNIT, "s"))


def _best(verdict: "Certified", asked: float | None) -> list[str]:
    """Return the best proved rate beside that of the certificate, and whether one that was asked for is beyond it."""
    rate, best = verdict.certificate.rate, verdict.best_rate
    if rate is None or best is None:
        return []
    if asked is not None and best < asked:
        return [f"a rate of {_rate(asked)} was asked for; the best proved rate is {_rate(best)}"]
    return [f"best proved rate {_rate(best)}, with a larger gain (--rate)"] if best > rate else []


def _holds_between(verdict: "Certified") -> bool:
    from persid.certificates.certificate import Certificate

    return isinstance(verdict.certificate, Certificate) and verdict.certificate.is_incremental


def _feedback(margins: dict[str, float | None]) -> list[str]:
    """Return how strong an unmodelled feedback from one output may be."""
    limits = ", or ".join(f"below {below(a)} from {name}" for name, a in margins.items() if a is not None)
    return [f"stays bounded under an unmodelled feedback of a gain {limits}"] * bool(limits)


def verdict_rows(verdict: "Verdict", asked: float | None = None) -> list[tuple[str, str]]:
    """Return the row of a verdict with its proved numbers; `asked` is the rate in 1/s that was asked for."""
    from persid.verdicts.summary import in_the_long_run, plants, summarize, unrated
    from persid.verdicts.verdict import Certified

    brief = summarize(verdict)
    if isinstance(verdict, Certified):
        proved = ", with proved rate and gain" if brief.rate is not None else ""
        kind = "practically" if brief.claim == "practical" else "input-to-state"
        text = f"certified: {kind} stable, {brief.scope}{proved}, {brief.seconds:.2g} s"
        bounds = [in_the_long_run(verdict)] if brief.claim == "practical" else []
        if brief.rate is not None and brief.gain is not None:
            bounds += [f"rate {_rate(brief.rate)}, gain {above(brief.gain)}"]
        elif brief.rate is not None and brief.output_gains is not None:
            gains = ", ".join(f"{name} {above(gain)}" for name, gain in brief.output_gains.items())
            bounds = [f"rate {_rate(brief.rate)}, gain of {gains}"]
        elif brief.rate is None:
            bounds = [f"no rate and gain: {unrated(verdict)}"]
        bounds += _best(verdict, asked)
        bounds += ["these hold between any two runs, too"] * _holds_between(verdict)
        bounds += _feedback(brief.feedback_margins or {})
        named = named_gains(verdict)
        if len(set(named.values())) > 1:
            bounds.append("gain of " + ", ".join(f"{name} {above(gain)}" for name, gain in named.items()))
        margin = verdict.margin
        near = [] if margin is None else [("plants", "\n".join(plants(margin, time_unit(), SECONDS[time_unit()])))]
        return [("verdict", "\n".join([text, *bounds])), *near]
    return [("verdict", f"{brief.verdict}: {brief.reason}")]
