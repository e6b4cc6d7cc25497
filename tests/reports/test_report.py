"""The report page: what it says, that it says it safely, and that a browser shows it."""

import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markupsafe import escape
from scipy.sparse import csc_array

import persid as ps
from persid import plots
from persid._text import pace
from persid.commands.exit_codes import verdict_rows
from persid.identification.scores import Ahead, Scores, held_out_scores
from persid.identification.scores import Record as ScoredRecord
from persid.models import mathml
from persid.reports import layout
from persid.reports import page as report
from persid.reports import proof_figures as portraits
from persid.reports.comparison import cautions
from persid.reports.front import front, picture
from persid.reports.record import Record, Source, versions
from persid.reports.results import Results, read_results
from persid.reports.verdict_files import write_verdict
from persid.verdicts.evidence import Evidence
from persid.verdicts.summary import limits
from persid.verdicts.verdict import Attempt, Certified, Reason, Undecided
from places import VALID

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
        versions(),
    )  # fmt: skip
    return Results(certificate.model, Certified(certificate, ATTEMPTS), data, record)


@pytest.fixture(scope="module")
def certified() -> Results:
    """Results with a certificate without a rate."""
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


@pytest.mark.long
def test_matrix_names_the_values_that_V_reads(tmp_path: Path) -> None:
    """Where V reads values of functions, the matrix of the page has a row and a column for each of them."""
    A0 = [[-2.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    loop = ps.PersidskiiModel(A0, [("tanh(x)", [[4.0, -0.8, -0.4]], [[-1.0], [0.0], [0.0]])], [[1.0], [0.0], [0.0]])
    found = results(ps.certify(loop, time_limit=10).certificate)
    report.write_report(found, tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<tr><th scope="row">s1 = tanh(x)</th>' in text
    assert len(re.findall("<th scope=.col.>(?:x1|x2|x3|s1 = tanh.x.)</th>", text.split("Matrix P of")[1])) == 4


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


def test_equations_are_mathematics_and_can_be_copied(page: str, certified: Results) -> None:
    """Every equation is set in MathML, and stands as text and as LaTeX beside it."""
    model = certified.model
    assert page.count("<math>") == int(mathml.counts(model).sum()) + model.n
    for form in ("text", "latex"):
        assert str(escape(ps.equations(model, form))) in page


def test_page_shows_the_spectrum_of_an_edmd_fit() -> None:
    """A fit by EDMD shows its eigenvalues and the aliasing limit; other fits have no such section."""
    model = ps.PersidskiiModel([[-1, 2], [-2, -1]], [], [[1], [0]])
    data = measured(model)
    fit = ps.PersidskiiIdentifier(functions=["x"], method="edmd").fit(data)
    record = Record("persid run", (), {}, fit.report_, (), {})
    text = report.render(Results(fit.model_, Undecided(Reason.STALLED), data, record))
    assert "the aliasing limit is" in text
    assert re.search(r"fastest mode here turns 0\.31[78]\d? Hz", text)  # 2 rad/s
    spectrum = fit.report_.spectrum
    assert spectrum is not None
    assert f"{spectrum.values[0][0]:.4g}" in text


def test_page_shows_what_was_learned() -> None:
    """Learned functions are drawn over the density of the data, one picture an effect; a model without any has none."""
    model = ps.PersidskiiModel([[-1, 0], [0, -1]], [("sat(x)", None, [[-1, 0], [1, -1]])], [[1], [0]])
    data = measured(model)
    fits = [ps.PersidskiiIdentifier(functions, ridge=1e-4, knots=3).fit(data) for functions in (["x", "pwl"], ["x"])]
    pages = [report.render(Results(fit.model_, Undecided(Reason.STALLED), data, None)) for fit in fits]
    assert ["density of the data" in page for page in pages] == [True, False]
    assert "x1 in d(x2)/dt" in pages[0]


def exploding(model: dict[str, Any]) -> dict[str, Any]:
    """Return a model with an A0 that lets it blow up at once."""
    n = len(model["states"])
    return model | {"A0": (1e3 * np.eye(n)).tolist(), "terms": []}


def test_page_sets_both_fits_and_the_candidates_side_by_side(certified: Results) -> None:
    """Free fit, fit under the certificate and all candidates are told, whatever is recorded of these."""
    fits = [
        {"name": "free", "verdict": "refuted", "rmse": 0.25, "r2": [0.5, -2.0], "blow_ups": 1},
        {"name": "under the certificate", "verdict": "certified", "rmse": 0.5, "r2": [0.9, 0.8], "blow_ups": 0},
    ]
    rows = [
        {"functions": ["x", "tanh(2*x)"], "certified": True, "error": 0.125, "seconds": 2.5, "new_figure": None},
        {"functions": ["x", "sinh(x)"], "certified": False, "error": 0.0625, "seconds": 0.5, "new_figure": 7.0},
        {"functions": ["x"], "certified": False, "error": math.inf, "seconds": 0.5, "new_figure": 8.0},
    ]
    assert certified.record is not None
    unstable = exploding(certified.model.to_dict())
    compared = {"fits": fits, "price": 2.0, "candidates": rows, "free_model": unstable}
    record = replace(certified.record, comparison=compared)
    text = report.render(replace(certified, record=record))
    words = (
        "2 times the free one",
        "x, tanh(2*x)",
        "new figure",
        "0.125",
        "2 of 3 candidate fits",
        "Values below 0 are drawn at 0",
        "The free fit, which has no certificate (dotted), blows up at t = ",
    )
    assert [word for word in words if word not in text] == []
    assert {"fits", "candidates"} <= set(re.findall(r'id="(\w+)-figure_1"', text))


def foretold(r2: float, unseen: bool = True) -> Scores:
    """Scores of one free run with an R2 of both states, where the mean is the forecast to beat."""
    error = math.sqrt(1 - r2)
    row = Ahead(64, 6.4, 3, (0.1, 0.2), (1.0, 2.0), (r2, r2), error, 0, whole=True)
    return Scores(
        "the last 20 % of every run, held out", unseen, ("x1", "x2"), (row,), 0, (("the mean", 1.0),), 0.01, 1.0
    )


@pytest.mark.long
def test_a_certified_model_that_foretells_nothing_is_cautioned_against(certified: Results) -> None:
    """The page is green only where the delivered model foretells; else its head says what is wrong, in amber."""
    assert certified.record is not None
    good, poor, seen = (
        report.render(replace(certified, record=replace(certified.record, scores=scores)))
        for scores in (foretold(0.98), foretold(-0.5), foretold(0.98, unseen=False))
    )
    assert "Proved stable, and it foretells" in good
    assert "on the last 20 % of every run, held out, it is off by 2 % of the range over 6.4 s." in good
    assert 'class="verdict certified"' in good
    assert "the model foretells less than the mean (R2 -0.5, without a model " in poor
    assert "Nothing was held out" in seen
    assert all('class="verdict certified doubtful"' in page for page in (poor, seen))
    assert cautions(Undecided(Reason.STALLED), foretold(-0.5)) == ()


def unstable() -> tuple[ps.PersidskiiModel, ps.Trajectories]:
    """x' = 20 x + u, and a run that a feedback holds near 0: free runs of the model leave it for ever."""
    model, t = ps.PersidskiiModel([[20.0]], [], [[1.0]], states=["x"], inputs=["u"]), 0.05 * np.arange(400)
    x, kicks = [0.01], np.random.default_rng(0).choice([-1.0, 1.0], 400)
    u = []
    for kick in kicks:
        u.append(-20.2 * x[-1] + 0.1 * kick)
        x.append(np.exp(1.0) * x[-1] + (np.exp(1.0) - 1) / 20 * u[-1])
    run = ps.Trajectories.from_arrays([np.array(x[:-1])[:, None]], t=[t], u=[np.array(u)[:, None]])
    return model, ps.Trajectories(tuple(run), ("x",), ("u",))


def test_every_status_has_a_sentence_and_a_picture(certified: Results) -> None:
    """Proved, refuted and undecided pages begin with one sentence, and with the delivered model beside measurements."""
    model, data = unstable()
    noisy = ps.Trajectories(tuple(run.__class__(run.t, run.x + 1e-3, run.u) for run in data), data.states, data.inputs)
    starts = {
        "certified doubtful": certified,
        "refuted": Results(model, ps.certify(model), noisy, None),
        "undecided": Results(model, Undecided(Reason.STALLED), noisy, None),
    }
    for kind, found in starts.items():
        first = front(found)
        (drawing,) = picture(found)
        assert first.kind == kind
        assert first.sentence.endswith(".")
        assert first.title[0].isupper()
        assert "measured (blue, solid)" in drawing.caption
    assert "well it foretells was not measured" in front(certified).doubts[0]


def test_the_picture_of_an_unstable_plant_starts_again(certified: Results) -> None:
    """Where the whole free run blows up the picture shows runs as long as those of the score, and says so."""
    model, data = unstable()
    off = ps.PersidskiiModel([[20.2]], [], [[1.0]], states=["x"], inputs=["u"])
    scores = held_out_scores(off, data, ScoredRecord.of(data))
    assert certified.record is not None
    found = Results(off, ps.certify(model), data, replace(certified.record, scores=scores, fit=None), data)
    assert not scores.headline.whole
    assert f"starts again every {scores.headline.steps} samples" in picture(found)[0].caption


def test_a_point_outside_the_data_is_cautioned_against() -> None:
    """A claim about an equilibrium that the data never came near says so; about one that they hold, it says nothing."""
    model = ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]], b=[-49.0])
    verdict, t = ps.certify(model), np.linspace(0, 1, 50)
    near, far = (
        ps.Trajectories.from_arrays([(centre + np.sin(9 * t))[:, None]], t=[t], u=[np.cos(t)[:, None] - 0.5])
        for centre in (-49.0, 60.0)
    )
    assert isinstance(verdict, Certified)
    where = "the nominal state x* = (-49) lies outside the range of the data"
    assert where not in cautions(verdict, foretold(0.98), near)
    assert where in cautions(verdict, foretold(0.98), far)


