"""The commands that show: simulate, report and completion."""

from pathlib import Path
from typing import Any

import click

from persid.commands.console import Talk
from persid.commands.exit_codes import DONE, read_any_model, refuse_unwritable, verdict_rows
from persid.commands.options import FILE, NEW_FILE, SHELLS, simulating, talking


@click.command()
@click.argument("model", type=FILE, metavar="MODEL.json")
@simulating
@click.option("-o", "--output", type=NEW_FILE, required=True, help="The CSV file to write.")
@talking
def simulate(
    model: Path, x0: list[float] | None, y_init: Path | None, output: Path, as_json: bool, quiet: bool, **inputs: Any
) -> int:
    """Simulate a model and write t, states (of an output model: outputs) and inputs as CSV.

    Of a model with algebraic variables these are written behind the states.

    An output model starts from --x0, its latent state, or from the first measured outputs: --y-init names a file with
    their columns, whose rows belong to the first times.

    Without --input or --inputs-csv the inputs stay at u_ref. A run that diverges ends there, and so does one
    of a model that is too fast or too stiff to be followed; this is said.

    \b
    Example:
      persid simulate model.json --x0 1,3 --input "sin(t)" --t-end 30 --dt 0.03 -o run.csv
    """
    from persid.commands import signals as making
    from persid.models.outputs import OutputModel

    talk = Talk(as_json, quiet, output)
    subject = read_any_model(model)
    refuse_unwritable(output)
    with talk.progress() as progress:
        start = making.start(subject, x0, y_init, inputs["time"])
        t, u = making.times_and_inputs(subject.dynamics if isinstance(subject, OutputModel) else subject, **inputs)
        progress("simulating")
        found = subject.simulate(t=t, u=u, **start)
    output.parent.mkdir(parents=True, exist_ok=True)
    making.write_csv(output, found)
    gone, stopped = found[0].diverged_at, found[0].stopped_at
    rows = [("samples", f"{found.samples}, t = {found[0].t[0]:g} ... {found[0].t[-1]:g} s")]
    rows += (
        [("diverged", f"the state left all bounds at t = {gone:.6g} s; the run ends there")] if gone is not None else []
    )
    if stopped is not None:
        rows.append(
            ("stopped", f"too fast or too stiff to be followed beyond t = {stopped:.6g} s; the state was bounded")
        )
    rows += [("run", str(output))]
    talk.result({"run": str(output), "samples": found.samples, "diverged_at": gone, "stopped_at": stopped}, rows)
    return DONE


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="OUT")
@talking
def report(folder: Path, as_json: bool, quiet: bool) -> int:
    """Build the report page again from the files in OUT.

    The proof is checked again on the way. What needs the measurements is left out where they have changed.

    \b
    Example:
      persid report out
    """
    from persid.reports.delivery import delivery
    from persid.reports.layout import FIGURES, REPORT
    from persid.reports.page import write_report
    from persid.reports.results import read_results

    talk = Talk(as_json, quiet)
    with talk.progress() as progress:
        progress("reading the results")
        results = read_results(folder)
        progress("drawing the report")
        with delivery(folder, [REPORT, f"{FIGURES}/*.png"]) as stage:
            write_report(results, stage)
    talk.result({"report": str(folder / REPORT)}, [*verdict_rows(results.verdict), ("report", str(folder / REPORT))])
    return DONE


@click.command()
@click.argument("shell", type=click.Choice(SHELLS), metavar="|".join(SHELLS))
@talking
@click.pass_context
def completion(ctx: click.Context, shell: str, as_json: bool, quiet: bool) -> int:
    """Print the script that completes commands, options and file names in a shell.

    For bash, put eval "$(persid completion bash)" into ~/.bashrc; for zsh likewise into ~/.zshrc; for fish write the
    script to ~/.config/fish/completions/persid.fish.

    \b
    Example:
      persid completion bash
    """
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    if kind is None:
        raise click.UsageError(f"click has no completion for {shell}")
    script = kind(ctx.find_root().command, {}, "persid", "_PERSID_COMPLETE").source()
    if as_json:
        Talk(as_json).result({"shell": shell, "script": script}, [])
    elif not quiet:
        click.echo(script)
    return DONE
