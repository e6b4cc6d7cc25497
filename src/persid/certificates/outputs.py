"""Bounds of a model's outputs, for the certificate of its dynamics; see docs/ledger.md, section 7, "outputs"."""

from fractions import Fraction
from math import isfinite
from typing import Any

from persid._files import Json
from persid.certificates.curves import written_cuts
from persid.certificates.partitions import both_sides, cuts_of, cuts_of_continuity
from persid.errors import ModelError, RoundingError
from persid.lyapunov.sectors import steepest
from persid.models.outputs import OutputModel
from persid_check.canonical import canonical_outputs, output_sha256
from persid_check.definite import Root, proof_of
from persid_check.expression import parse
from persid_check.ledger.assembly import assemble
from persid_check.ledger.file import read_ledger
from persid_check.ledger.lemmas import Lemma

DIGITS = 53  # of a constant's mantissa


def described(model: OutputModel) -> Json:
    """Return a model's outputs as a certificate states them, their constants still 0.

    Raises:
        RoundingError: the slopes of a map are not proved bounded.
    """
    maps = model.output_map
    return {
        "sha256": output_sha256(model.to_dict()),
        **canonical_outputs(model.to_dict(), model.dynamics.n, model.dynamics.m),
        "constants": [[0, 0]] * len(model.outputs),
        "lipschitz": None if maps is None else [steepness(h.text) for h in maps],
    }


def with_constants(content: Json) -> Json:
    """Return a ledger with the least constants of its outputs that its factor of the bound of V proves.

    Raises:
        RoundingError: the factor does not prove that bound positive definite.
    """
    ledger = read_ledger(content)
    if ledger.outputs is None:
        return content
    factor = ledger.proof["V"]
    bounding = None if isinstance(factor, Root) else proof_of(assemble(ledger).Pt, factor)
    if bounding is None:
        raise RoundingError("the lower bound of V is not proved positive definite")
    found = bounding.bounds([output.row for output in ledger.outputs.listed])
    return content | {"outputs": content["outputs"] | {"constants": [_above(c) for c in found]}}


def refuse_steep_maps(model: OutputModel) -> None:
    """Refuse an output map whose slopes have no bound: then no bound of the state bounds the output.

    Raises:
        ModelError: there is one; it is named.
    """
    for name, h in zip(model.outputs, model.output_map or (), strict=False):
        if not isfinite(steepest(h.text)):
            raise ModelError(
                f"the output map {h.text} of {name} has no Lipschitz constant; certify its dynamics instead"
            )


def steepness(text: str) -> list[Any]:
    """Return L, the steepest slope of a map, and cuts on whose pieces L s + h(s) and L s - h(s) do not fall."""
    functions = ((parse(text), Fraction(1)),)
    L = _above(Fraction(steepest(text)))
    forms = [(Fraction(L[0]) * Fraction(2) ** L[1], Fraction(sign)) for sign in (1, -1)]
    cuts: set[Fraction] = set()
    for found in (
        cuts_of_continuity(functions, None),
        *(cuts_of(Lemma(functions, form, "nondecreasing"), None) for form in forms),
    ):
        if found is None:
            raise RoundingError(f"no proof that {text} is nowhere steeper than {steepest(text)}")
        cuts |= set(both_sides(found))
    return [L, written_cuts(tuple(sorted(cuts)))]


def _above(number: Fraction) -> list[int]:
    """Return the least dyadic [mantissa, exponent] of so many digits that is not smaller."""
    exponent = number.numerator.bit_length() - number.denominator.bit_length() - DIGITS
    scaled = number / Fraction(2) ** exponent
    return [-(-scaled.numerator // scaled.denominator), exponent]
