"""What the tests of the command line share: models, usual commands, and stand-ins."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from persid.certified_fits.delivery import Delivery

MODEL = {
    "format": "persid-model-1", "states": ["x1", "x2"], "inputs": ["u"],
    "A0": [[-1, 0.5], [0.5, -2]], "terms": [{"f": "tanh(x)", "R": None, "A": [[-1, 0], [0, -1]]}],
    "B": [[1], [0]],
}  # fmt: skip
UNSTABLE = MODEL | {"A0": [[0.5, 1], [-1, 0.5]], "terms": []}


def free_fit_only(fit: Any, verdict: Any, *more: Any, **how: Any) -> Delivery:
    """Deliver the free fit, where a test is about a verdict that a fit under the certificate would avoid."""
    return Delivery(fit.model_, verdict)


RUN = ["run", "data.csv", "--states", "x1,x2", "--inputs", "u", "-o", "out"]
IDENTIFY = ["identify", "data.csv", "--states", "x1,x2", "--inputs", "u", "-o", "m.json"]


def files(path: Path) -> set[str]:
    """Return the names of all files below a folder."""
    return {str(file.relative_to(path)) for file in path.rglob("*") if file.is_file()}


def raising(error: BaseException) -> Callable[..., Any]:
    def fail(*args: Any, **how: Any) -> Any:
        raise error

    return fail
