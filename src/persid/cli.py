"""The command line: parse, call, print. No mathematics here."""

import os
import shlex
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from persid.errors import DataError, ModelError, PersidError
from persid.options import FILE, MEASUREMENTS, NEW_FILE, NEW_FOLDER, fitting, proving, reading, simulating, talking
from persid.studies.command import study
from persid.talk import Talk, complain

if TYPE_CHECKING:
    from persid.model import PersidskiiModel
    from persid.trajectories import Trajectories

DONE, REFUTED, WRONG, UNDECIDED, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 4, 130
EXIT_CODES = {
    DONE: "certified, accepted or done",
    REFUTED: "refuted or rejected, and nothing else",
    WRONG: "wrong use, bad input or a malformed file",
    UNDECIDED: "undecided",
    INTERNAL: "internal error",
    INTERRUPTED: "interrupted",
}
EXIT = {"certified": DONE, "refuted": REFUTED, "undecided": UNDECIDED}

THE_PATH = """\
persid goes from measurements to a checked proof of stability:
  1  persid run DATA.csv --states x1,x2 --inputs u -o OUT/    everything below in one go, with a report page
  2  persid identify DATA.csv --states x1,x2 -o model.json    measurements -> model
  3  persid certify model.json -o certificate.json            model -> verdict: certified, refuted or undecided
  4  persid check certificate.json                            the independent checker, exact; persid --help for more"""


@click.group(
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog=f"Exit codes: {'; '.join(f'{code} {meaning}' for code, meaning in EXIT_CODES.items())}.",
)
@click.option("--version", is_flag=True, is_eager=True, help="Print the version and exit.")
@click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
@click.pass_context
def persid(ctx: click.Context, version: bool) -> int:
    """From measurements of a nonlinear system to a model with a machine-checked proof of stability.

    \b
    Example:
      persid run examples/traffic.csv --states x1,x2 --inputs u -o out
    """
    if version:
        import persid as package

        click.echo(f"persid {package.__version__}")
        ctx.exit(DONE)
    if ctx.invoked_subcommand is None:
        click.echo(THE_PATH)
    return DONE


@persid.command()
@MEASUREMENTS
@reading
@fitting
@proving
@click.option("-o", "--output", type=NEW_FOLDER, required=True, help="Folder for the results.")
@talking
def run(
    data: tuple[Path, ...], functions: Any, ridge: Any, operating_point: Any, u_op: Any, domain: str, time_limit: float,
    output: Path, as_json: bool, quiet: bool, **how: Any,
) -> int:  # fmt: skip
    """Identify, certify and report: from measurements to a verdict in one go.

    Several files are several trajectories of one system. Where the free fit is not certified for all states, it is
    fitted again under the condition that a certificate exists, and both are reported side by side (not with --domain
    data, --operating-point or --u-op). The folder receives model.json, certificate.json (or witness.json, or
    obstruction.json: why undecided), report.html, figures/ and run.json; older results there are removed. The exit
    code is that of the verdict.

    \b
    Example:
      persid run examples/traffic.csv --states x1,x2 --inputs u -o out
    """
    from persid import folder
    from persid.certify import certify
    from persid.constrained import Delivery, deliver
    from persid.summary import comparison_rows, summarize

    talk = Talk(as_json, quiet)
    _writable(output)
    with talk.progress() as progress:
        progress("reading the measurements")
        measured = folder.read_measurements(data, **how)
        progress("identifying the model")
        fit = _identify(measured, functions, ridge)
        question = _question(operating_point, u_op, domain, time_limit)
        verdict = _uninterrupted(certify(fit.model_, progress=progress, **question))
        usual = domain == "global" and operating_point is None and u_op is None
        made = deliver(fit, verdict, measured, time_limit, progress) if usual else Delivery(fit.model_, verdict)
        verdict, facts = made.verdict, (made.verdict.attempts, folder.versions(), made.comparison)
        record = folder.Record(_command(), folder.sources(data), how, fit.report_, *facts)
        progress("drawing the report")
        proof = _deliver(output, folder.Results(made.model, verdict, measured, record))
    brief = summarize(verdict)
    paths = {"model": output / folder.MODEL, "report": output / folder.REPORT, _kind(proof): output / proof}
    files = {name: str(path) for name, path in paths.items()}
    rows = [*_data_rows(data, measured), *_fit_rows(fit.report_), *comparison_rows(made.comparison)]
    rows += [*_verdict_rows(verdict), *list(files.items())[1:]]
    talk.result(brief.to_dict() | {"fits": (made.comparison or {}).get("fits"), "files": files}, rows)
    return EXIT[brief.verdict]