@pytest.mark.parametrize(
    ("name", "attempts", "why"),
    [
        ("m_cubes", (), "a state is dropped"),
        ("g_full", (Attempt("rate and gain", "not_found", 0.1),), "none were found"),
        ("g_full", (Attempt("rate and gain", "time", 0.1),), "the time limit was reached"),
        ("g_full", ATTEMPTS, "no time was left"),
        ("g_full", (Attempt("fit, linear start", "certified", 0.1),), "none were asked for"),
        ("e_shifted", (), None),
    ],
)
def test_why_there_is_no_rate(name: str, attempts: tuple[Attempt, ...], why: str | None) -> None:
    """A certificate without rate and gain says in one clause why it has none, in the table and in the report."""
    certificate = ps.load_certificate(VALID / f"{name}.json")
    verdict = Certified(certificate, attempts)
    told = [limit for limit in limits(verdict, certificate.model) if "no number" in limit]
    row = verdict_rows(verdict)[0][1]
    assert ("no rate and gain" in row) == bool(told) == (why is not None)
    assert why is None or (why in told[0] and why in row)


def test_a_refuted_page_shows_the_witness() -> None:
    """A refuted model is drawn with the equilibria that refute it, even where nothing was measured near them."""
    model = ps.PersidskiiModel([[0, 1], [0, -1]], [("sin(x)", [[1, 0]], [[0], [-1]])], domain=[[-1, 1], [-1, 1]])
    text = report.render(Results(model, ps.certify(model), None, None))
    assert re.search(r"the proved equilibria at \(0, 0\) and \(-?3\.142, 0\) \(circles\)", text)
    assert "claim refuted" in text


