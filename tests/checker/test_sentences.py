"""Every sentence that the checker prints, each with an example at the edge of what it says."""

import ast
import copy
import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

import persid as ps
from checker import known_ledgers, named
from checker.known_steps import steps_model
from checker.maker import Wanted, data, dyadic, file, make, model
from checker.test_algebraic import _content as with_equations
from checker.test_algebraic_regions import _content as fold_region
from checker.test_network import file as network_file
from checker.test_network import model as network_model
from descriptors import loop
from persid_check import Accepted, Rejected, canonical_model, check, model_sha256, words
from persid_check.ledger import sentences as of_ledgers
from persid_check.networks import sentences as of_networks
from persid_check.refutations import sentences as of_refutations
from persid_check.version_1 import sentences as of_version_1

HALF = Fraction(1, 2)
KINDS = ast.FunctionDef | ast.ClassDef | ast.Module  # what has a docstring


def region(*, b: float, radius: Fraction, level: Fraction, ubar: Fraction, side: float = 1.0) -> dict[str, Any]:
    """x' = -x + b + u about its equilibrium b, known up to `radius` about 0: V = d^2, V' <= -V + 5/4 v^2."""
    return file(
        model([], [[-1.0]], b=[b]), "R", operating_point={"x": [[0, 0]], "radius": dyadic(radius), "u": [[0, 0]]},
        P={"diagonal": [[1, 0]]}, groups=[], dropped=[], gamma=[5, -2], kappa=[1, 0], p=[1, -1],
        box=[[dyadic(-side), dyadic(side)]], level=dyadic(level), input_bound=dyadic(ubar),
        proof={"P": [[1]], "Q": [[1], [1, 1]]},
    )  # fmt: skip


def answer(content: dict[str, Any]) -> Any:
    """The checker's answer to an object."""
    return check(data(content))


def said(content: dict[str, Any]) -> str:
    """The statement of an accepted file, behind the model's hash, and its steps."""
    result = answer(content)
    assert isinstance(result, Accepted), result
    return "\n".join([result.statement.split(content["model_sha256"])[-1], *result.steps])


def test_the_set_of_claim_r_is_the_set_that_is_proved_invariant() -> None:
    """With x* = 2/5 in the ball 0 +- 1/2, {x in [-1/2, 1/2] : V <= 31/128} is left at x = 1/2 and is not accepted."""
    forged = region(b=0.4 - 2**-10, radius=HALF, level=Fraction(31, 128), ubar=Fraction(7, 16))
    x_star, edge, v = Fraction(0.4 - 2**-10), HALF, Fraction(7, 16)
    assert (edge - x_star) ** 2 < Fraction(31, 128)
    assert -(edge - x_star) + v > 0
    assert isinstance(answer(forged), Rejected)


def test_a_level_up_to_the_named_box_is_accepted_and_beyond_it_is_not() -> None:
    """About 0 +- 1/8 in [-1, 1] the named box is [-3/4, 3/4] and |d| < 5/8: a level of (5/8)^2 is one too many."""
    eighth, edge = Fraction(1, 8), Fraction(25, 64)
    inside = region(b=0.0625, radius=eighth, level=edge - Fraction(1, 2**30), ubar=HALF)
    assert "in the box [-1, 1] less twice the ball's radius at each side with V(x) <= ~0.390624" in said(inside)
    assert isinstance(answer(region(b=0.0625, radius=eighth, level=edge, ubar=HALF)), Rejected)


def test_the_named_set_is_the_level_set_wherever_the_equilibrium_lies() -> None:
    """For x* anywhere in the ball, |d| <= sqrt(level) of the largest level lies in the box that is named, less x*."""
    for radius, side in ((Fraction(1, 8), 1), (Fraction(1, 4), 2)):
        edge = side - 3 * radius
        for x_star in (-0.9 * float(radius), 0.0, 0.9 * float(radius)):
            given = {"b": x_star, "radius": radius, "ubar": Fraction(1, 16), "side": float(side)}
            text = said(region(level=edge**2 - Fraction(1, 2**30), **given))
            found = re.search(r"in the box \[(\S+), (\S+)\] less twice the ball's radius", text)
            assert found, text
            lo, hi = map(Fraction, found.groups())
            assert lo + 2 * radius <= Fraction(x_star) - edge < Fraction(x_star) + edge <= hi - 2 * radius
            assert isinstance(answer(region(level=edge**2, **given)), Rejected)


