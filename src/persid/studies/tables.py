"""What a study hands on: tables, drawings, and the figures that are compared with earlier ones."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

from persid._files import Json
from persid.reports.figures import Drawing

Figure = float | int | str | None
Figures = dict[str, Figure]


@dataclass(frozen=True)
class Table:
    """A table: `rows` start with their name; every cell is a text as it is shown."""

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """Return the table in Markdown, its caption as a paragraph before it."""
        lines = [self.columns, ("---",) * len(self.columns), *self.rows]
        return f"{self.caption}\n\n" + "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"

    def to_dict(self) -> Json:
        """Return the table as a JSON object; `from_dict` is the way back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Json) -> "Table":
        """Return what `to_dict` was called on, as it is or read from JSON."""
        return cls(data["name"], data["caption"], tuple(data["columns"]), tuple(map(tuple, data["rows"])))


@dataclass(frozen=True, eq=False)
class Study:
    """What a study found.

    `figures` are the numbers and words behind the tables, by name: what a later run is compared with. `remarks` are
    full sentences on what to know of them. `seconds` is the time of all parts, also of reused ones.
    """

    name: str
    title: str
    protocol: str
    tables: tuple[Table, ...]
    drawings: tuple[Drawing, ...]
    figures: Mapping[str, Figure]
    remarks: tuple[str, ...]
    seconds: float
    quick: bool
    versions: Mapping[str, str] = field(default_factory=dict)


def number(value: float | None, digits: int = 4) -> str:
    """Return an error as text, "—" where there is none."""
    if value is None:
        return "—"
    return f"{value:.{digits}f}" if abs(value) < 100 else f"{value:.3g}"


def spread(values: Sequence[float | None], digits: int = 3) -> str:
    """Return median and range, "median (least … largest)"; None counts as larger than every number."""
    ordered = sorted(float("inf") if value is None else value for value in values)
    middle = ordered[len(ordered) // 2]
    shown = ["∞" if value == float("inf") else number(value, digits) for value in (middle, ordered[0], ordered[-1])]
    return shown[0] if len(ordered) == 1 else f"{shown[0]} ({shown[1]} … {shown[2]})"


def protocol(text: str | None) -> str:
    """Return what follows the first line of a module's docstring, as one paragraph."""
    return " ".join((text or "").split("\n\n", 1)[1].split())