def test_simulations_under_the_bound_obey_it() -> None:
    """What the page sets against the bound starts with no larger V, is pushed no harder, and stays below it."""
    certificate = ps.load_certificate(VALID / "e_mixed_pair.json")
    t = np.linspace(0, 4, 80)
    run = certificate.model.simulate([1, -1], t, np.tile(np.sin(t)[:, None], (1, 2)))[0]
    others = list(portraits.challengers(certificate, run))
    assert len(others) == portraits.CHALLENGERS
    limit, u = certificate.V(run.x[:1])[0], plots.largest_input(certificate, run)
    for other in others:
        assert 0.5 * limit <= certificate.V(other.x[:1])[0] <= limit
        assert 0.9 * u <= plots.largest_input(certificate, other) <= u
        distance = np.linalg.norm(other.x - certificate.operating_point, axis=1)
        assert (distance <= certificate.bound(run.x[0], u, other.t - other.t[0])).all()


@pytest.mark.slow
def test_fifty_states_and_many_samples_stay_readable() -> None:
    """A page of 50 noisy states and 100,000 samples stays below 3 MB and says how much of them is drawn."""
    n, count = 50, 25_000
    rng, t = np.random.default_rng(0), np.arange(count) * 0.01
    terms = [(f, None, -np.eye(n) + 0.01 * rng.normal(size=(n, n))) for f in ("tanh(x)", "arctan(x)")]
    model = ps.PersidskiiModel(-np.eye(n), terms, rng.normal(size=(n, 2)))
    x, u = [rng.normal(size=(count, n)) for _ in range(4)], np.column_stack([np.sin(t), np.cos(t)])
    data = ps.Trajectories.from_arrays(x, [u] * 4, t=[t] * 4)
    text = report.render(Results(model, Undecided(Reason.STALLED), data, None))
    assert len(text.encode()) < 3e6
    for words in ("first 3 of 4 runs", "first 8 of 50 states", "of 50 equations", "24 of 52 columns", "5000 samples"):
        assert words in text
    assert Outline(text).tags.count("figure") < 14


