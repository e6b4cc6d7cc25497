"""The documentation: every snippet runs and prints what the page says; every page can be reached."""

import json
import re
from pathlib import Path

import benchmark_tables
import make_rooms
import make_trust
import pytest
from snippets import FENCE, RUNNABLE, blocks, prepare, run

import persid as ps
import persid_check
from places import ROOT
from shown import numbers, words

DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
SHOWN = {
    "text",
    "json",
    "{.python .example}",
}  # not run here: outputs, files, and the examples, which test_examples runs
README = ROOT / "README.md"
LONG = ("fitting-under-the-certificate", "troubleshooting", "large-data", "index", "outputs")  # run with -m long


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with the examples at hand."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.long] * (page.stem in LONG)) for page in [*PAGES, README]],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_snippets_run(page: Path, here: Path) -> None:
    """Every snippet of a page runs, in the order of the page, and prints the numbers and words that the page shows."""
    names: dict[str, object] = {"__name__": "__main__"}
    for block in prepare(page, here):
        printed = run(block, names, page)
        if block.output is not None:
            where = f"{page.name}, line {block.line}"
            assert numbers(printed) == pytest.approx(numbers(block.output), rel=0.1, abs=1e-9), where
            assert words(printed) == words(block.output), where


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(DOCS)))
def test_blocks_are_run_or_marked(page: Path) -> None:
    """Every fenced block of the documentation is Python, a shell command, or marked as something that is only shown."""
    unmarked = [block.line for block in blocks(page) if block.language not in {*RUNNABLE, *SHOWN}]
    assert not unmarked, f"{page.name}: blocks in lines {unmarked} are not marked"


def test_a_broken_snippet_is_noticed(here: Path) -> None:
    """A page whose command fails, or whose numbers differ from the printed ones, would not pass."""
    page = here / "page.md"
    page.write_text("```sh\npersid check nothing.json\n```\n\n```python\nprint(2.5)\n```\n\n```text\n3.5\n```\n")
    command, code, _ = blocks(page)
    with pytest.raises(AssertionError, match="persid check"):
        run(command, {}, page)
    assert numbers(run(code, {}, page)) != pytest.approx(numbers(code.output or ""), rel=0.1)


def test_every_page_is_in_the_menu() -> None:
    """The menu of the site names every page, and no page that is not there."""
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:")[1]
    assert set(re.findall(r"[\w/-]+\.md", menu)) == {page.relative_to(DOCS).as_posix() for page in PAGES}


