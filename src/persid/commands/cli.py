"""The command line: its commands, and the border at which whatever happens becomes an exit code."""

import os
import sys
import traceback
from collections.abc import Sequence

import click

from persid.commands.certify import certify, check
from persid.commands.console import complain
from persid.commands.exit_codes import DONE, EXIT_CODES, explain
from persid.commands.identify import bootstrap, identify, run
from persid.commands.score import score
from persid.commands.show import completion, report, simulate
from persid.commands.study import study

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


for command in (run, identify, certify, check, score, simulate, report, bootstrap, study, completion):
    persid.add_command(command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = persid.main(args=given, prog_name="persid", standalone_mode=False, obj=given)
        sys.stdout.flush()
        return code if isinstance(code, int) else DONE
    except SystemExit as error:  # so click ends when the shell asks it to complete a word
        completing = "_PERSID_COMPLETE" in os.environ
        return int(error.code or DONE) if completing else _failed(error, "--debug" in given, "--json" in given)
    except BaseException as error:  # the border: whatever happens becomes one of the exit codes
        return _failed(error, "--debug" in given, "--json" in given)


def _failed(error: BaseException, debug: bool, as_json: bool) -> int:
    code, message = explain(error)
    if debug:
        traceback.print_exception(error)
    try:
        complain(message, code, as_json)
        sys.stdout.flush()
    except OSError:  # nobody listens any more; keep the interpreter from complaining once more when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code