@persid.command()
@MEASUREMENTS
@reading
@fitting
@click.option("-o", "--output", type=NEW_FILE, required=True, help="The model file to write.")
@talking
def identify(
    data: tuple[Path, ...], functions: Any, ridge: Any, output: Path, as_json: bool, quiet: bool, **how: Any
) -> int:
    """Identify a generalized Persidskii model from measurements.

    \b
    Example:
      persid identify examples/traffic.csv --states x1,x2 --inputs u -o model.json
    """
    from persid.equations import equations
    from persid.folder import read_measurements

    talk = Talk(as_json, quiet)
    _writable(output)
    with talk.progress() as progress:
        progress("reading the measurements")
        measured = read_measurements(data, **how)
        progress("identifying the model")
        fit = _identify(measured, functions, ridge)
    output.parent.mkdir(parents=True, exist_ok=True)
    fit.model_.save(output)
    text = equations(fit.model_)
    rows = [*_data_rows(data, measured), *_fit_rows(fit.report_), ("equations", text), ("model", str(output))]
    report = fit.report_
    scores = {"ridge": report.ridge, "condition": _number(report.condition_scaled)} | _scores(report)
    talk.result({"model": str(output), "sha256": fit.model_.sha256, "equations": text.splitlines()} | scores, rows)
    return DONE


@persid.command()
@click.argument("models", nargs=-1, required=True, type=FILE, metavar="MODEL.json...")
@click.option(
    "-o", "--output", type=NEW_FILE, required=True, help="The certificate to write; of several models, MODEL.NAME each."
)
@proving
@talking
def certify(
    models: tuple[Path, ...], output: Path, operating_point: Any, u_op: Any, domain: str, time_limit: float,
    as_json: bool, quiet: bool,
) -> int:  # fmt: skip
    """Decide whether models are input-to-state stable, and write the proofs.

    A file is written only when the checker has accepted it; a certificate of another model under that name is removed.
    The exit code is 1 if one of several models is refuted, else 3 if one stays undecided, else 0.

    \b
    Example:
      persid certify model.json -o certificate.json
    """
    from persid.certify import certify as decide
    from persid.summary import summarize

    talk = Talk(as_json, quiet)
    targets = _targets(models, output)
    question = _question(operating_point, u_op, domain, time_limit)
    subjects = [_load_model(path) for path in models]
    for target in targets:
        _writable(target)
    found, rows, codes = [], [], []
    with talk.progress() as progress:
        for path, model, target in zip(models, subjects, targets, strict=True):
            verdict = _uninterrupted(decide(model, progress=progress, **question))
            brief = summarize(verdict)
            written = _write_proof(verdict, model, target)
            found.append({"model": str(path), **brief.to_dict(), "file": written})
            rows += [("model", str(path)), *_verdict_rows(verdict), ("file", written or "none written")]
            codes.append(EXIT[brief.verdict])
    talk.result(found[0] if len(found) == 1 else {"models": found}, rows)
    return next((code for code in (REFUTED, UNDECIDED) if code in codes), DONE)


@persid.command()
@click.argument("certificate", type=FILE, metavar="CERTIFICATE.json")
@click.option("--model", type=FILE, help="model.json, which must be the model of the certificate.")
@click.option("--explain", is_flag=True, help="Print the steps of the proof.")
@talking
def check(certificate: Path, model: Path | None, explain: bool, as_json: bool, quiet: bool) -> int:
    """Check a certificate, exactly, from the file alone.

    This is the independent checker. The same without persid, with Python and python-flint only:
    python -m persid_check CERTIFICATE.json

    \b
    Example:
      persid check certificate.json --model model.json
    """
    import persid_check

    answer = persid_check.check(certificate, model, explain)
    name = type(answer).__name__.lower()
    if isinstance(answer, persid_check.Accepted):
        rows = [("verdict", f"{name}, claim {answer.claim}"), ("statement", answer.statement)]
        rows += [("steps", "\n".join(answer.steps))] if answer.steps else []
        content: dict[str, Any] = {"claim": answer.claim, "statement": answer.statement, "steps": list(answer.steps)}
    else:
        rows = [("verdict", name), ("where", answer.where), ("why", answer.why)]
        content = {"where": answer.where, "why": answer.why}
    Talk(as_json, quiet).result({"result": name, **content}, rows)
    return {"accepted": DONE, "rejected": REFUTED, "malformed": WRONG}[name]