@pytest.mark.parametrize("page", [*PAGES, README], ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    """Every relative link and picture of a page is there."""
    targets = re.findall(r"\]\((?!https?:|mailto:)([^)#\s]+)", FENCE.sub("", page.read_text(encoding="utf-8")))
    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_benchmarks_show_every_file() -> None:
    """The page of benchmarks has a section for every file of results, and every single value is in it."""
    text = benchmark_tables.on_page_markdown((DOCS / "benchmarks.md").read_text(encoding="utf-8"))
    for path in (ROOT / "benchmarks" / "results").glob("*.json"):
        assert f"results/{path.name}`" in text


def test_benchmark_tables_hold_any_record(tmp_path: Path) -> None:
    """Records with different fields, nested values and bars become one table without a broken row."""
    rows = [{"n": 1, "seconds": 0.123456}, {"n": 2, "why": "a | b", "nested": {"x": [1.0, None]}}]
    (tmp_path / "some_name.json").write_text(json.dumps({"runs": rows, "version": "1.0", "empty": []}))
    text = benchmark_tables.results(tmp_path)
    assert "| 1 | 0.1235 | — | — |" in text
    assert "| 2 | — | a \\| b | x: 1, — |" in text
    assert (
        len(
            {line.replace("\\|", "").count("|") for line in text.splitlines() if line.startswith(("| n", "| 1", "| 2"))}
        )
        == 1
    )


def test_public_benchmarks_stand_beside_published_figures(tmp_path: Path) -> None:
    """A benchmark's table has the median and spread over seeds, how many are certified, and what others published."""
    rows = [
        {"benchmark": "b", "seed": k, "errors": {"test": e}, "seconds": 9.0, "certified": k < 2, "unit": "V"}
        for k, e in enumerate((0.3, 0.1, 0.2))
    ]
    others = [{"benchmark": "b", "model": "GRU", "errors": {"test": 0.4}, "source": "a paper"}]
    (tmp_path / "public.json").write_text(json.dumps({"rows": rows, "published": others}))
    lines = benchmark_tables.public(tmp_path).splitlines()
    assert lines[2] == "| model | test, V | certified | seconds | source |"
    assert lines[4] == "| persid, median and spread of 3 seeds | **0.200** (0.100 to 0.300) | 2 of 3 | 9 | — |"
    assert lines[5] == "| GRU | 0.4 | — | — | a paper |"


def test_api_pages_hold_every_public_name() -> None:
    """Every public function and class of persid has its entry on an API page, and every public name of the checker."""
    entries = set(
        re.findall(r"^::: \S+\.(\w+)$", "\n".join(p.read_text(encoding="utf-8") for p in DOCS.glob("api/*.md")), re.M)
    )
    errors = {name for name in ps.__all__ if name.endswith("Error")}  # documented together, as a module
    assert {*ps.__all__, *persid_check.__all__} - errors - {"__version__"} <= entries


def test_the_rooms_are_drawn_as_they_are() -> None:
    """The picture of the rooms shows the imports of today, and none of them goes up."""
    assert make_rooms.PICTURE.read_text(encoding="utf-8") == make_rooms.picture(), "run python docs/make_rooms.py"
    rooms = make_rooms.layers()
    for k, room in enumerate(rooms[:-1]):
        assert not make_rooms.imported(room) & set(rooms[:k])


def test_api_pages_mirror_the_rooms() -> None:
    """An entry of a page of the API comes from the room that the page is named after."""
    for page in DOCS.glob("api/*.md"):
        room = "persid_check" if page.stem == "checker" else f"persid.{page.stem.replace('-', '_')}"
        entries = re.findall(r"^::: (\S+)$", page.read_text(encoding="utf-8"), re.M)
        assert entries
        assert all(entry == room or entry.startswith(f"{room}.") for entry in entries)


@pytest.mark.parametrize("page", sorted(DOCS.glob("contributing/*.md")), ids=lambda path: path.name)
def test_files_that_are_named_are_there(page: Path) -> None:
    """Every file that a page on contributing names by its path is in the repository."""
    named = re.findall(r"`((?:src|tests|docs|\.ci)/[\w./-]+)`", page.read_text(encoding="utf-8"))
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_functions_have_a_place_in_every_file_of_the_list() -> None:
    """The page on functions is true of softplus: it stands in each file that the page lists, and in no other."""
    text = (DOCS / "contributing" / "a-function.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `(src/\S+)`", text, re.M))
    files = {path for path in (ROOT / "src").rglob("*.py") if '"softplus"' in path.read_text(encoding="utf-8")}
    assert {path.relative_to(ROOT).as_posix() for path in files} == listed


NUMBERED = re.compile(r"^(\d+)\. ", re.MULTILINE)


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=lambda page: page.name)
def test_numbered_lists_keep_their_numbers(page: Path) -> None:
    """What other sentences refer to as step 3 is number 3 on the site, also where a list begins with 0."""
    markdown = pytest.importorskip("markdown", reason="Python-Markdown, which makes the site, is not installed")
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    known = [int(number) for number in NUMBERED.findall(text)]
    used = [name for name in ("tables", "sane_lists") if f"\n  - {name}" in (ROOT / "mkdocs.yml").read_text("utf-8")]
    lists = re.findall(r'<ol(?: start="(\d+)")?>(.*?)</ol>', markdown.markdown(text, extensions=used), re.DOTALL)
    shown = [int(start or 1) + k for start, items in lists for k in range(items.count("<li>"))]
    assert shown == known


def test_the_figures_of_the_house_count_its_rooms() -> None:
    """The figures of the house name its files, imports and floors, no circle, and every room with its lines."""
    first, *rooms = make_rooms.figures().splitlines()
    assert re.fullmatch(r"\d+ files, \d+ imports on \d+ floors, no circle", first)
    assert [line.split()[0] for line in rooms] == make_rooms.layers()[:-1]
    assert all(int(line.split()[1]) > 0 for line in rooms)


def test_the_lines_of_the_checker_are_counted() -> None:
    """The table of what there is to read is of the checker as it stands, and leaves out no file."""
    assert make_trust.table() in make_trust.PAGE.read_text("utf-8"), "run python docs/make_trust.py"
    rows = {**make_trust.OF_A_LEDGER, **make_trust.OTHERS}.values()
    listed = [path for names in rows for path in make_trust.files(names)]
    assert sorted(listed) == sorted(make_trust.CHECKER.rglob("*.py"))
