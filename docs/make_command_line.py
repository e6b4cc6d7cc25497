"""Write docs/command-line.md from the help texts.

python docs/make_command_line.py            write it
python docs/make_command_line.py --check    exit with 1 where it is not up to date
"""

import sys
from pathlib import Path

import click

from persid.commands.cli import EXIT_CODES, THE_PATH, persid

PAGE = Path(__file__).with_name("command-line.md")
HEAD = f"""# The command line

Generated from the help texts by `docs/make_command_line.py`.

```text
{THE_PATH}
```

Results go to stdout, progress and errors to stderr. `--json` prints exactly one object on stdout. Colours are left out
where `NO_COLOR` is set or the output is no terminal. A bar of progress appears on
stderr after two seconds of work, where a person watches (a terminal). Completion for bash: put
`eval "$(persid completion bash)"` into `~/.bashrc`; `persid completion zsh` and `fish` likewise.

| exit code | meaning |
| --- | --- |
"""


def page() -> str:
    """Return the page."""
    codes = "\n".join(f"| {code} | {meaning} |" for code, meaning in EXIT_CODES.items())
    commands = [persid, *persid.commands.values()]
    return HEAD + codes + "\n\n" + "\n".join(section(command) for command in commands)


def section(command: click.Command) -> str:
    """Return the section of one command."""
    name = "persid" if command is persid else f"persid {command.name}"
    context = click.Context(command, info_name=name, terminal_width=100, help_option_names=["-h", "--help"])
    return f"## {name}\n\n```text\n{command.get_help(context)}\n```\n"


if __name__ == "__main__":
    if "--check" in sys.argv:
        sys.exit(not (PAGE.is_file() and PAGE.read_text(encoding="utf-8") == page()))
    PAGE.write_text(page(), encoding="utf-8")
