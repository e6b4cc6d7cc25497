"""models.tables."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from persid._html import table
from persid.models.formulas import left_side, term_names

MOST_STATES, MOST_TERMS = 8, 40  # of a table of coefficients; a larger model is summed up
LONG = 3  # names that are listed at either end of many


def of_model(model: Any) -> str:
    """Return the coefficients of a model, one row a term; of a large one what it consists of."""
    caption = f"PersidskiiModel with {_count(model.n, 'state')} and {_count(model.m, 'input')}"
    if model.n > MOST_STATES or sum(term.A.shape[1] for term in model.terms) > MOST_TERMS:
        functions = dict.fromkeys(f.text for term in model.terms for f in term.f)
        parts = [("states", model.states), ("inputs", model.inputs), ("functions", [*functions])]
        return table(caption, (), [(name, _list(part)) for name, part in parts])
    model = model.dense()
    channels, field = model.channels, model.field
    columns = np.hstack([channels.A0, channels.columns, model.B, field.b[:, None]]).T
    pairs = zip(term_names(field), columns.tolist(), strict=True)
    rows = [(name, *(f"{value:.5g}" for value in row)) for name, row in pairs if any(row)]
    return table(caption, ("term", *(left_side(field, name) for name in model.states)), rows)


def of_output_model(model: Any) -> str:
    """Return what an output model measures of its states, one row an output, and the table of its dynamics."""
    latent = model.dynamics
    caption = f"OutputModel with {_count(len(model.outputs), 'output')} of {_count(latent.n, 'latent state')}"
    rows = [
        (name, f"{'' if model.output_map is None else model.output_map[i].text}",
         *(f"{value:.5g}" for value in [*model.C[i], *model.D[i], model.d[i]]))
        for i, name in enumerate(model.outputs)
    ]  # fmt: skip
    wide = latent.n + latent.m > MOST_STATES
    head = ("output", "map", *latent.states, *latent.inputs, "constant")
    shown = [("outputs", _list(model.outputs))] if wide else rows
    return table(caption, () if wide else head, shown) + of_model(latent)


def _list(names: Sequence[str]) -> str:
    shown = [*names] if len(names) <= 4 * LONG else [*names[: 3 * LONG], "…", *names[-LONG:]]
    return f"{', '.join(shown)} ({len(names)})" if names else "none"


def _count(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"
