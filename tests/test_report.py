"""The report page: what it says, that it says it safely, and that a browser shows it."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markupsafe import escape

import persid as ps
from persid import folder, report
from persid.certify import Attempt, Certified, Reason, Undecided
from persid.folder import Record, Results, Source

VALID = Path(__file__).parent / "certificates" / "valid"
ATTEMPTS = (Attempt("global Lyapunov function with diagonal P", "certified", 0.25),)
SPITEFUL = '<script>alert("x")</script> & $\\frac{1}{0}$ \'"'


def measured(model: ps.PersidskiiModel, runs: int = 1) -> ps.Trajectories:
    """Return simulated runs of a model."""
    t = np.linspace(0, 6, 300)
    u = np.tile(np.sin(t)[:, None], (1, model.m))
    found = [model.simulate(np.full(model.n, 0.5 + k), t, u)[0] for k in range(runs)]
    return ps.Trajectories(tuple(found), model.states, model.inputs, ("data.csv: a gap of 3 s from row 7 to row 8",))


def results(certificate: ps.Certificate, **changes: Any) -> Results:
    """Return the results of a run that ended with this certificate."""
    data = measured(certificate.model)
    fit = ps.PersidskiiIdentifier(functions=["x", "tanh(x)"]).fit(data)
    record = Record(
        "persid run data.csv -o out", (Source("somewhere/data.csv", "ab" * 32),), {}, fit.report_, ATTEMPTS,
        folder.versions(),
    )  # fmt: skip
    return Results(certificate.model, Certified(certificate, ATTEMPTS), data, record)


@pytest.fixture(scope="module")
def certified() -> Results:
    """Results with a certificate of claim G."""
    return results(ps.load_certificate(VALID / "g_full.json"))


@pytest.fixture(scope="module")
def delivered(certified: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page of these results and its figures."""
    path = tmp_path_factory.mktemp("delivered")
    report.write_report(certified, path)
    return path


@pytest.fixture(scope="module")
def page(delivered: Path) -> str:
    """The page of these results."""
    return (delivered / "report.html").read_text(encoding="utf-8")


class Outline(HTMLParser):
    """Reads headings, ids, sources and figures from a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.headings: list[int] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.unlabelled: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take note of one tag."""
        given = dict(attrs)
        self.tags.append(tag)
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        self.ids += [value for name, value in attrs if name == "id" and value]
        self.links += [value for name, value in attrs if name in ("href", "src", "xlink:href") and value]
        if tag == "svg" and not (given.get("role") == "img" and given.get("aria-label")):
            self.unlabelled.append(tag)
        if tag == "th" and "scope" not in given:
            self.unlabelled.append(tag)


def test_page_says_the_verdict_and_its_limits(page: str, certified: Results) -> None:
    """The page gives the verdict with its scope, the checker's words, and what is not claimed."""
    assert "Certified: the model is input-to-state stable, globally" in page
    assert str(escape(certified.verdict.certificate.statement.split(" is globally")[0])) in page
    assert "It is about the model, not about the plant" in page
    assert "a gap of 3 s from row 7 to row 8" in page


def test_page_tells_how_to_check(page: str, certified: Results) -> None:
    """The page gives the command that checks the certificate, and the hashes."""
    assert "python -m persid_check certificate.json --model model.json" in page
    assert certified.model.sha256 in page
    assert "ab" * 32 in page


def test_page_is_self_contained(page: str) -> None:
    """Every link stays in the page; there are no scripts, and the page is smaller than 3 MB."""
    outline = Outline(page)
    assert all(link.startswith(("#", "data:,")) for link in outline.links)
    assert {"script", "iframe", "img", "object"}.isdisjoint(outline.tags)
    assert len(page.encode()) < 3e6


def test_page_is_accessible(page: str) -> None:
    """Headings descend by one, ids are unique and hit, figures have alternative texts, headers their scope."""
    outline = Outline(page)
    assert outline.headings[0] == 1
    assert outline.headings.count(1) == 1
    assert all(b <= a + 1 for a, b in zip(outline.headings, outline.headings[1:], strict=False))
    assert len(outline.ids) == len(set(outline.ids))
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)
    assert not outline.unlabelled
    assert outline.tags.count("figure") == outline.tags.count("figcaption") > 3


def test_many_states_and_runs_stay_below_three_megabytes() -> None:
    """The page stays small with eight noisy states, three runs and more samples than anyone can see."""
    n = 8
    model = ps.PersidskiiModel(-np.eye(n))
    rng = np.random.default_rng(0)
    t = np.arange(6_000) * 0.01
    data = ps.Trajectories.from_arrays([rng.normal(size=(6_000, n)) for _ in range(4)], t=[t] * 4)
    text = report.render(Results(model, Undecided(Reason.STALLED), data, None))
    assert len(text.encode()) < 3e6
    assert "first 3 of 4 runs" in text