def test_an_input_bound_is_admitted_up_to_equality() -> None:
    """gamma ubar^2 <= kappa c: with gamma = 5/4 and ubar = 1/2, c = 5/16 is enough and less is not."""
    enough = {"b": 0.0625, "radius": Fraction(1, 8), "ubar": HALF}
    assert "sup|u - u*| <= 0.5" in said(region(level=Fraction(5, 16), **enough))
    assert isinstance(answer(region(level=Fraction(5, 16) - Fraction(1, 2**40), **enough)), Rejected)


def test_the_ball_of_the_equilibrium_is_named_as_it_is_and_in_every_state() -> None:
    """A radius is not rounded up, where a second equilibrium might lie, and is one of the maximum norm."""
    radius = Fraction(1, 8) + Fraction(1, 2**30)
    text = said(region(b=0.0625, radius=radius, level=Fraction(5, 16), ubar=HALF))
    assert "the one equilibrium x* within ~0.125000 of (0) in every state" in text
    shifted = said(named.load("g_ball"))
    assert "shifted by y* within ~3.63797e-12 of ~1.21341" in shifted


def test_rate_and_gain_are_rounded_to_the_safe_side() -> None:
    """p = 1/2, gamma / (kappa p) = 5/2: the roots are rounded up, and the rate kappa / 2 = 1/2 is exact."""
    text = said(region(b=0.0625, radius=Fraction(1, 8), level=Fraction(5, 16), ubar=HALF))
    assert "|x(t) - x*| <= 1.41422 sqrt(V(x(0))) exp(-0.5 t) + 1.58114 sup|u - u*| for all t >= 0." in text


def test_a_constant_counts_as_an_input_where_nothing_is_shifted() -> None:
    """x' = -x - x^3 + 2 + u about 0: b is an input that the model holds at 1."""
    text = said(named.load("g_constant_input"))
    assert "one more input, b v, which in the model itself is held at v = 1 and not 0" in text


def test_a_rate_that_counts_b_bounds_both_inputs_together() -> None:
    """x' = -x + 2 + u about 0, claim E: the gain is from sup|(u - u*, v)|, and at u = 0 the state goes to 2."""
    counted = make(Wanted(model([], [[-1.0]], b=[2.0]), [], "E", kappa=HALF))
    text = said(counted)
    gain = float(text.split(" sup|(u - u*, v)|")[0].split()[-1])
    assert gain * 1.0 >= 2.0


def test_without_inputs_no_gain_is_named() -> None:
    """x' = -x without inputs: the estimate ends with the exponential."""
    alone = make(Wanted(model([], [[-1.0]], [[]]), [], "E", kappa=HALF))
    text = said(alone)
    assert "t) for all t >= 0." in text
    assert "sup" not in text.splitlines()[0]


def test_each_input_has_its_own_gain() -> None:
    """V = x^2, Gamma just above [[1, 1], [1, 1]]: each gain is the root of 33/32 over 7/8, rounded up."""
    assert "1.08563 sup|u1 - u1*| + 1.08563 sup|u2 - u2*|" in said(named.load("e_gains"))


def test_an_input_is_called_by_its_own_name() -> None:
    """With u2 in the first place its gain is not printed beside the nominal value of the input u1."""
    swapped = named.load("e_gains")
    swapped["model"]["inputs"] = ["u2", "u1"]
    swapped["model_sha256"] = model_sha256(swapped["model"])
    assert "1.08563 sup|'u2' - 'u2'*| + 1.08563 sup|'u1' - 'u1'*|" in said(swapped)


def test_every_equilibrium_needs_every_form_nondecreasing() -> None:
    """x^3 - 3 x^2 + 5/2 x is a sector form that falls in between, at u = 0.55 there are three equilibria: not said."""
    falling = model([("x**3-3*x**2+2.5*x", None, [[-1]])])
    text = said(make(Wanted(falling, [[(1, 0), (0, 1), (Fraction(-3, 16), 1)]])))
    assert "every equilibrium" not in text
    assert "The same holds, with the same numbers, about every equilibrium of every constant input." in said(
        named.load("g_ball")
    )


def test_a_factor_of_an_argument_is_marked_where_it_is_rounded() -> None:
    """The row 1/3 of a second channel is 1/3 of a 64th part off, and the steps say ~."""
    scaled = model([("tanh(x)", [[1.0], [1 / 3]], [[-1.0, -1.0]])], [[-1.0]])
    text = said(make(Wanted(scaled, [[(1, 0, 0), (0, 1, 0), (0, 0, 1)]])))
    assert "tanh(x) at ~0.333333 y" in text


