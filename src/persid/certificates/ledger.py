"""What every ledger has: how a draft begins, and the factors that prove its matrices."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from persid._files import Json
from persid.certificates.curves import Curves
from persid.certificates.encoding import eliminated, factor, heading, root
from persid.errors import RoundingError
from persid.lyapunov.operating_points import OperatingPoint
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid_check.exact import Matrix, diagonal, is_large
from persid_check.large import Large
from persid_check.ledger import FORMAT
from persid_check.ledger.algebraic import bounded_sides, form_of_differences, form_of_reach
from persid_check.ledger.assembly import Assembly, assemble
from persid_check.ledger.file import read_ledger
from persid_check.ledger.values import Ledger

BOUNDING = 1e12  # how well the factor of the bound of V is known: bounds of rows lose about so little by it
ELIMINATED = 40  # rows of a matrix that is eliminated in fractions
FACTORED = 256  # rows of a matrix that has a factor where it has no root


def draft(
    model: PersidskiiModel | DescriptorModel, claim: str, point: OperatingPoint | None, curves: Curves,
    points: Sequence[Json], facts: dict[str, list[object]],
) -> Json:  # fmt: skip
    """Return a content about a model whose numbers are still 0 and whose matrices have no proof.

    Raises:
        RoundingError: a lemma of a curve is not proved.
    """
    return {
        **heading(model, claim, "The model is input-to-state stable."),
        "format": FORMAT,
        "operating_point": None if point is None else point.to_dict(),
        "curves": curves.written(),
        "points": list(points),
        "facts": {"value": [], "one_signed": [], "difference": [], "constant": []} | facts,
        "P": {"lower": []},
        "gamma": [1, 0],
        "deviations": [],
        "dropped": [],
        "spanning": [],
        "kappa": [0, 0],
        "p": [0, 0],
        "strips": [],
        "level": [0, 0],
        "input_bound": [0, 0],
        "outputs": [],
        "proof": {"P": [], "M": [], "V": None},
    }


def with_proof(draft: Json) -> Json:
    """Return a content with factors for its matrices."""
    ledger = read_ledger(draft)
    matrices, n = assemble(ledger), ledger.model.order
    kept = [i for i in range(matrices.M.height) if i not in set(ledger.dropped)]
    states = [i for i in kept if i < n]
    values = list(range(n, matrices.Pt.height))  # of functions, which V reads
    lower = matrices.Pt + diagonal([-ledger.p] * n + [0] * len(values))
    bounding = ledger.claim == "region" or ledger.outputs is not None
    proof = {
        "P": definite(lower.kept(*[states + values] * 2)),
        "M": definite(matrices.M.kept(kept, kept)),
        "V": factor(floats(matrices.Pt), BOUNDING) if bounding else None,
    }
    return draft | {"proof": proof} | _with_algebraic(draft, ledger, matrices)


def _with_algebraic(draft: Json, ledger: Ledger, matrices: Assembly) -> Json:
    """Return what is said of equations with factors, nothing of a model without them."""
    said = ledger.algebraic
    if said is None:
        return {}
    written = draft["algebraic"]
    solvable = {**written["solvable"], "proof": factor(floats(form_of_differences(ledger, said)))}
    found = {**written, "solvable": solvable}
    if ledger.claim == "region":
        listed = zip(bounded_sides(ledger), said.bounds, written["bounds"], strict=False)
        found["bounds"] = [
            {**entry, "proof": factor(floats(form_of_reach(ledger, row, reach, matrices)))}
            for (row, *_), reach, entry in listed
        ]
    return {"algebraic": found}


def definite(M: Matrix) -> list[list[int]] | Json:
    """Return what proves a matrix positive definite: of a large one a root, which is shorter, else a factor.

    A small one that floating point does not bear is eliminated in fractions.
    """
    seen, error = floats(M), RoundingError("a matrix of the proof is too large")
    for make in [root] * is_large(*M.shape) + [factor] * (M.height <= FACTORED):
        try:
            return make(seen)
        except RoundingError as failed:
            error = failed
    if M.height > ELIMINATED:
        raise error
    return eliminated(M.flint)


def floats(M: Matrix) -> np.ndarray:
    """Return an exact matrix in floating point."""
    if isinstance(M, Large):
        return np.asarray(M.entries.floats(M.exponent))
    rows = [[float(Fraction(int(v), 1 << M.exponent)) for v in line] for line in M.flint.table()]
    return np.array(rows, float).reshape(M.height, M.width)
