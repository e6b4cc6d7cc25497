"""Tables for notebooks: one table each, with the figures that matter, whatever the names."""

from html.parser import HTMLParser

import numpy as np
import pytest
from scipy.sparse import csc_array

import persid as ps
from persid.verdicts.verdict import Attempt, Certified, Reason, Undecided
from places import VALID

KNOWN = {"table", "caption", "thead", "tbody", "tr", "th", "td"}


class Tags(HTMLParser):
    """Reads the tags of a text and whether each is closed in its place."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take note of one tag."""
        self.names.append(tag)
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Close the tag that was opened last."""
        assert self.open.pop() == tag


def read(text: str) -> Tags:
    """Return the tags of a table, which must be nothing else."""
    found = Tags(text)
    assert not found.open
    assert found.names.count("table") == 1
    assert set(found.names) <= KNOWN
    return found


def test_a_model_shows_its_coefficients() -> None:
    """A small model is a table of coefficients, a term a row, rows of zeros left out."""
    model = ps.PersidskiiModel([[-1.25, 0], [0.5, -2]], [("tanh(x)", [[0.5, 0]], [[-1], [0]])], states=["<b>", "y"])
    text = model._repr_html_()
    read(text)
    assert "-1.25" in text
    assert "tanh(&lt;b&gt;/2)" in text
    assert "constant" not in text


def test_a_large_model_is_summed_up() -> None:
    """A model of many states lists its names and functions, not its numbers."""
    n = 60
    text = ps.PersidskiiModel(-np.eye(n), [("x**3", None, -np.eye(n))])._repr_html_()
    read(text)
    assert len(text) < 1500
    assert all(part in text for part in ("60 states", "x**3", "x60", "…"))


@pytest.mark.parametrize("name", ["g_full", "m_cubes", "e_shifted", "r_pendulum"])
def test_certificates_show_their_claim(name: str) -> None:
    """A certificate shows claim and statement, and rate and gain where it has them."""
    certificate = ps.load_certificate(VALID / f"{name}.json")
    text = certificate._repr_html_()
    read(text)
    assert certificate.scope in text
    assert ("rate, 1/s" in text) == (certificate.rate is not None)


def test_certificates_of_networks_show_their_claim() -> None:
    """A certificate of claim L1 shows the same figures."""
    model = ps.PersidskiiModel(csc_array([[-2.0, 1.0], [1.0, -2.0]]), [], csc_array([[1.0], [0.0]]))
    certificate = ps.certify(model).certificate  # type: ignore[union-attr]
    assert isinstance(certificate, ps.NetworkCertificate)
    text = certificate._repr_html_()
    read(text)
    assert all(part in text for part in ("L1", "global", "rate, 1/s", "gain"))


def test_verdicts_show_what_was_tried() -> None:
    """Every kind of verdict shows its sentence and its attempts."""
    attempts = (Attempt("a region", "not_found", 0.25),)
    certified = Certified(ps.load_certificate(VALID / "e_shifted.json"), attempts)
    undecided = Undecided(Reason.STALLED, "<i>", attempts)
    refuted = ps.certify(ps.PersidskiiModel([[1.0]]))
    for verdict, word in ((certified, "Certified: "), (undecided, "Undecided: "), (refuted, "Refuted: ")):
        text = verdict._repr_html_()
        read(text)
        assert word in text
    assert "not found, 0.25 s" in undecided._repr_html_()
