"""Regions of models with algebraic variables: every forged ledger is refused in the way that is due."""

import copy
import json
from contextlib import suppress
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest

import persid as ps
from checker.ledgers import data
from descriptors import fold
from persid.certificates.facts import proved
from persid.certificates.ledger import with_proof
from persid.errors import RoundingError
from persid.lyapunov.frame import Frame, Strip
from persid.lyapunov.points import points_of
from persid.lyapunov.proposals import feasible
from persid.lyapunov.solvability import solved
from persid.verdicts.facts import About, certificate_of
from persid.verdicts.log import Log
from persid_check import Accepted, FormatError, Malformed, Rejected, check, model_sha256, words
from persid_check.model import model_of
from persid_check.reading import Ball
from persid_check.results import NotProvedError

Content = dict[str, Any]
ONE, ZERO = [1, 0], [0, 0]
ONE_HALF = Fraction(1, 2)


SUM: tuple[Strip, ...] = (({0: Fraction(1), 1: Fraction(1)}, Fraction(-3, 2), Fraction(3, 2)),)  # |x + w| < 3/2


@cache
def _written(strips: tuple[tuple[Any, ...], ...] = ()) -> str:
    """A region of the fold on a strip of w, with more strips whose rows are pairs."""
    model, log = fold(), Log(60.0, lambda line: None)
    points = tuple(proved(point.on((-0.5, 0.5))) for point in points_of(model.rows, None))
    sides = tuple((dict(row), lo, hi) for row, lo, hi in strips)
    frame = solved(Frame(model_of(model.canonical, algebraic=True), points, False, strips=sides), log.left)
    assert frame is not None
    candidate = feasible(frame, Fraction(1, 4), log.left, across=False)
    assert candidate is not None
    found = certificate_of(About(model, None, model.jacobian(np.zeros(2))), candidate, False, log)
    assert isinstance(found, ps.Certificate), found
    return json.dumps(found.content)


def _content(strips: tuple[Strip, ...] = ()) -> Content:
    return dict(json.loads(_written(tuple((tuple(row.items()), lo, hi) for row, lo, hi in strips))))


def exact(pair: list[int]) -> Fraction:
    """The number m 2^e."""
    return Fraction(pair[0]) * Fraction(2) ** pair[1]


def _with(content: Content, path: tuple[Any, ...], value: Any) -> Content:
    """The content with one place set; its hash fits, and where factors can be made for it they are."""
    content = copy.deepcopy(content)
    at: Any = content
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    with suppress(FormatError):
        content["model_sha256"] = model_sha256(content["model"])
    with suppress(RoundingError, FormatError, NotProvedError):
        content = with_proof(content)
    return content


def test_the_ledger_that_is_forged_is_a_good_one() -> None:
    """It is accepted, and says in which strips the equations have one solution."""
    answer = check(data(_content()))
    assert isinstance(answer, Accepted), answer
    assert "they have exactly one solution with -0.5 <= ('w' - 'w'*) <= 0.5" in answer.statement
    assert any("stays on its domain" in step for step in answer.steps)


def test_the_branch_is_named_before_a_set_is_called_invariant() -> None:
    """At x = 0 another solution is w = 1, where x' = 1: no text that ends before the strips speaks of a set."""
    assert np.allclose(fold().solve([0.0], near=[0.9]), 1)
    first, second = check(data(_content())).statement.split(" they have exactly one solution with ")
    assert "in a region, with the solution of its equations that is named below, input-to-state stable" in first
    assert "invariant" not in first
    strip, rest = second.split(", which depends on x and u continuously. ")
    assert strip == "-0.5 <= ('w' - 'w'*) <= 0.5"
    assert rest.startswith("This one is meant, of others nothing is said: with it the set of these x is invariant")


def test_the_place_of_algebraic_variables_is_named() -> None:
    """Strips speak of w less its place at rest: in the operating point, a ball, or in x_ref."""
    statement = check(data(_with(_content(), ("model", "x_ref"), [(0.25).hex(), (0.5).hex()]))).statement
    assert "stable about (x*, 'w'*) = x_ref = (0.25, 0.5) for u* = u_ref = (0)." in statement
    assert words.equilibrium(Ball((ONE_HALF, ONE_HALF), Fraction(0), ()), "(x*, 'w'*)").startswith(
        "the one equilibrium (x*, 'w'*) = (0.5, 0.5) exactly"
    )


def test_no_form_is_proved_beyond_the_fold() -> None:
    """On a strip that holds w^2 = 1/3 nothing shows that the equation has one solution."""
    model, log = fold(), Log(60.0, lambda line: None)
    points = tuple(proved(point.on((-0.6, 0.6))) for point in points_of(model.rows, None))
    assert solved(Frame(model_of(model.canonical, algebraic=True), points, False), log.left) is None


