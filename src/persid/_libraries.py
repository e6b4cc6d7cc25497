"""Libraries that persid can do without: imported when they are asked for, and named when they are absent."""

from importlib import import_module
from types import ModuleType


def library(name: str, extra: str) -> ModuleType:
    """Return a library of one of persid's extras.

    Raises:
        ImportError: the library is not installed; the message says which extra brings it.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name.split(".")[0]:
            raise
        raise ImportError(f'{name} is not installed; try: pip install "persid[{extra}]"', name=name) from None
