"""Draw docs/images/rooms.svg: the rooms of persid from the top down, and which of them imports which.

python docs/make_rooms.py            write it
python docs/make_rooms.py --check    exit with 1 where it is not up to date
python docs/make_rooms.py --figures  print files, imports and floors of persid, and the lines of each room
"""

import ast
import sys
import tomllib
from graphlib import TopologicalSorter
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "persid"
PICTURE = Path(__file__).with_name("images") / "rooms.svg"
ROW, LEFT, NAME, STEP = 34, 16, 560, 30  # pixels: height of a row, margin, width of the texts, width of a column
HEAD = 120  # pixels above the first row


def layers() -> list[str]:
    """Return the rooms from the top down, as the contract in pyproject.toml has them; small modules count as one."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    stated = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    names = [name.strip() for layer in stated for name in layer.split("|")]
    return [name for name in names if (SOURCE / name).is_dir()] + ["persid_check"]


def sentence(room: str) -> str:
    """Return what a room is for: the first line of its docstring, without its last stop."""
    path = (SOURCE.parent if room == "persid_check" else SOURCE) / room / "__init__.py"
    text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    return text.splitlines()[0].split(": `")[0].split(". ")[0].rstrip(".")


def imported(room: str) -> set[str]:
    """Return the rooms that the files of a room import."""
    found = set()
    for path in (SOURCE / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            found |= {name.split(".")[1] for name in names if name.startswith("persid.")}
            found |= {"persid_check" for name in names if name.split(".")[0] == "persid_check"}
    return found - {room}


def picture() -> str:
    """Return the picture: a row a room, its own square, and right of it a dot for every room that it imports."""
    rooms = layers()
    width, height = LEFT * 2 + NAME + STEP * len(rooms), HEAD + ROW * len(rooms) + 12
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"'
        ' font-family="sans-serif" font-size="13">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        f'<text x="{LEFT}" y="{HEAD - 12}" fill="#555">a dot: the room of this row imports that of the column;'
        " left of its square it would go up</text>",
    ]
    x = {room: LEFT + NAME + STEP * k + STEP // 2 for k, room in enumerate(rooms)}
    parts += [
        f'<text transform="translate({x[room] + 5} {HEAD - 8}) rotate(-60)" font-size="12" fill="#333">{room}</text>'
        for room in rooms
    ]
    for k, room in enumerate(rooms):
        y = HEAD + ROW * k
        fill = "#fff3e0" if room == "persid_check" else ("#eef2fb" if k % 2 else "#e1e8f7")
        parts += [
            f'<rect x="{LEFT - 8}" y="{y}" width="{width - 2 * LEFT + 16}" height="{ROW - 4}" rx="4" fill="{fill}"/>',
            f'<text x="{LEFT}" y="{y + 20}" font-weight="bold">{room}</text>',
            f'<text x="{LEFT + 112}" y="{y + 20}" fill="#333" font-size="12">{escape(sentence(room))}</text>',
            f'<rect x="{x[room] - 9}" y="{y + 6}" width="18" height="18" fill="none" stroke="#7a869a"/>',
        ]
        below = imported(room) if room != "persid_check" else set()
        parts += [
            f'<circle cx="{x[other]}" cy="{y + 15}" r="6" fill="#27408b"><title>{room} imports {other}</title></circle>'
            for other in rooms
            if other in below
        ]
    return "\n".join([*parts, "</svg>\n"])


def modules() -> dict[str, set[str]]:
    """Return the modules of persid with those that each imports, in functions and for types too."""
    paths = {".".join(path.relative_to(SOURCE.parent).with_suffix("").parts): path for path in SOURCE.rglob("*.py")}
    known = {name.removesuffix(".__init__"): path for name, path in paths.items() if name != "persid.__init__"}
    found = {}
    for name, path in known.items():
        nodes = [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.ImportFrom)]
        inner = {f"{node.module}.{alias.name}" for node in nodes for alias in node.names} & set(known)
        whole = {node.module for node in nodes if not {f"{node.module}.{a.name}" for a in node.names} & set(known)}
        found[name] = (inner | whole & set(known)) - {name}
    return found


def figures() -> str:
    """Return the size of the house: files, imports, floors (the longest way down), lines a room.

    Raises:
        graphlib.CycleError: some modules import each other in a circle.
    """
    graph, floors = modules(), dict[str, int]()
    for name in TopologicalSorter(graph).static_order():
        floors[name] = 1 + max((floors[below] for below in graph[name]), default=0)
    rooms = [name for name in layers() if name != "persid_check"]
    lines = {r: sum(len(p.read_text("utf-8").splitlines()) for p in (SOURCE / r).rglob("*.py")) for r in rooms}
    size = f"{len(graph)} files, {sum(map(len, graph.values()))} imports on {max(floors.values())} floors, no circle"
    return "\n".join([size, *(f"{room:15} {count:6} lines" for room, count in lines.items())])


if __name__ == "__main__":
    if "--figures" in sys.argv:
        print(figures())
        sys.exit()
    if "--check" in sys.argv:
        sys.exit(not (PICTURE.is_file() and PICTURE.read_text(encoding="utf-8") == picture()))
    PICTURE.write_text(picture(), encoding="utf-8")
