"""python -m persid: the command line."""

import sys

from persid.commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