def test_colours_can_be_read() -> None:
    """Text and lines stand out from their ground as WCAG 2 asks (4.5 for text, 3 for figures), light and dark."""
    css = (Path(report.__file__).parent / "templates" / "report.css").read_text(encoding="utf-8")
    blocks = re.findall(r"--page:.*?}", css, re.DOTALL)
    assert len(blocks) == 3
    for block in blocks:
        colors = {name: luminance(color) for name, color in re.findall(r"--(\w+): (#[0-9a-f]+)", block)}
        for name in ("text", "soft", "good", "open", "bad", "measured", "model", "level", "form", "field"):
            least = 4.5 if name in ("text", "soft", "good", "open", "bad", "measured") else 3
            for ground in ("card", "code") if name == "text" else ("card",):
                high, low = sorted((colors[name], colors[ground]), reverse=True)
                assert (high + 0.05) / (low + 0.05) >= least, (name, ground)


def luminance(color: str) -> float:
    """Return the relative luminance of a colour such as #1b1f24 (WCAG 2)."""
    digits = color[1:] if len(color) == 7 else "".join(2 * d for d in color[1:4])
    parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


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
@pytest.mark.long
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
    assert ("the certified region (shaded)" in text) == (certificate.claim == "region")
    assert ("Rate, 1/s" in text) == (certificate.claim in ("rate-and-gain", "region"))


def test_files_of_a_report(delivered: Path) -> None:
    """The figures are written beside the page, as files of their own."""
    names = {path.name for path in (delivered / "figures").iterdir()}
    assert {
        "overview.png", "free-run-1.png", "residuals.png", "level-sets-1-2.png", "sector-forms.png",
        "contributions.png", "correlations.png",
    } <= names  # fmt: skip


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


def test_evidence_stands_beside_undecided_and_is_kept(tmp_path: Path) -> None:
    """A simulated divergence is told and drawn beside an undecided verdict, is no part of it, and is kept in files."""
    model = ps.PersidskiiModel([[-1, 0], [0, -1]], [("x**3", None, [[1, 0], [0, 0]])], domain=[[-2, 2], [-1, 1]])
    verdict = Undecided(Reason.STALLED, "", ATTEMPTS, None, Evidence(8, 3, (2.0, 1.0), 0.125))
    model.save(tmp_path / layout.MODEL)
    write_verdict(tmp_path, verdict, model)
    Record("persid run", (), {}, None, ATTEMPTS, {}).save(tmp_path)
    found = read_results(tmp_path)
    assert found.verdict.evidence == verdict.evidence
    text = report.render(found)
    assert "3 of 8 runs diverged" in text
    assert "a simulated run that diverges (orange, dashed, from the cross)" in text
    headline = re.search(r'class="headline">([^<]*)', text)
    assert headline
    assert "diverge" not in headline[1]