def test_what_is_continuous_nowhere_needed_is_refused_in_obstructions_too() -> None:
    """x' = 2x - 1/x has no certificate, but an obstruction of it is not accepted: its function is not continuous."""
    honest = named.load("infeasible_full")
    assert isinstance(answer(honest), Accepted)
    broken = model([("1/x", None, [[-1]])], [[2]])
    content = file(broken, "infeasible", **{name: honest[name] for name in ("family", "groups", "L", "proof")})
    result = answer(content)
    assert isinstance(result, Rejected)
    assert "continuous" in result.why


def test_however_x_is_spelled_it_is_merged() -> None:
    """(x) and +x are f = x: the model has no channel, and the certificate of x' = -x + u fits."""
    for text in ("x", "(x)", "+x", " ( +x ) "):
        merged = file(
            model([(text, None, [[-2.0]])], [[1.0]]), "G", operating_point=None, P={"diagonal": [[1, 0]]}, groups=[],
            dropped=[], gamma=[2, 0], proof={"P": [[1]], "Q": [[1], [1, 2]]},
        )  # fmt: skip
        assert "channels = 0" in said(merged)


def network(*, every: bool, b: list[float] | None = None, kappa: float = 1.0) -> dict[str, Any]:
    """x1' = -2 x1 - tanh x1 + x2 / 2 + u1, x2' = -2 x2: w = (1, 1)."""
    subject = network_model([[-2.0, 0.5], [0.0, -2.0]], [("tanh(x)", [[1.0, 0.0]], [[-1.0], [0.0]])], [[1.0], [0.0]], b)
    kinds = [([("tanh(x)", 1.0)], [[0.0, 1.0]]), ([], [])]
    return network_file(subject, kinds, [1.0, 1.0], kappa, every=every)


def test_the_sentences_of_networks() -> None:
    """A rate of 3/2 is the most that node 2 allows, with b an input about the reference and none about every point."""
    every = said(network(every=True, kappa=1.5))
    assert "V(x(t) - x*) <= exp(-1.5 t) V(x(0) - x*) + 0.666667 sup|u1 - u1*| for all t >= 0" in every
    assert "exactly one equilibrium" in every
    assert isinstance(answer(network(every=True, kappa=1.5 + 2**-40)), Rejected)
    counted = said(network(every=False, b=[0.0, 3.0]))
    assert "1 sup|u1 - u1*| + 3 sup|v| for all t" in counted
    assert "held at v = 1." in counted


def network_members(kappa: float = 1.25) -> dict[str, Any]:
    """The same with any d in x1' with |d'zeta| <= |x2 + u1| / 4: the second node loses a quarter of its rate."""
    row = [[1, [1, -2]], [3, [1, -2]]]
    return network(every=True, kappa=kappa) | {"deviations": [{"state": 0, "C": [row]}]}


def test_the_sentence_of_members_of_a_network() -> None:
    """A rate of 5/4 is the most, and the input counts 5/4."""
    members = answer(network_members()).statement
    assert members.startswith("Every member of the stated set of models about the model with 2 states")
    assert "V(x(t) - x*) <= exp(-1.25 t) V(x(0) - x*) + 1 sup|u1 - u1*| for all t >= 0" in members
    assert "the equilibria are the member's own" in members
    assert "any two solutions of one member with inputs u and u* satisfy" in members
    assert "any two solutions with inputs u and u* satisfy" in answer(network(every=True)).statement
    assert isinstance(answer(network_members(1.25 + 2**-40)), Rejected)


def no_weights(f: str = "tanh(x)") -> dict[str, Any]:
    """x' = 2 x - f(x) with the ray y: no weight lets |x| decrease."""
    subject = network_model([[2.0]], [(f, None, [[-1.0]])], [[1.0]])
    content = network_file(subject, [([(f, 1.0)], [[0.0, 1.0]])], [1.0], 1.0)
    del content["operating_point"], content["weights"], content["kappa"]
    content["kinds"][0]["rays"] = [[[1, 0], [0, 0]]]
    return content | {"claim": "L1-infeasible", "z": [[1, 0]], "choice": [0]}


def test_no_weights_is_said_of_continuous_functions_alone() -> None:
    """x' = 2 x - tanh x has no weights; of x' = 2 x - 1/x the file says nothing."""
    assert "Sharper forms or other Lyapunov functions are not excluded" in said(no_weights())
    assert isinstance(answer(no_weights("1/x")), Rejected)


def diagonal(n: int, value: float) -> list[list[float]]:
    """A multiple of the identity."""
    return [[value * (i == j) for j in range(n)] for i in range(n)]