@persid.command()
@click.argument("model", type=FILE, metavar="MODEL.json")
@simulating
@click.option("-o", "--output", type=NEW_FILE, required=True, help="The CSV file to write.")
@talking
def simulate(model: Path, x0: list[float], output: Path, as_json: bool, quiet: bool, **inputs: Any) -> int:
    """Simulate a model and write t, states and inputs as CSV.

    Without --input or --inputs-csv the inputs stay at u_ref. A run that diverges ends there, and this is said.

    \b
    Example:
      persid simulate model.json --x0 1,3 --input "sin(t)" --t-end 30 --dt 0.03 -o run.csv
    """
    from persid import signals as making

    talk = Talk(as_json, quiet)
    subject = _load_model(model)
    _writable(output)
    with talk.progress() as progress:
        t, u = making.times_and_inputs(subject, **inputs)
        progress("simulating")
        found = subject.simulate(x0, t, u)
    output.parent.mkdir(parents=True, exist_ok=True)
    making.write_csv(output, found)
    gone = found[0].diverged_at
    rows = [("samples", f"{found.samples}, t = {found[0].t[0]:g} ... {found[0].t[-1]:g} s")]
    rows += [("diverged", f"the state left all bounds at t = {gone:.6g} s; the run ends there")] if gone else []
    rows += [("run", str(output))]
    talk.result({"run": str(output), "samples": found.samples, "diverged_at": gone}, rows)
    return DONE


@persid.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="OUT")
@talking
def report(folder: Path, as_json: bool, quiet: bool) -> int:
    """Build the report page again from the files in OUT.

    The proof is checked again on the way. What needs the measurements is left out where they have changed.

    \b
    Example:
      persid report out
    """
    from persid.folder import FIGURES, REPORT, delivery, read_results
    from persid.report import write_report

    talk = Talk(as_json, quiet)
    with talk.progress() as progress:
        progress("reading the results")
        results = read_results(folder)
        progress("drawing the report")
        with delivery(folder, [REPORT, f"{FIGURES}/*.png"]) as stage:
            write_report(results, stage)
    talk.result({"report": str(folder / REPORT)}, [*_verdict_rows(results.verdict), ("report", str(folder / REPORT))])
    return DONE


persid.add_command(study)


def _question(operating_point: Any, u_op: Any, domain: str, time_limit: float) -> dict[str, Any]:
    """Return the arguments of `persid.certify`."""
    point = "auto" if operating_point is None else operating_point
    return {"operating_point": point, "u_op": u_op, "domain": domain, "time_limit": time_limit}


def _identify(measured: "Trajectories", functions: Any, ridge: Any) -> Any:
    from persid.identify import PersidskiiIdentifier

    return PersidskiiIdentifier(functions=functions, ridge=ridge).fit(measured)


def _deliver(output: Path, results: Any) -> str:
    """Write all files of a run, or none; return the name of the file that carries the verdict."""
    from persid import folder
    from persid.report import write_report

    stale = [folder.CERTIFICATE, folder.WITNESS, folder.OBSTRUCTION, folder.INFEASIBLE, f"{folder.FIGURES}/*.png"]
    with folder.delivery(output, stale) as stage:
        results.model.save(stage / folder.MODEL)
        proof = folder.write_verdict(stage, results.verdict, results.model)
        folder.write_record(stage, results.record)
        write_report(results, stage)
    return proof


def _uninterrupted(verdict: Any) -> Any:
    """Turn a verdict that was cut short by Ctrl-C back into the interruption."""
    if getattr(getattr(verdict, "reason", None), "name", "") == "INTERRUPTED":
        raise KeyboardInterrupt
    return verdict


def _targets(models: Sequence[Path], output: Path) -> list[Path]:
    """Return where the certificate of each model goes."""
    if len(models) == 1:
        return [output]
    names = [f"{path.stem}.{output.name}" for path in models]
    if len(set(names)) < len(names):
        raise click.UsageError("models of the same file name cannot share one -o; certify them one by one")
    return [output.with_name(name) for name in names]


def _write_proof(verdict: Any, model: "PersidskiiModel", target: Path) -> str | None:
    """Write the proof of a verdict and return its path; remove a certificate of another model of that name."""
    proof = verdict.certificate if verdict.is_certified else getattr(verdict, "witness", None)
    if proof is not None:
        target.parent.mkdir(parents=True, exist_ok=True)
        proof.save(target)
        return str(target)
    if target.is_file() and model.sha256 not in target.read_text(encoding="utf-8", errors="replace"):
        target.unlink()
    return None