BOUND = ("algebraic", "bounds", 0)
WIDE = [[-5, -3], [5, -3]]  # -5/8 and 5/8, beyond the fold
FORGED: dict[str, tuple[type, tuple[Any, ...], Any]] = {
    "no_bounds": (Rejected, ("algebraic", "bounds"), []),
    "bounds_left_out": (Malformed, ("algebraic",), {"solvable": None, "equations": []}),
    "alpha_of_nothing": (Rejected, (*BOUND, "alpha"), ZERO),
    "alpha_a_little_less": (Rejected, (*BOUND, "alpha"), "half"),
    "alpha_below_0": (Malformed, (*BOUND, "alpha"), [-1, 0]),
    "beta_below_0": (Malformed, (*BOUND, "beta"), [-1, 0]),
    "no_equation_in_the_bound": (Rejected, (*BOUND, "equations"), [[]]),
    "no_facts_in_the_bound": (Rejected, (*BOUND, "value"), []),
    "facts_too_large": (Rejected, (*BOUND, "value", 0, 3), [1, 20]),
    "no_factor_can_be_made": (Rejected, ("algebraic", "equations"), [[]]),
    "domain_beyond_the_fold": (Rejected, ("curves", 0, "domain"), WIDE),
    "no_domain": (Rejected, ("curves", 0, "domain"), None),
    "level": (Rejected, ("level",), [1, 8]),
    "input_bound": (Rejected, ("input_bound",), [1, 8]),
    "strip_of_an_algebraic_variable": (Rejected, ("strips",), [[[[1, ONE]], [-1, 0], ONE]]),
    "channel_that_stands_twice": (Rejected, ("points",), "twice"),
    "point_with_another_row": (Rejected, ("points", 0, "row"), [[0, ONE]]),
    "density_that_reads_it": (Rejected, ("points", 0, "densities"), [[0, ONE]]),
    "steeper": (Rejected, ("model", "terms", 0, "A", 1, 0), (1.6).hex()),
    "another_equation": (Rejected, ("model", "A0", 1, 0), (3.0).hex()),
    "no_equation": (Rejected, ("model", "A0", 1, 1), (0.1).hex()),
    "unstable": (Rejected, ("model", "A0", 0, 0), (1.0).hex()),
    "rate_and_gain": (Malformed, ("claim",), "rate-and-gain"),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_ledger_is_refused(name: str) -> None:
    """As malformed where the format forbids it, else as not proved, even with factors made for it."""
    expected, path, value = FORGED[name]
    content = _content()
    if value == "half":
        m, e = content["algebraic"]["bounds"][0]["alpha"]
        value = [m, e - 1]
    if value == "twice":
        value = [*content["points"], {**content["points"][0], "densities": []}]
    answer = check(data(_with(content, path, value)))
    assert isinstance(answer, expected), answer


def test_a_strip_of_an_algebraic_variable_has_a_bound_of_its_own() -> None:
    """With |x + w| <= 3/2 beside |w| <= 1/2 there are two bounds, and the sentence names both strips."""
    content = _content(SUM)
    answer = check(data(content))
    assert isinstance(answer, Accepted), answer
    assert len(content["algebraic"]["bounds"]) == 2
    assert "-0.5 <= ('w' - 'w'*) <= 0.5 and -1.5 <= (x1 - x1*) + ('w' - 'w'*) <= 1.5" in answer.statement


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("strips",), [[[[0, ONE], [1, ONE]], [-1, -2], [3, -1]]]),  # narrower than what is proved
        (("strips",), [[[[0, ONE], [1, ONE]], [-3, -1], [1, -2]]]),
        (("strips",), [[[[0, ONE], [1, ONE]], [3, -1], [3, 0]]]),  # not about the equilibrium, though h^2 is the same
        (("strips",), [[[[0, ONE], [1, ONE]], [-3, 0], [-3, -1]]]),
        (("strips",), [[[[0, ONE], [1, [1, 3]]], [-3, -1], [3, -1]]]),  # another row
        (("strips",), [[[[0, ONE], [1, ONE]], [-3, -1], [3, -1]]] * 2),  # more strips than bounds
        (("algebraic", "bounds", 1, "alpha"), [1, -9]),
        (("algebraic", "bounds", 1, "equations"), [[]]),
        (("level",), [1, 8]),
    ],
)
def test_a_forged_strip_of_an_algebraic_variable_is_refused(path: tuple[Any, ...], value: Any) -> None:
    """Whatever stands in place of the strip, or of its bound."""
    assert isinstance(check(data(_with(_content(SUM), path, value))), Rejected)


def test_a_bound_of_no_strip_is_refused() -> None:
    """There are as many bounds as strips that read algebraic variables."""
    assert isinstance(check(data({**_content(SUM), "strips": []})), Rejected)


def test_one_signed_facts_do_not_go_on_along_chords() -> None:
    """What is one-signed on a domain may not be so beyond: such facts are refused of rows with algebraic variables."""
    content = _content()
    forms = content["curves"][0]["forms"]
    cuts = content["curves"][0]["continuous"]
    forms.append({**forms[0], "l": [ZERO, ZERO], "is": "one-signed", "cuts": cuts, "upper": None, "lower": None})
    assert isinstance(check(data(with_proof(content))), Accepted)
    k = len(forms) - 1
    content["facts"]["one_signed"] = [[0, k, 0, k, ONE]]
    answer = check(data(with_proof(content)))
    assert isinstance(answer, Rejected)
    assert "one form or a difference" in answer.why


def test_an_argument_may_reach_just_what_its_strip_allows() -> None:
    """The level is within 2 % of what the bound allows; a level 3 % larger is refused."""
    content = _content()
    h, level, most = map(exact, (content["curves"][0]["domain"][1], content["level"], content["input_bound"]))
    alpha, beta = (exact(content["algebraic"]["bounds"][0][k]) for k in ("alpha", "beta"))
    assert 0.98 * h**2 < alpha * level + beta * most**2 <= h**2
    m, e = content["level"]
    assert isinstance(check(data(_with(content, ("level",), [33 * m, e - 5]))), Rejected)
