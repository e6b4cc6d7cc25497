"""What a certificate of version 1 says about outputs and about any two solutions.

Specification: docs/certificate-format.md, "Outputs" and "Any two solutions".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from flint import arb, arb_mat, ctx, fmpq

from persid_check.entry import Entry
from persid_check.exact import Matrix
from persid_check.expression import Program
from persid_check.json_text import Json
from persid_check.outputs import FIELDS, read_outputs, require_stated
from persid_check.results import FormatError, NotProvedError
from persid_check.search.prover import prove_nondecreasing
from persid_check.subject import Subject
from persid_check.version_1.format import Stability

MAX_STATES = 200  # a linear system is solved in ball arithmetic
BITS = (256, 1024, 4096)  # with which that is tried
ACCURACY = 60  # bits of a constant that are enough: 53 are written
OPTIONAL = {"E": ("outputs", "incremental"), "R": ("outputs",)}  # fields that a certificate of a claim may have

Row = tuple[Fraction, ...]


@dataclass(frozen=True)
class Outputs:
    """The rows of the outputs, their maps, and for each c and the Lipschitz constant of its map (1 for none)."""

    sha256: str
    names: tuple[str, ...]
    C: tuple[Row, ...]
    D: tuple[Row, ...]
    maps: tuple[Program, ...] | None
    constants: Row
    lipschitz: Row


@dataclass(frozen=True)
class Conclusions:
    """What a certificate claims beyond the estimate of its state."""

    outputs: Outputs | None = None
    incremental: bool = False


NOTHING = Conclusions()


def detached(data: Any) -> tuple[Any, Json]:
    """Return a certificate's object without its optional fields, and those."""
    claim = data.get("claim") if isinstance(data, dict) else None
    names = OPTIONAL.get(claim, ()) if isinstance(claim, str) else ()
    more = {name: data[name] for name in names if name in data}
    return ({name: value for name, value in data.items() if name not in more} if more else data), more


def read_conclusions(more: Mapping[str, object], subject: Subject) -> Conclusions:
    """Return what the optional fields claim.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    if "incremental" in more and more["incremental"] is not True:
        raise FormatError("incremental", "true, or no such field, is needed")
    outputs = _outputs(Entry(more["outputs"], "outputs"), subject) if "outputs" in more else None
    return Conclusions(outputs, "incremental" in more)


def _outputs(entry: Entry, subject: Subject) -> Outputs:
    block = entry.fields(("sha256", *FIELDS, "constants", "lipschitz"))
    found = read_outputs(block, subject.model.n, subject.model.m)
    stated, count, steepness = require_stated(block, subject.form), len(found.names), block["lipschitz"]
    if (found.maps is None) != (steepness.value is None):
        steepness.refuse("null without output_map, else one number an output is needed")
    lipschitz = (Fraction(1),) * count if found.maps is None else steepness.dyadics(count)
    return Outputs(
        sha256=stated,
        names=found.names,
        C=found.C,
        D=found.D,
        maps=found.maps,
        constants=block["constants"].dyadics(count),
        lipschitz=lipschitz,
    )


def prove_outputs(claim: Stability, outputs: Outputs, below: Matrix) -> None:
    """Prove |h(a) - h(b)| <= L |a - b| and c > C below^-1 C' for each output; V >= z'below z, below > 0, is proved.

    Raises:
        NotProvedError: a step of the proof fails.
    """
    if claim.point is None and any(claim.subject.model.b):
        raise NotProvedError("outputs", "b is not zero at the reference; bounds of outputs need an operating point")
    for i, program in enumerate(outputs.maps or ()):
        _steepness(i, program, outputs.lipschitz[i])
    for i, least in enumerate(least_constants(outputs.C, below)):
        if not _ball(outputs.constants[i]) > least:
            raise NotProvedError(f"outputs.constants[{i}]", "c V >= |C (x - x*)|^2 is not proved from the bound of V")


def _steepness(i: int, program: Program, L: Fraction) -> None:
    """L y + h(y) and L y - h(y) are nondecreasing on R: h has no slope beyond +-L."""
    curve = ((program, Fraction(1)),)
    if not all(prove_nondecreasing(curve, (L, sign)) for sign in (Fraction(1), Fraction(-1))):
        raise NotProvedError(f"outputs.lipschitz[{i}]", "no proof that the output map is nowhere steeper")


def least_constants(C: Sequence[Row], below: Matrix) -> list[arb]:
    """Return enclosures of C_i below^-1 C_i', of more bits where they are wide: the least c with c below >= C_i'C_i.

    Raises:
        NotProvedError: `below` cannot be inverted with the bits that are tried, or is too large.
    """
    n = below.height
    if n > MAX_STATES:
        raise NotProvedError("outputs", f"bounds of outputs are read for at most {MAX_STATES} states")
    found: list[arb] = []
    for bits in BITS:
        with ctx.workprec(bits):
            columns = arb_mat(n, len(C), [_ball(row[j]) for j in range(n) for row in C])
            try:
                solved = arb_mat(below.flint).solve(columns)
            except ZeroDivisionError:
                continue
            totals = [sum((columns[j, i] * solved[j, i] for j in range(n)), arb(0)) for i in range(len(C))]
            found = [total * arb(2) ** below.exponent for total in totals]
        if all(c.rel_accuracy_bits() > ACCURACY or c.rad() == 0 for c in found):
            break
    if not found:
        raise NotProvedError("outputs", "the bound of V cannot be inverted with the bits that are tried")
    return found


def _ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


def prove_incremental(claim: Stability, everywhere: bool) -> None:
    """Prove the conditions of claim E about any two solutions: no density, every used form nondecreasing.

    Raises:
        NotProvedError: one of them does not hold.
    """
    if any(mu for proof in claim.groups for mu in proof.mu):
        raise NotProvedError("incremental", "V holds integrals; it says nothing about any two solutions")
    if not everywhere:
        raise NotProvedError("incremental", "a form that is used is not proved to be nondecreasing")
