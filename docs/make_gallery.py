"""Write docs/gallery.md and docs/images/gallery/ from the examples: what they say, draw and print.

python docs/make_gallery.py            run every example whose data are at hand, and write the page
python docs/make_gallery.py NAME …     run these; what the page says of the others stays as it is
"""

import contextlib
import importlib.util
import inspect
import io
import re
import sys
from pathlib import Path
from types import ModuleType

import matplotlib as mpl

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURES = ROOT / "docs" / "gallery.md", ROOT / "docs" / "images" / "gallery"
TITLES = {
    "traffic": "Traffic: from a CSV file to a global certificate",
    "pendulum": "A damped pendulum: a region",
    "two_tanks": "Two tanks with square-root outflow: a region",
    "lure": "A Lur'e system: functions of combinations of states",
    "learned": "Two tanks whose outflow is learned",
    "recurrent_network": "A recurrent network: how strong may its feedback be?",
    "discrete": "A loop that overshoots: discrete time",
    "descriptor": "A diode circuit: algebraic variables",
    "buses": "Three buses: a region of a model with algebraic variables",
    "duffing": "A Duffing oscillator with damping",
    "power_swing": "Three areas of a power grid",
    "network": "A network of 10,000 states",
    "outputs": "Inputs and outputs only: two tanks and one sensor",
    "qube": "Measured: a rotary pendulum",
    "faster": "Measured: a fatigue-test rig",
}
HEAD = """# Gallery

Each example is one file of `examples/`; it runs as it stands (`python examples/pendulum.py`), prints the numbers below
its picture, and is run by a test. Those with real measurements skip where these are absent.

"""


def load(name: str) -> ModuleType:
    """Return an example as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(name: str, picture: Path) -> str:
    """Run an example, save its picture, and return what it prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), mpl.rc_context({"svg.hashsalt": name, "figure.facecolor": "white"}):
        figure = load(name).main()
        figure.savefig(picture, metadata={"Date": None})
    figure.clear()
    return printed.getvalue().rstrip()


def section(name: str, printed: str) -> str:
    """Return the section of one example."""
    path = ROOT / "examples" / f"{name}.py"
    text = _text(load(name))
    source = "```{.python .example}\n" + path.read_text(encoding="utf-8").rstrip() + "\n```"
    return f"""## {TITLES[name]}

{text}

![{text.splitlines()[0]}](images/gallery/{name}.svg)

```text
{printed}
```

??? example "examples/{name}.py"

{_indented(source)}

"""


def _text(module: ModuleType) -> str:
    """Return a module's docstring without the command that runs it."""
    parts = inspect.cleandoc(module.__doc__ or "").split("\n\n")
    return "\n\n".join(part for part in parts if not part.startswith("    python "))


def _indented(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines())


def printed_before() -> dict[str, str]:
    """Return what the page says that each example prints."""
    text = PAGE.read_text(encoding="utf-8") if PAGE.is_file() else ""
    found = re.findall(r"images/gallery/(\w+)\.svg\)\n\n```text\n(.*?)\n```", text, re.S)
    return dict(found)


def main(names: list[str]) -> None:
    """Run examples and write the page."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    printed = printed_before()
    for name in names or TITLES:
        data = getattr(load(name), "DATA", None)
        if data is not None and not data.is_dir():
            print(f"{name}: skipped, there is no folder {data}", file=sys.stderr)
            continue
        printed[name] = run(name, PICTURES / f"{name}.svg")
    PAGE.write_text(
        HEAD + "".join(section(name, printed[name]) for name in TITLES if name in printed), encoding="utf-8"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
