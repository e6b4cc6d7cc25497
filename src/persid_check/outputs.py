"""The outputs y = h(C (x - x_ref) + D (u - u_ref) + d) of a model, read in canonical form, and the hash of both."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from persid_check.entry import Entry
from persid_check.expression import Program
from persid_check.json_text import Stated
from persid_check.model import sha256_of
from persid_check.results import NotProvedError

FORMAT = "persid-output-model-1"
FIELDS = ("outputs", "C", "D", "d", "output_map")
MAX_OUTPUTS = 1000

Rows = tuple[tuple[Fraction, ...], ...]


@dataclass(frozen=True)
class Outputs:
    """Names, rows of C and D, and maps h where there are some; no claim depends on d."""

    names: tuple[str, ...]
    C: Rows
    D: Rows
    maps: tuple[Program, ...] | None


def read_outputs(block: Mapping[str, Entry], n: int, m: int) -> Outputs:
    """Return the outputs of a model with n states and m inputs.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    names, maps = block["outputs"].names(), block["output_map"]
    count = len(names)
    block["outputs"].require(1 <= count <= MAX_OUTPUTS, f"1 to {MAX_OUTPUTS} outputs are read")
    C, D = (tuple(tuple(map(Fraction, row)) for row in block[k].matrix(count, w)) for k, w in (("C", n), ("D", m)))
    block["d"].vector(count)
    programs = None if maps.value is None else tuple(each.program() for each in maps.items(count))
    return Outputs(tuple(names), C, D, programs)


def require_stated(block: Mapping[str, Entry], model: Stated) -> str:
    """Return the hash that a certificate's block of outputs states; it is that of the outputs and of their model.

    Raises:
        FormatError, NotProvedError: it is no text, or another hash.
    """
    stated = block["sha256"].text(64)
    if sha256_of({"format": FORMAT, "dynamics": model, **{name: block[name].value for name in FIELDS}}) != stated:
        raise NotProvedError("outputs.sha256", "it is not the hash of the outputs in the file and their model")
    return stated