def test_names_cannot_break_out() -> None:
    """Names of states that hold markup, quotes or mathematics appear as they are and do nothing."""
    model = ps.PersidskiiModel([[-1, 0], [0, -1]], [], [[1], [0]], states=[SPITEFUL, "b"], inputs=["<u>"])
    data = measured(model)
    record = Record(f"persid {SPITEFUL}", (Source(SPITEFUL, "0"),), {}, None, (), {})
    verdict = Undecided(Reason.STALLED, SPITEFUL, (Attempt(SPITEFUL, SPITEFUL, 1.0),))
    text = report.render(Results(model, verdict, data, record))
    assert "script" not in Outline(text).tags
    assert "u" not in Outline(text).tags
    assert "&lt;script&gt;" in text


def test_undecided_page_says_why() -> None:
    """An undecided page gives the reason and the attempts and claims no proof."""
    model = ps.PersidskiiModel([[-1, 0], [0, -1]], [], [[1], [0]])
    text = report.render(Results(model, Undecided(Reason.STALLED, "Try more ridge.", ATTEMPTS), None, None))
    assert "Undecided: The solver stalled" in text
    assert "Undecided is not unstable" in text
    assert "persid_check" not in text
    assert ATTEMPTS[0].what in text


def test_blow_ups_are_told() -> None:
    """A model whose free run diverges is shown with the time at which it does."""
    good = ps.PersidskiiModel([[-1, 0], [0, -1]], [], [[1], [0]])
    bad = ps.PersidskiiModel([[-1, 0], [0, -1]], [("x**3", None, [[9, 0], [0, 9]])], [[1], [0]])
    text = report.render(Results(bad, Undecided(Reason.STALLED), measured(good), None))
    assert re.search(r"It blows up at t = [\d.]+ s \(marked\)", text)


@pytest.mark.parametrize("n", [1, 3, 9])
def test_other_numbers_of_states(n: int) -> None:
    """Models of one, three and nine states have a page, with slices where there is no plane."""
    model = ps.PersidskiiModel(-np.eye(n), [("tanh(x)", None, -np.eye(n))])
    verdict = ps.certify(model) if n == 3 else Undecided(Reason.STALLED)
    text = report.render(Results(model, verdict, measured(model), None))
    assert ("the other states are at" in text) == (n > 2)
    assert "first 8 of 9 states" in text or n < 9


@pytest.mark.parametrize("name", ["e_shifted", "r_pendulum", "m_cubes"])
def test_other_claims(name: str) -> None:
    """Claims with rates, regions and cubes have a page of their own words."""
    certificate = ps.load_certificate(VALID / f"{name}.json")
    text = report.render(Results(certificate.model, Certified(certificate), None, None))
    assert ("the certified region (shaded)" in text) == (certificate.claim == "R")
    assert ("Rate, 1/s" in text) == (certificate.claim in "ER")


def test_files_of_a_report(delivered: Path) -> None:
    """The figures are written beside the page, as files of their own."""
    names = {path.name for path in (delivered / "figures").iterdir()}
    assert {"free-run-1.png", "residuals.png", "level-sets-1-2.png", "sector-forms.png", "contributions.png"} <= names


def test_the_same_results_give_the_same_page(certified: Results, page: str) -> None:
    """A page depends on nothing but the results."""
    assert report.render(certified) == page


def test_browser_shows_the_page(delivered: Path) -> None:
    """Chromium shows the page in light and dark without a message on the console or a request to the network."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not Path("/usr/bin/chromium").exists():
        pytest.skip("Chromium is not at /usr/bin/chromium")
    address = (delivered / "report.html").as_uri()
    messages: list[str] = []
    with playwright.sync_playwright() as play:
        browser = play.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        backgrounds = set()
        for scheme in ("light", "dark"):
            tab = browser.new_page(color_scheme=scheme, viewport={"width": 1000, "height": 900})
            tab.on("console", lambda message: messages.append(message.text))
            tab.on("pageerror", lambda error: messages.append(str(error)))
            tab.on("request", lambda request: messages.append(request.url) if request.url != address else None)
            tab.goto(address)
            text = tab.inner_text("body")
            assert "Certified: the model is input-to-state stable" in text
            assert "Check it yourself" in text
            assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
            backgrounds.add(tab.evaluate("getComputedStyle(document.body).backgroundColor"))
            tab.set_viewport_size({"width": 360, "height": 800})
            assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), "too wide for a telephone"
        browser.close()
    assert messages == []
    assert len(backgrounds) == 2
