"""Puts benchmarks/results/*.json into the page on benchmarks while the site is built: every figure, none chosen.

The line `<!-- results -->` of docs/benchmarks.md is replaced: a section a file, single values in one table, lists of
records in one table each, longer ones folded; pictures of docs/images/benchmarks/ come first. The line
`<!-- public benchmarks -->` of docs/outputs.md becomes the errors on public benchmarks beside published ones, and
`<!-- published problems -->` of docs/published.md the figures on published problems.
"""

import json
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PICTURES = ROOT / "benchmarks" / "results", ROOT / "docs" / "images" / "benchmarks"
MARK, PUBLIC, PUBLISHED = "<!-- results -->", "<!-- public benchmarks -->", "<!-- published problems -->"
MOST_ROWS = 60  # of a table; the file has all
OPEN_ROWS = 12  # of a table that is not folded
LONGEST = 60  # characters of a cell


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill the page: a hook of MkDocs."""
    for mark, made in ((MARK, results), (PUBLIC, public), (PUBLISHED, published)):
        markdown = markdown.replace(mark, made()) if mark in markdown else markdown
    return markdown


def public(folder: Path = RESULTS) -> str:
    """Return a table for every public benchmark: median and spread over seeds, beside what others have published."""
    content = json.loads((folder / "public.json").read_text(encoding="utf-8"))
    names = dict.fromkeys(row["benchmark"] for row in content["rows"])
    return "\n\n".join(_compared(name, content) for name in sorted(names))


def published(folder: Path = RESULTS) -> str:
    """Return a table for every kind of figure on published problems."""
    rows = json.loads((folder / "published.json").read_text(encoding="utf-8"))["rows"]
    parts = []
    for what in dict.fromkeys(row["what"] for row in rows):
        chosen = [
            {
                "problem": row["problem"], "before": row["before"], "persid now": row["now"],
                **{key: row[key] for key in ("published", "truth", "seconds", "source")},
            }
            for row in rows
            if row["what"] == what
        ]  # fmt: skip
        used = [key for key in chosen[0] if any(row[key] is not None for row in chosen)]
        parts.append(f"**{what[0].upper()}{what[1:]}**\n\n{table([{key: row[key] for key in used} for row in chosen])}")
    return "\n\n".join(parts)


def _compared(name: str, content: dict[str, Any]) -> str:
    rows, others = ([row for row in content[key] if row["benchmark"] == name] for key in ("rows", "published"))
    spread = {
        f"{test}, {rows[0]['unit']}": f"**{median(found):.3f}** ({min(found):.3f} to {max(found):.3f})"
        for test, found in ((test, [row["errors"][test] for row in rows]) for test in rows[0]["errors"])
    }
    ours = {
        "model": f"persid, median and spread of {len(rows)} seeds", **spread,
        "certified": f"{sum(row['certified'] for row in rows)} of {len(rows)}",
        "seconds": f"{median(row['seconds'] for row in rows):.0f}",
    }  # fmt: skip
    theirs = [
        {
            "model": row["model"],
            **dict(zip(spread, map(str, row["errors"].values()), strict=True)),
            "source": row["source"],
        }
        for row in others
    ]
    return f"**{name.capitalize()}**\n\n{table([ours, *theirs])}"


def results(folder: Path = RESULTS) -> str:
    """Return the sections of all files."""
    return "\n\n".join(section(path) for path in sorted(folder.glob("*.json")))


def section(path: Path) -> str:
    """Return the section of one file of results."""
    content = json.loads(path.read_text(encoding="utf-8"))
    content = content if isinstance(content, dict) else {"results": content}
    command = f"python benchmarks/{path.stem}.py" if (ROOT / "benchmarks" / f"{path.stem}.py").is_file() else ""
    parts = [f"## {path.stem.replace('_', ' ').capitalize()}", f"`{command}`, " if command else ""]
    parts[1] += f"`benchmarks/results/{path.name}`"
    pictures = sorted(PICTURES.glob(f"{path.stem}*.svg"))
    parts += [f"![{picture.stem.replace('-', ' ')}](images/benchmarks/{picture.name})" for picture in pictures]
    singles = {name: value for name, value in content.items() if not isinstance(value, dict | list)}
    parts += [block(singles)] if singles else []
    for name, value in content.items():
        if name not in singles:
            parts += [f"**{name.replace('_', ' ')}**", block(value)]
    return "\n\n".join(parts)


def block(value: Any) -> str:
    """Return a list as a table, an object of objects as one too, and an object of single values as a line."""
    if isinstance(value, list):
        return table([row if isinstance(row, dict) else {"value": row} for row in value])
    if value and all(isinstance(row, dict) for row in value.values()):
        return table([{"": name, **row} for name, row in value.items()])
    return "; ".join(f"{name} {cell(row)}" for name, row in value.items()) or "none"


def table(rows: list[dict[str, Any]]) -> str:
    """Return records as a table; columns in the order of their first appearance."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    if not rows:
        return "none"
    lines = [columns, ["---"] * len(columns), *([cell(row.get(name)) for name in columns] for row in rows[:MOST_ROWS])]
    text = "\n".join("| " + " | ".join(column or " " for column in line) + " |" for line in lines)
    more = f"\n\nThe first {MOST_ROWS} of {len(rows)} rows." if len(rows) > MOST_ROWS else ""
    return folded(text + more, len(rows)) if len(rows) > OPEN_ROWS else text


def folded(text: str, count: int) -> str:
    """Return a table that opens on a click."""
    return f'??? note "{count} rows"\n\n' + "\n".join(f"    {line}".rstrip() for line in text.split("\n"))


def cell(value: Any) -> str:
    """Return a value as the text of one cell."""
    if value is None:
        return "—"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    text = ", ".join(f"{k}: {cell(v)}" for k, v in value.items()) if isinstance(value, dict) else str(value)
    if isinstance(value, list):
        text = ", ".join(cell(v) for v in value)
    text = " ".join(text.split())
    short = text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
    return short.replace("|", "\\|").replace("<", "&lt;")