def test_sparse_models_have_a_page() -> None:
    """A small network with sparse matrices and a claim about a weighted sum has a page with its own hash."""
    eye = csc_array(np.eye(3))
    model = ps.PersidskiiModel(-2 * eye, [("tanh(x)", None, -1 * eye)], csc_array(np.ones((3, 1))))
    verdict = ps.certify(model)
    text = report.render(Results(model, verdict, measured(model.dense()), None))
    assert verdict.is_certified
    assert "claim L1" in text
    assert model.sha256 in text


def test_a_point_outside_the_data_is_said_whatever_the_verdict() -> None:
    """A refutation and an undecided question about a state or an input that never occurs say so, too."""
    data = ps.Trajectories.from_arrays(np.linspace(3, 4, 50)[:, None], np.linspace(1, 2, 50), dt=0.1)
    for u_ref, named in (([0.0], ["state x* = (0)", "input u* = (0)"]), ([1.5], ["state x* = (0)"])):
        model = ps.PersidskiiModel([[1.0]], B=[[1.0]], u_ref=u_ref)
        refuted = ps.certify(model)
        assert isinstance(refuted, ps.Refuted)
        said = [f"the nominal {one} lies outside the range of the data" for one in named]
        assert list(cautions(refuted, None, data)) == said
        assert list(cautions(Undecided(Reason.STALLED), None, data, model)) == said


def test_a_typical_input_occurs() -> None:
    """Where 0 lies outside the range of an input, the nominal one is a value inside it, and nothing is said."""
    rng = np.random.default_rng(0)
    u = np.where(rng.random(400) < 0.5, 3.0, 4.0)
    x = [3.5]
    for k in range(399):
        x.append(u[k] + (x[-1] - u[k]) * np.exp(-0.05))
    data = ps.Trajectories.from_arrays(np.array(x)[:, None], u, dt=0.05)
    model = ps.PersidskiiIdentifier(["x"], ridge=1e-6).fit(data).model_
    assert 3 <= model.u_ref[0] <= 4
    verdict = ps.certify(model)
    assert cautions(verdict, None, data, model) == ()
    assert verdict.certificate.operating_point[0] == pytest.approx(model.u_ref[0], rel=0.01)


def test_the_page_counts_in_the_unit_of_time_that_was_asked_for(tmp_path: Path) -> None:
    """Axes and rates of a page follow --time-unit, with round numbers as ticks; the record keeps the unit."""
    model = ps.PersidskiiModel([[-1e-4]], [], [[1e-4]])
    t = 60.0 * np.arange(600)
    data = ps.Trajectories.from_arrays([model.simulate([1.0], t, np.ones((600, 1)))[0].x], t=[t], u=[np.ones((600, 1))])
    record = Record("persid run data.csv -o out", (), {}, None, ATTEMPTS, versions(), time_unit="h")
    verdict = ps.certify(model)
    assert isinstance(verdict, Certified)
    shown = Results(model, verdict, data, record)
    page = report.render(shown)
    assert "<dt>Rate, 1/h</dt>" in page
    assert f"<dd>{pace(verdict.certificate.rate, 'h')}</dd>" in page
    assert "t in s" not in page
    drawn = report._drawings(shown, [])
    ax = drawn["overview"][0].figure.axes[-1]
    assert ax.get_xlabel() == "t in h"
    ax.figure.canvas.draw()
    labels = {label.get_text() for label in ax.get_xticklabels()}
    assert {"2", "4", "6", "8"} <= labels
    record.save(tmp_path)
    again = Record.load(tmp_path)
    assert again is not None
    assert again.time_unit == "h"