def wide() -> dict[str, Any]:
    """Thirteen states, each with its own input and gain, in a box: lists too long to be printed whole."""
    lower = [[int(i == j) for j in range(i + 1)] for i in range(26)]
    return file(
        model([], diagonal(13, -1.0), diagonal(13, 1.0), n=13), "R", groups=[], dropped=[], kappa=[3, -2], p=[1, -1],
        operating_point={"x": [[0, 0]] * 13, "radius": [0, 0], "u": [[0, 0]] * 13}, P={"diagonal": [[1, 0]] * 13},
        gamma={"lower": [[[3 * v, 0] for v in row] for row in lower[:13]]}, proof={"P": lower[:13], "Q": lower},
        box=[[[-1, 0], [1, 0]]] * 13, level=[1, -1], input_bound=[1, -3],
    )  # fmt: skip


def refuted_in_steps(a: float, kind: str, **witness: Any) -> dict[str, Any]:
    """A witness against x+ = a x + u."""
    form = canonical_model(steps_model([], [[a]]))
    return {
        "format": "persid-certificate-1", "claim": "refuted", "statement": "for people", "model": form,
        "model_sha256": model_sha256(form), "u": [[0, 0]],
        "witness": {"kind": kind, "direction": [[1, 0]], **witness},
    }  # fmt: skip


def refuted_with_equations() -> list[dict[str, Any]]:
    """Witnesses against models with algebraic variables: one runs away, one has two solutions, one tells nothing."""
    untold = ps.DescriptorModel([[-1.0, 1.0], [1.0, 0.0]], [], [[0.0], [1.0]], algebraic=["w"])
    verdicts = map(ps.certify, (loop(1.01), loop(2.0), untold))
    return [verdict.witness.content for verdict in verdicts if isinstance(verdict, ps.Refuted)]


def corpus() -> str:
    """All that accepted files print: the kept certificates and those of this file."""
    long = model([("tanh(x)", [[1.0] * 13], [[0.0]] * 13)], diagonal(13, -1.0), [[0.0]] * 13, n=13)
    scaled = model([("tanh(x)", [[1.0], [1 / 3]], [[-1.0, -1.0]])], [[-1.0]])
    found = [
        *(named.load(name) for name in sorted(named.MAKERS)),
        region(b=0.0625, radius=Fraction(1, 8), level=Fraction(5, 16), ubar=HALF),
        network(every=True),
        network(every=False, b=[0.0, 3.0]),
        network_members(),
        no_weights(),
        wide(),
        make(Wanted(model([], [[-1.0]], b=[2.0]), [], "E", kappa=HALF)),
        make(Wanted(long, [[(1, 0)]], dropped=(13,))),
        make(Wanted(scaled, [[(1, 0, 0), (0, 1, 0), (0, 0, 1)]])),
        refuted_in_steps(1.0, "marginal-direction"),
        refuted_in_steps(-2.0, "unstable-linear-part", S=[[[1, 0]]], sigma=[1, 0], T=[[1]]),
        refuted_in_steps(
            -2.0, "unstable-equilibrium", S=[[[1, 0]]], sigma=[1, 0], T=[[1]], point={"x": [[0, 0]], "radius": [0, 0]}
        ),
        named.load("infeasible_full") | {"family": "diagonal", "proof": {}},
        *refuted_with_equations(),
    ]
    return "\n".join([*("The model with " + said(content) for content in found), answer(network_members()).statement])


def ledgers_corpus() -> str:
    """All that accepted ledgers print: the known ones, with equations, and a region of more strips than are printed."""
    many = copy.deepcopy(known_ledgers.load("region"))
    many["strips"] += [[[[0, [1, 0]]], [-9, 0], [9, 0]]] * 13
    found = [*map(known_ledgers.load, known_ledgers.NAMES), many, with_equations(), fold_region()]
    return "\n".join(line for result in map(answer, found) for line in (result.statement, *result.steps))


@pytest.mark.parametrize(
    "module", [words, of_version_1, of_networks, of_refutations, of_ledgers], ids=lambda module: module.__name__
)
def test_every_text_of_the_sentences_is_printed_by_an_example(module) -> None:
    """Each piece of text in the modules that word the sentences stands in what these examples print."""
    nodes = list(ast.walk(ast.parse(Path(module.__file__).read_text())))
    docs = {ast.get_docstring(node, clean=False) for node in nodes if isinstance(node, KINDS)}
    texts = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    printed = (corpus() if module is not of_ledgers else ledgers_corpus()).lower()
    assert not [text for text in texts - docs if len(text.split()) > 2 and text.lower() not in printed]
