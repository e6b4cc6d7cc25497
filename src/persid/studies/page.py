"""Files of a study: tables as JSON and Markdown, figures as PNG and SVG, and one self-contained page."""

import io
import json
from pathlib import Path

import matplotlib as mpl
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from persid._files import Json, write_atomically
from persid.reports.figures import STYLE, Drawing
from persid.studies.tables import Study

FIGURES = "figures"


def write_study(study: Study, folder: Path) -> None:
    """Write tables.json, tables.md, figures/*.png, figures/*.svg and report.html."""
    (folder / FIGURES).mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):
        for drawing in study.drawings:
            for kind in ("png", "svg"):
                write_atomically(folder / FIGURES / f"{drawing.name}.{kind}", _image(drawing, kind))
        write_atomically(folder / "report.html", _page(study))
    write_atomically(folder / "tables.md", markdown(study))
    write_atomically(folder / "tables.json", json.dumps(_content(study), indent=1, allow_nan=False) + "\n")


def markdown(study: Study) -> str:
    """Return the tables and remarks of a study in Markdown."""
    size = ", quick sizes" if study.quick else ""
    head = f"# {study.title}\n\n{study.protocol}\n\n`persid study {study.name}`{size}: {study.seconds:.0f} s.\n"
    remarks = "\n".join(f"- {sentence}" for sentence in study.remarks)
    return "\n".join([head, *(table.markdown() for table in study.tables), remarks]).rstrip() + "\n"


def _content(study: Study) -> Json:
    return {
        "format": "persid-study-1",
        "study": study.name,
        "quick": study.quick,
        "seconds": study.seconds,
        "versions": dict(study.versions),
        "figures": dict(study.figures),
        "tables": [table.to_dict() for table in study.tables],
        "remarks": list(study.remarks),
    }


def _image(drawing: Drawing, kind: str) -> bytes:
    buffer = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {"Software": None}
    with mpl.rc_context({"svg.hashsalt": drawing.name}):
        drawing.figure.savefig(buffer, format=kind, dpi=144, facecolor="white", metadata=metadata)
    return buffer.getvalue()


def _page(study: Study) -> str:
    loaders = [PackageLoader("persid.studies", "templates"), PackageLoader("persid.reports", "templates")]
    environment = Environment(
        loader=ChoiceLoader(loaders), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template("study.html.jinja").render(study=study)
