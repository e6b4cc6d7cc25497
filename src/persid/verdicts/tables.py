"""Models, certificates and verdicts as HTML tables for notebooks: nothing but a table, its numbers to be copied."""

from typing import Any

from persid._html import table
from persid._text import above, below
from persid.verdicts.summary import headline, summarize, unsettled


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
