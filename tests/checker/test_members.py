"""Sets of models: what is said of every model with coefficients within a deviation, and when it is not said."""

import copy
import json
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import fsolve

import persid as ps
from checker import known_ledgers
from checker.ledgers import data
from checker.test_deviations import FORGED
from persid.certificates.ledger import with_proof
from persid.lyapunov.deviations import Deviation
from persid.verdicts.members import certified_members
from persid_check import Accepted, Rejected, check
from persid_check.ledger.file import read_ledger
from persid_check.ledger.further import holds_of_members

MODEL = ps.PersidskiiModel(
    [[-1.0, 0.5], [-0.5, -1.0]], [("tanh(x)", None, [[-0.5, 0.1], [0.0, -0.5]])], [[1.0], [0.5]], b=[0.3, 0.1]
)


@cache
def _certified() -> tuple[ps.Certificate, tuple[Deviation, ...]]:
    """The certificate of the models within the largest multiple of two ellipsoids, and that multiple of them."""
    rng = np.random.default_rng(0)
    rows = tuple(Deviation.of_row(i, 2, X.T @ X) for i, X in enumerate(0.1 * rng.normal(size=(2, 5, 5))))
    verdict = ps.certify(MODEL)
    assert isinstance(verdict, ps.Certified)
    rho, certificate = certified_members(verdict.margin.certificate, rows)
    return certificate, tuple(row.times(rho) for row in rows)


def _V(certificate: ps.Certificate, x: np.ndarray, rest: np.ndarray) -> float:
    """V about any point of rest: x'P x and integrals of the forms of V, by quadrature."""
    d = x - rest
    total = float(d @ certificate.P @ d)
    for part in certificate.stated.parts:
        row = np.array([float(part.row.get(i, 0)) for i in range(2)])
        alphas, density = [float(alpha) for _, alpha in part.members], [float(value) for value in part.density]

        def form(s: float, at: float, density: list[float] = density, alphas: list[float] = alphas) -> float:
            rises = (np.tanh(a * (at + s)) - np.tanh(a * at) for a in alphas)
            return 0.0 * density[0] * s + sum(w * rise for w, rise in zip(density[1:], rises, strict=True))

        y = float(row @ d)
        total += density[0] * y**2 + 2 * quad(form, 0.0, y, args=(float(row @ rest),))[0]
    return total


def test_no_member_leaves_its_bound() -> None:
    """Of 50 models on the faces of the ellipsoids, with any constant, none leaves the bound about where it rests."""
    certificate, rows = _certified()
    rng, p, count, h = np.random.default_rng(2), float(certificate.stated.p), 50, 0.04
    heights = [rng.normal(size=(count, len(row.C))) for row in rows]
    faces = [
        each / np.linalg.norm(each, axis=1, keepdims=True) @ row.C for each, row in zip(heights, rows, strict=True)
    ]
    D = np.stack(faces, axis=1)
    e, u, push = rng.normal(0, 2, (count, 2)), rng.normal(0, 2, (count, 1)), rng.uniform(0, 1, (count, 1))

    def F(x: np.ndarray, u: np.ndarray, k: object = slice(None)) -> np.ndarray:
        return MODEL.rhs(x, u) + np.einsum("kij,kj->ki", D[k], np.hstack([x, np.tanh(x), u])) + e[k]

    rest = np.array([fsolve(lambda x, k=k: F(x[None], u[k, None], [k])[0], np.zeros(2)) for k in range(count)])
    assert np.abs(F(rest, u)).max() < 1e-6
    x = rest + rng.normal(0, 3, (count, 2))
    start = np.sqrt([_V(certificate, *pair) / p for pair in zip(x, rest, strict=True)])
    closest = 0.0
    for k in range(1, 301):
        v = u + push * np.sign(np.sin(k * h))
        a = F(x, v)
        b = F(x + h / 2 * a, v)
        c = F(x + h / 2 * b, v)
        x = x + h / 6 * (a + 2 * b + 2 * c + F(x + h * c, v))
        bound = start * np.exp(-certificate.rate * k * h) + certificate.gain * push[:, 0]
        closest = max(closest, float((np.linalg.norm(x - rest, axis=1) / bound).max()))
    assert 0.3 < closest <= 1  # the bound is not empty talk


