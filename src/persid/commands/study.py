"""`persid study`: the paper's experiments, and a power grid, from the command line."""

from pathlib import Path

import click

from persid.commands.console import Talk, complain
from persid.commands.exit_codes import DONE, INTERRUPTED
from persid.commands.options import NEW_FOLDER, talking
from persid.studies import STUDIES


@click.command()
@click.argument("name", type=click.Choice(STUDIES), metavar="|".join(STUDIES))
@click.option("-o", "--output", type=NEW_FOLDER, required=True, help="Folder for the results.")
@click.option("--seeds", type=click.IntRange(min=1), help="Repetitions with other random data (wave; 3 by default).")
@click.option("--quick", is_flag=True, help="Smaller sizes: all studies in under two minutes.")
@talking
def study(name: str, output: Path, seeds: int | None, quick: bool, as_json: bool, quiet: bool) -> int:
    """Repeat an experiment of the paper, with the paper's figures beside ours, or study a power grid.

    The folder receives tables.md, tables.json, figures/, report.html, and every model with its checked proof. Finished
    parts are kept: after an interruption the same command goes on where it stopped.

    \b
    Example:
      persid study traffic -o out/traffic --quick
    """
    from persid.studies import run_study

    talk = Talk(as_json, quiet)
    try:
        with talk.progress() as progress:
            found = run_study(name, output, quick=quick, seeds=seeds, progress=progress)
    except KeyboardInterrupt:
        complain(
            f"interrupted; finished parts are kept in {output}, and the same command goes on", INTERRUPTED, as_json
        )
        return INTERRUPTED
    files = {kind: str(output / kind) for kind in ("tables.md", "report.html")}
    content = {"study": name, "quick": quick, "seconds": found.seconds, "figures": dict(found.figures), "files": files}
    rows = [("study", found.title), ("seconds", f"{found.seconds:.0f}")]
    talk.result(content, [*rows, *((kind.partition(".")[0], path) for kind, path in files.items())])
    return DONE
