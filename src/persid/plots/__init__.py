"""Figures: one function a figure, which draws on the Axes it is given and returns it. Nothing global is touched.

    import matplotlib.pyplot as plt, persid as ps
    fig, ax = plt.subplots()
    ps.plots.level_sets(ax, certificate)

Blue and solid is measured, red and dashed is the model; the colours are told apart by colour-blind readers and in grey.
"""

from persid.identification.diagnostics import COLLINEAR
from persid.plots.characteristics import characteristic, effect, tabulated
from persid.plots.fields import (
    box_of,
    contributions,
    correlation_matrix,
    correlations,
    phase_portrait,
    terms,
    vector_field,
)
from persid.plots.measured import (
    MOST_RUNS,
    attempts,
    blow_up,
    candidates,
    fits,
    free_run,
    gaps,
    koopman_spectrum,
    overview,
    residuals,
    validation_curve,
)
from persid.plots.proofs import bound, largest_input, level_sets, residual_margin, sector_forms
from persid.plots.style import FIELD, FORM, INK, LEVEL, MEASURED, MODEL, plain, short

__all__ = [
    "COLLINEAR",
    "FIELD",
    "FORM",
    "INK",
    "LEVEL",
    "MEASURED",
    "MODEL",
    "MOST_RUNS",
    "attempts",
    "blow_up",
    "bound",
    "box_of",
    "candidates",
    "characteristic",
    "contributions",
    "correlation_matrix",
    "correlations",
    "effect",
    "fits",
    "free_run",
    "gaps",
    "koopman_spectrum",
    "largest_input",
    "level_sets",
    "overview",
    "phase_portrait",
    "plain",
    "residual_margin",
    "residuals",
    "sector_forms",
    "short",
    "tabulated",
    "terms",
    "validation_curve",
    "vector_field",
]