def test_members_beyond_the_set_may_be_unstable() -> None:
    """The set is not certified for nothing: at three times its size it holds a model that grows without bound."""
    _, rows = _certified()
    worst = -np.inf
    for heights in np.random.default_rng(4).normal(size=(4000, 2, 5)):
        D = np.array([row.C.T @ (h / np.linalg.norm(h)) for row, h in zip(rows, heights, strict=True)])
        worst = max(
            worst, float(np.linalg.eigvals(MODEL.jacobian(np.zeros(2)) + 3 * (D[:, :2] + D[:, 2:4])).real.max())
        )
    assert worst > 0


def _doubled(deviation: dict[str, list]) -> None:
    for row in deviation["C"]:
        row[:] = [[i, [m, e + 1]] for i, (m, e) in row]


def _longest(deviation: dict[str, list]) -> None:
    entry = max(
        (entry for row in deviation["C"] for entry in row), key=lambda entry: abs(entry[1][0]) * 2.0 ** entry[1][1]
    )
    entry[1] = [entry[1][0], entry[1][1] + 1]


FORGERIES = {
    "C is twice as large": _doubled,
    "C is larger in one entry": _longest,
    "L has lost its column": lambda deviation: deviation.update(columns=[]),
    **{name: FORGED[name] for name in FORGED if name.startswith(("s is", "a column", "L gets"))},
}


@pytest.mark.parametrize("name", FORGERIES)
def test_forged_sets_are_rejected(name: str) -> None:
    """A certificate of models does not survive a larger set, or one without its proof."""
    content = json.loads(_certified()[0].data)
    assert isinstance(check(data(content)), Accepted)
    FORGERIES[name](content["deviations"][0])
    assert isinstance(check(data(content)), Rejected)


def test_without_rising_forms_nothing_is_said_of_members() -> None:
    """x + 2 sin x is a sector and falls somewhere: with a constant such a model rests at several places."""
    model = ps.PersidskiiModel([[-0.1]], [("x + 2*sin(x)", None, [[-1.0]])], [[1.0]])
    slopes = model.rhs(np.linspace(0, 10, 1001)[:, None], np.full((1001, 1), 3.5))[:, 0]
    assert (np.diff(np.sign(slopes)) != 0).sum() == 3
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Certified)
    answer = check(verdict.margin.certificate.data)
    assert "members" not in answer.further
    assert "exactly one" not in answer.statement
    assert certified_members(verdict.margin.certificate, (Deviation.of_row(0, 1, 1e-6 * np.eye(3)),)) is None


def test_where_the_proof_knows_its_centre_nothing_is_said_of_members() -> None:
    """A region, and forms that are sectors about their centre, leave the sentence out."""
    content = json.loads(_certified()[0].data)
    assert check(data(content)).further == ("members",)
    ledger = read_ledger(content)
    forms = [[replace(form, kind="sector") for form in curve.forms] for curve in ledger.curves]
    curves = tuple(replace(curve, forms=tuple(own)) for curve, own in zip(ledger.curves, forms, strict=True))
    assert holds_of_members(ledger, (0, 1))
    assert not holds_of_members(ledger, (0,))
    assert not holds_of_members(replace(ledger, curves=curves), (0, 1))
    region = ps.certify(MODEL, domain=[[-2.0, 2.0], [-2.0, 2.0]])
    assert isinstance(region, ps.Certified)
    assert region.margin.certificate.further == ()


def test_facts_about_a_dropped_entry_and_slopes_say_nothing_of_members() -> None:
    """Of the hardening spring, whose cube is dropped, members are spoken of while no C reads the cube."""
    content = copy.deepcopy(known_ledgers.load("spring"))
    speed = {"columns": [[[1, [1, 0]]]], "C": [[[1, [1, -6]]]], "s": [1, 1], "epsilon": [0, 0]}
    written = with_proof(content | {"deviations": [speed]})
    said = check(data(written))
    assert isinstance(said, Accepted)
    ledger = read_ledger(written)
    kept = tuple(i for i in range(ledger.entries) if i not in ledger.dropped)
    reading = replace(ledger, deviations=(replace(ledger.deviations[0], C=({2: Fraction(1)},)),))
    assert holds_of_members(ledger, kept) == ("members" in said.further)
    assert not holds_of_members(reading, kept)
