"""Models, certificates and verdicts as HTML tables for notebooks: nothing but a table, its numbers to be copied."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from persid.equations import term_names
from persid.summary import above, below, headline, summarize, unsettled

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
    channels = model.channels
    columns = np.hstack([channels.A0, channels.columns, model.B, model.b[:, None]]).T
    pairs = zip(term_names(model), columns.tolist(), strict=True)
    rows = [(name, *(f"{value:.5g}" for value in row)) for name, row in pairs if any(row)]
    return table(caption, ("term", *(f"d({name})/dt" for name in model.states)), rows)


def of_certificate(certificate: Any) -> str:
    """Return what a certificate claims, in figures and in the checker's words."""
    rows = [("claim", certificate.claim), ("scope", certificate.scope)]
    if certificate.model.n <= MOST_STATES:
        rows.append(("operating point", ", ".join(f"{x:.5g}" for x in certificate.operating_point)))
    rows += [] if certificate.rate is None else [("rate, 1/s", below(certificate.rate))]
    rows += [] if certificate.gain is None else [("gain", above(certificate.gain))]
    return table("Certificate", (), [*rows, ("statement", certificate.statement)])


def of_verdict(verdict: Any) -> str:
    """Return a verdict, what it rests on, and its attempts with their times in s."""
    brief = summarize(verdict)
    if verdict.is_certified:
        rows = [("verdict", headline(verdict, verdict.certificate.model)), ("claim", verdict.certificate.claim)]
        rows += [] if brief.rate is None else [("rate, 1/s", below(brief.rate))]
        rows += [] if brief.gain is None else [("gain", above(brief.gain))]
    else:
        rows = [("verdict", unsettled(verdict))]
    evidence = getattr(verdict, "evidence", None)
    rows += [("evidence", str(evidence))] if evidence else []
    tried = [(one.what, f"{one.outcome.replace('_', ' ')}, {one.seconds:.3g} s") for one in verdict.attempts]
    return table(type(verdict).__name__, (), [*rows, *tried])


def table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; the first entry of every row is its header."""
    top = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    cell = "<td>" if head else '<td style="text-align: left">'  # numbers stand under heads, texts do not
    body = "".join(f"<tr>{_row(row, cell)}</tr>" for row in rows)
    return (
        f"<table><caption>{escape(caption)}</caption>{f'<thead><tr>{top}</tr></thead>' if head else ''}"
        f"<tbody>{body}</tbody></table>"
    )


def _row(row: Sequence[str], cell: str) -> str:
    cells = "".join(f"{cell}{escape(entry)}</td>" for entry in row[1:])
    return f'<th scope="row" style="text-align: left">{escape(row[0])}</th>{cells}'


def _list(names: Sequence[str]) -> str:
    shown = [*names] if len(names) <= 4 * LONG else [*names[: 3 * LONG], "…", *names[-LONG:]]
    return f"{', '.join(shown)} ({len(names)})" if names else "none"


def _count(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"