def _load_model(path: Path) -> "PersidskiiModel":
    from persid.model import load_model

    try:
        return load_model(path)
    except (TypeError, AttributeError, LookupError, ValueError) as error:
        raise error if isinstance(error, PersidError) else ModelError(f"{path}: not a model: {error}") from None


def _writable(path: Path) -> None:
    """Refuse early what could not be written in the end."""
    existing = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.exists())
    if existing != path.absolute() and not existing.is_dir():
        raise DataError(f"{path} cannot be written: {existing} is a file; give another -o")
    if not os.access(existing, os.W_OK):
        raise DataError(f"{path} cannot be written: no permission at {existing}; give another -o")


def _command() -> str:
    return "persid " + shlex.join(sys.argv[1:])


def _kind(name: str) -> str:
    return name.removesuffix(".json")


def _number(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def _count(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"


def _data_rows(paths: Sequence[Path], data: "Trajectories") -> list[tuple[str, str]]:
    name = str(paths[0]) if len(paths) == 1 else f"{len(paths)} files"
    counts = [_count(len(data), "run"), _count(data.samples, "sample")]
    counts += [_count(len(data.states), "state"), _count(len(data.inputs), "input")]
    return [("data", f"{name}: {', '.join(counts)}")]


def _fit_rows(report: Any) -> list[tuple[str, str]]:
    rows = [("fit", f"{report.method} form, {report.columns} columns, ridge {report.ridge:.3g}")]
    if report.free_run is not None:
        score = report.free_run
        blown = f", {_count(score.blow_ups, 'blow-up')}" if score.blow_ups else ""
        rows += [("free run", f"R2 {score.r2_mean:.4f}, RMSE {score.rmse:.4g} on the held-out tail{blown}")]
    return [*rows, *(("note", text) for text in report.notes), *(("warning", text) for text in report.warnings)]


def _scores(report: Any) -> dict[str, Any]:
    pairs = (("free_run", report.free_run), ("one_step", report.one_step))
    scores = {name: {"rmse": _number(s.rmse), "r2": _number(s.r2_mean)} for name, s in pairs if s is not None}
    return {**scores, "notes": list(report.notes), "warnings": list(report.warnings)}


def _verdict_rows(verdict: Any) -> list[tuple[str, str]]:
    from persid.summary import above, below, summarize

    brief = summarize(verdict)
    if verdict.is_certified:
        text = f"certified: input-to-state stable, {brief.scope} (claim {brief.claim}), {brief.seconds:.2g} s"
        bounds = []
        if brief.rate is not None and brief.gain is not None:
            bounds = [f"rate {below(brief.rate)} 1/s, gain {above(brief.gain)}"]
        return [("verdict", "\n".join([text, *bounds]))]
    return [("verdict", f"{brief.verdict}: {brief.reason}")]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = persid.main(args=given, prog_name="persid", standalone_mode=False)
        sys.stdout.flush()
        return code if isinstance(code, int) else DONE
    except BaseException as error:  # the border: whatever happens becomes one of the exit codes
        return _failed(error, "--debug" in given, "--json" in given)


def _failed(error: BaseException, debug: bool, as_json: bool) -> int:
    code, message = _explain(error)
    if debug:
        traceback.print_exception(error)
    try:
        complain(message, code, as_json)
        sys.stdout.flush()
    except OSError:  # nobody listens any more; keep the interpreter from complaining once more when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code


def _explain(error: BaseException) -> tuple[int, str]:
    """Return exit code and message of an exception."""
    if isinstance(error, click.Abort | KeyboardInterrupt):
        return INTERRUPTED, "interrupted; nothing was written"
    if isinstance(error, click.ClickException):
        ctx = getattr(error, "ctx", None)
        hint = f"\n{ctx.get_usage()}\nTry: {ctx.command_path} --help" if ctx else ""
        return WRONG, error.format_message() + hint
    if isinstance(error, BrokenPipeError | SystemExit):  # click ends some broken pipes with 1, which means refuted here
        return INTERNAL, "the output was closed before everything was printed"
    if isinstance(error, PersidError):
        return WRONG, str(error)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return WRONG, f"{where}{error.strerror or error}; free the place or give another path"
    hint = "this is a fault of persid; run again with --debug and report what it prints"
    return INTERNAL, f"{type(error).__name__}: {error}; {hint}"
