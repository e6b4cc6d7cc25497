"""_html."""

from collections.abc import Sequence
from html import escape


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
