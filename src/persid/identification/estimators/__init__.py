"""Estimators, one a file: how measurements become the rows of a regression. A file's name is that of its method."""

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from persid.identification.regressions import Estimator

METHODS = tuple(module.name for module in iter_modules(__path__))


def estimator(method: str) -> "Estimator":
    """Return the estimator of a method."""
    found: Estimator = import_module(f"{__name__}.{method}").ESTIMATOR
    return found
