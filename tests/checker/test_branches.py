"""Refusals that no other test of the checker reaches, one by one: each with the place that it names."""

import hashlib
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_series, fmpq

from checker import named
from checker.maker import data, model
from checker.test_hostile import SPARSE
from checker.test_network_attacks import TANH, N, Network, columns, dyadic, packed
from checker.test_outputs import plain
from persid.lyapunov.operating_points import proved_radius
from persid_check import (
    Accepted,
    Malformed,
    Rejected,
    canonical_model,
    check,
    companion,
    exact,
    flint_matrix,
    model_sha256,
)
from persid_check.__main__ import main
from persid_check.canonical import canonical_outputs, output_sha256
from persid_check.enclosure import Interval, UndefinedError, constant
from persid_check.equilibrium import has_unique_equilibrium
from persid_check.expansion import CONSTANT, Expansion, Horizon
from persid_check.expression import ExpressionError, parse
from persid_check.json_text import MAX_LISTS, read
from persid_check.model import model_of
from persid_check.networks import certificate as network_file
from persid_check.networks import cone, nodes, table
from persid_check.networks.cone import generators
from persid_check.refutations import format as refuted
from persid_check.results import FormatError, NotProvedError
from persid_check.search import prover
from persid_check.search.side import as_interval
from persid_check.taylor import power_series
from persid_check.version_1 import claims, conclusions
from persid_check.version_1 import format as format_1

POLE = ((parse("1/x"), Fraction(1)),)
COSINE = ((parse("cos(x)"), Fraction(1)),)
TANH_CURVE = ((parse("tanh(x)"), Fraction(1)),)
BESIDE = (Fraction(1), Fraction(2))  # a domain without 0


@pytest.mark.parametrize(
    ("entry", "where"),
    [
        ({"npz": "c.npz"}, "a file name"),
        ({"npz": "c.npz", "sha256": "0" * 64}, "another SHA-256"),
        ({"npz": "none.npz", "sha256": "0" * 64}, "cannot be read"),
    ],
)
def test_a_companion_that_is_not_the_one_named_is_refused(entry: dict[str, str], where: str, tmp_path: Path) -> None:
    """A companion has a name and a hash, is there, and has that hash."""
    (tmp_path / "c.npz").write_bytes(packed({"w": np.ones(2)}))
    with pytest.raises(FormatError, match=where):
        companion.load(entry, "companion", tmp_path)


def test_a_companion_is_read_from_beside_the_file(tmp_path: Path) -> None:
    """Arrays of a matrix come from the companion that it names, and one that is not in there is refused."""
    content = packed(columns("A0", [(0, 0, -1.0)], 1))
    (tmp_path / "m.npz").write_bytes(content)
    named_array = {"shape": [1, 1], "npz": "m.npz", "sha256": hashlib.sha256(content).hexdigest(), "name": "A0"}
    read = canonical_model({**SPARSE, "A0": named_array}, tmp_path)
    assert read == canonical_model(SPARSE)
    with pytest.raises(FormatError, match="has no array"):
        canonical_model({**SPARSE, "A0": {**named_array, "name": "A1"}}, tmp_path)


def test_companions_are_small(tmp_path: Path) -> None:
    """A companion of too many bytes or too many arrays is not read."""
    content = packed({f"w{k}": np.ones(1) for k in range(companion.MAX_MEMBERS + 1)})
    with pytest.raises(FormatError, match="arrays"):
        companion.read(content, "companion")
    (tmp_path / "c.npz").write_bytes(content)
    with pytest.raises(FormatError, match="more than 10 bytes"):
        companion.load({"npz": "c.npz", "sha256": "0" * 64}, "companion", tmp_path, longest=10)


def test_a_weight_between_two_floats_is_not_rounded() -> None:
    """In a large network a weight that is no binary64 is refused."""
    with pytest.raises(NotProvedError, match="binary64"):
        companion.binary64((Fraction(1, 3),))


@pytest.mark.parametrize("text", ["x)", "x**2**3", "x**(1)"])
def test_expressions_that_the_grammar_lacks(text: str) -> None:
    """A parenthesis that was never opened and a power of a power are no expressions."""
    with pytest.raises(ExpressionError):
        parse(text)


@pytest.mark.parametrize("content", [b"[" * 100_000, b"[" + b"[]," * (MAX_LISTS + 1) + b"[]]", b'{"format": 1e999}'])
def test_texts_too_deep_or_too_long_are_malformed(content: bytes) -> None:
    """Lists in lists, millions of lists, and a number beyond binary64 are malformed."""
    assert isinstance(check(content), Malformed)


@pytest.mark.parametrize(
    "fields",
    [
        {"format": "persid-model-9"}, {"terms": [{"f": "tanh(x)", "R": None}]},
        {"terms": [{"f": ["x", "tanh(x)"], "R": None, "A": [[1]]}]}, {"terms": [{"f": "tan(", "R": None, "A": [[1]]}]},
        {"terms": [{"f": "tanh(x)", "R": {"shape": [1, 1], "coo": [[], [], []]}, "A": [[1]]}]},
        {"terms": [{"f": "tanh(x)", "R": {"shape": [0, 1], "coo": [[], [], []]}, "A": [[1]]}]},
        {"terms": [{"f": "tanh(x)", "R": 3, "A": [[1]]}]}, {"b": [1, 2]},
        {"A0": {"shape": [1, 1], "coo": [[0], [0, 0], [1]]}}, {"A0": {"shape": [1, 1], "coo": [[0.5], [0], [1]]}},
        {"A0": {"shape": [1, 1], "coo": [[0], [0], [True]]}}, {"B": [1]}, {"terms": [3]},
    ],
    ids=str,
)  # fmt: skip
def test_sparse_models_that_are_not_as_specified(fields: dict[str, Any]) -> None:
    """Every field of a sparse model has its shape and its kind."""
    with pytest.raises(FormatError):
        canonical_model({**SPARSE, **fields})


@pytest.mark.parametrize("value", [3, [], "model", None])
def test_a_model_is_an_object(value: Any) -> None:
    """What is no object is no model, and no output model."""
    with pytest.raises(FormatError):
        canonical_model(value)
    with pytest.raises(FormatError):
        canonical_outputs({"outputs": value, "C": value}, 1, 1)


def test_a_term_is_an_object() -> None:
    """A plain model whose term is a number is malformed."""
    with pytest.raises(FormatError, match="an object with f, R, A"):
        canonical_model({**model([], [[-1]]), "terms": [3]})


def test_numbers_that_are_too_long_are_not_multiplied() -> None:
    """Exact matrices have limits: of binary places, of their spread, and of the work of a product."""
    with pytest.raises(NotProvedError, match="binary places"):
        exact.matrix([[Fraction(1, 1 << (flint_matrix.MAX_EXPONENT + 1))]], 1)
    small = exact.matrix([[Fraction(1)]], 1)
    with pytest.raises(NotProvedError, match="spread"):
        small.raised(flint_matrix.MAX_EXPONENT + 1)


def test_a_product_of_long_numbers_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A product of matrices whose numbers are too long for its size is refused before it is made."""
    monkeypatch.setattr(flint_matrix, "FREE_WORK", 0)
    monkeypatch.setattr(flint_matrix, "MAX_WORK", 10)
    long = exact.matrix([[Fraction(1 << 40)]], 1)
    with pytest.raises(NotProvedError, match="too large"):
        long * long


def test_an_equilibrium_that_is_none_is_not_proved() -> None:
    """No radius is found about a point that is none, a ball has a radius >= 0, and a pole is no equilibrium."""
    read = model_of(canonical_model(model([], [[-1]])))
    assert proved_radius(read, [1], [0]) is None
    assert not has_unique_equilibrium(read, [Fraction(0)], Fraction(-1), [Fraction(0)])
    pole = model_of(canonical_model(model([("1/x", None, [[-1]])], [[-1]])))
    assert not has_unique_equilibrium(pole, [Fraction(0)], Fraction(1), [Fraction(0)])


F = (Fraction(0), Fraction(1))


@pytest.mark.parametrize(
    "prove",
    [
        lambda: prover.prove_strict_sector_form(POLE, F),
        lambda: prover.prove_integral_upper(POLE, F, Fraction(1)),
        lambda: prover.prove_integral_lower(POLE, F, Fraction(1)),
        lambda: prover.prove_sector_form(TANH_CURVE, F, BESIDE),
        lambda: prover.prove_integral_upper(TANH_CURVE, F, Fraction(1), BESIDE),
        lambda: prover.prove_integral_upper(COSINE, F, Fraction(1)),
        lambda: prover.prove_integral_upper(TANH_CURVE, F, Fraction(3, 5), (Fraction(-9), Fraction(9))),
    ],
)
def test_what_does_not_hold_is_not_proved(prove: Callable[[], bool]) -> None:
    """Not of a pole, nor beside 0, nor of what is not 0 at 0; and of tanh 3/5 of y tanh y is too little far out."""
    assert not prove()


def test_a_sector_form_has_an_integral_that_is_not_negative() -> None:
    """The lower bound with a constant of at most 0 follows from the sector form alone."""
    assert prover.prove_integral_lower(TANH_CURVE, F, Fraction(-1))


@pytest.mark.parametrize("name", ["erf'", "softplus", "arcsinh"])
def test_series_of_every_function(name: str) -> None:
    """The value of a series at its centre is that of the function, and its slope that of a difference."""
    values = {"erf'": lambda x: (-(x * x)).exp() * 2 / arb.pi().sqrt(), "softplus": lambda x: x.exp().log1p(),
              "arcsinh": lambda x: x.asinh()}  # fmt: skip
    center, h = arb(1) / 2, arb(2) ** -20
    found = power_series(name, arb_series([center, 1], prec=4), center, 4)
    f = values[name]
    assert found[0].overlaps(f(center))
    assert abs(found[1] - (f(center + h) - f(center - h)) / (2 * h)) < 1e-9


def test_a_function_without_a_series() -> None:
    """What has no series there is not defined, and so nothing is proved with it."""
    with pytest.raises(UndefinedError):
        power_series("gamma", arb_series([1, 1], prec=4), arb(1), 4)
    with pytest.raises(UndefinedError):
        power_series("sin", arb_series([arb(10) ** 40, 1], prec=4), arb(10) ** 40, 4)


def test_the_program_of_the_checker_answers_by_exit_codes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It prints what is wrong, and its exit code says which kind: accepted 0, rejected 5, malformed 2."""
    good = named.load("g_mixed_pair")
    for content, code, word in ((good, 0, "accepted"), ({**good, "gamma": [1, -40]}, 5, "rejected"), ({}, 2, "malf")):
        path = tmp_path / "file.json"
        path.write_bytes(data(content))
        assert main([str(path)]) == code
        assert capsys.readouterr().out.startswith(word)


def changed(name: str, *, model: dict[str, Any] | None = None, **fields: Any) -> bytes:
    """Return a kept file with other fields, its model's hash made anew."""
    content = named.load(name)
    content |= fields
    content["model"] = canonical_model({**content["model"], **(model or {})})
    content["model_sha256"] = model_sha256(content["model"])
    return data(content)


POLES = {"terms": [{"f": "x/(x-9)", "R": None, "A": [[2.0]]}]}


def growing(A0: list[list[float]], *terms: dict[str, Any]) -> bytes:
    """Return a file that says that two states grow together from (1, 1)."""
    grown = {"states": ["x1", "x2"], "x_ref": [0, 0], "A0": A0, "terms": [*terms], "B": [[0], [0]], "b": [0, 0]}
    zero = {"x": [[0, 0], [0, 0]], "radius": [0, 0]}
    witness = {"kind": "cooperative-growth", "point": zero, "start": [[1, 0], [1, 0]]}
    return changed("refuted_cooperative", model=grown, witness=witness)


def test_states_that_grow_together_are_refuted() -> None:
    """A channel that acts on nothing does not matter."""
    idle = term("tanh(x)", [0, 1.0], [0, 0])
    assert isinstance(check(growing([[1.0, 0], [0, 1.0]], idle)), Accepted)


def one_row_more(name: str) -> dict[str, Any]:
    """Return the proof of a kept file for one more input, b."""
    proof = named.load(name)["proof"]
    return {**proof, "Q": [*proof["Q"], [0] * len(proof["Q"]) + [1]]}


def term(f: str, *rows: list[float], R: Any = None) -> dict[str, Any]:
    return {"f": f, "R": R, "A": list(rows)}


@pytest.mark.parametrize(
    ("content", "where"),
    [
        (lambda: changed("refuted_unstable", model=POLES), "channel 0"),
        (lambda: growing([[1.0, -1.0], [0, 1.0]]), "model.A0"),
        (lambda: growing([[1.0, 0], [0, 1.0]], term("tanh(x)", [1.0], [0], R=[[1.0, -1.0]])), "channel 0"),
        (lambda: changed("g_linear", dropped=[0], proof={"P": [], "Q": [[1]]}), "dropped"),
        (lambda: changed("r_pendulum", model={"b": [0, 1.0]}, proof=one_row_more("r_pendulum")), "operating_point"),
    ],
)
def test_false_files_are_rejected_at_their_place(content: Callable[[], bytes], where: str) -> None:
    """Poles, signs, states that are dropped and constants that move the equilibrium are noticed."""
    result = check(content())
    assert isinstance(result, Rejected), result
    assert result.where == where, result


@pytest.mark.parametrize(
    ("module", "limit", "value", "content", "where"),
    [
        (claims, "MAX_REGIONAL", 1, lambda: changed("r_pendulum"), "box"),
        (conclusions, "MAX_STATES", 0, lambda: data(plain()), "outputs"),
        (format_1, "MAX_FORMS", 0, lambda: changed("g_mixed_pair"), "groups[0].forms"),
        (refuted, "MAX_FORMS", 0, lambda: changed("infeasible_full"), "groups[0].forms"),
    ],
)
def test_files_beyond_a_limit_are_refused(
    module: ModuleType,
    limit: str,
    value: int,
    content: Callable[[], bytes],
    where: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What would take too long is not begun: states of a region, states behind outputs, forms of a group."""
    assert isinstance(check(content()), Accepted)
    monkeypatch.setattr(module, limit, value)
    result = check(content())
    assert isinstance(result, Rejected | Malformed), result
    assert result.where == where, result


@pytest.mark.parametrize(
    ("limit", "value", "where"),
    [
        ("MAX_KINDS", 1, "kinds"), ("MAX_FUNCTIONS", 0, "kinds[1].functions"), ("MAX_FORMS", 2, "kinds[1].forms"),
        ("MAX_DOUBTFUL", -1, "weights"),
    ],
)  # fmt: skip
def test_networks_beyond_a_limit_are_refused(
    limit: str, value: int, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kinds, their functions and forms, and nodes in doubt are limited in number."""
    network = Network(A=[(1, 0, 0.5)], kinds=[([], []), TANH])
    assert isinstance(network.forged(), Accepted)
    monkeypatch.setattr(network_file, limit, value)
    result = network.forged()
    assert isinstance(result, Rejected | Malformed), result
    assert result.where == where, result


def test_cones_beyond_a_limit_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cone with too many rays on the way, or in the end, is given up."""
    forms = [tuple(Fraction(v) for v in row) for row in ((1, 0, 1), (1, 0, -1), (1, 1, 0), (1, -1, 0))]
    assert generators(forms, 3)
    for most in (3, 4):
        monkeypatch.setattr(cone, "MAX_RAYS", most)
        with pytest.raises(NotProvedError, match="too many generators"):
            generators(forms, 3)


@pytest.mark.parametrize("sides", [24])
def test_a_cone_may_have_so_many_rays_in_the_end(sides: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cone over a polygon of many sides has a ray for each, and is given up where these are too many."""
    monkeypatch.setattr(cone, "MAX_RAYS", 17)
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    forms = [(Fraction(1), Fraction(float(np.cos(a))), Fraction(float(np.sin(a)))) for a in angles]
    with pytest.raises(NotProvedError, match="too many generators"):
        generators(forms, 3)


@pytest.mark.parametrize(
    ("module", "limit", "value", "where"),
    [
        (table, "MAX_FUNCTIONS", 0, "model"), (table, "MAX_TABLE", 0, "model"),
        (network_file, "MAX_DOUBTFUL", -1, "weights"),
    ],
)  # fmt: skip
def test_tables_beyond_a_limit_are_refused(
    module: ModuleType, limit: str, value: int, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The table of a large network has limits, of functions at a node and of coefficients."""
    monkeypatch.setattr(module, limit, value)
    result = Network(A=[(1, 0, 0.5)], kinds=[([], []), TANH]).forged()
    assert isinstance(result, Rejected), result
    assert result.where == where, result


def test_a_small_network_has_limits_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """A node has so many functions at most, and an obstruction so many positive entries."""
    monkeypatch.setattr(network_file, "MAX_DOUBTFUL", 0)
    assert obstruction([1.0], [0]).where == "z"
    monkeypatch.setattr(nodes, "MAX_FUNCTIONS", -1)
    assert obstruction([1.0], [0]).where == "model"


@pytest.mark.parametrize(("entries", "kind"), [([0.5], Accepted), ([0.2, 0.1], Rejected)])
def test_a_small_network_with_many_generators_is_summed_in_binary64(
    entries: list[float], kind: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond the work that fractions are worth it is summed as a large one, where its merged entries are binary64."""
    monkeypatch.setattr(network_file, "EXACT_WORK", 0)
    small = model([("x", None, [[entry]]) for entry in entries], [[-2.0]])
    content = {
        "format": "persid-certificate-1", "claim": "L1", "statement": "", "model": canonical_model(small),
        "model_sha256": model_sha256(small), "operating_point": "every", "kinds": [{"functions": [], "forms": []}],
        "kappa": dyadic(0.5), "weights": [[1, 0]], "companion": None,
    }  # fmt: skip
    assert isinstance(check(data(content)), kind)


def test_bounds_that_cannot_be_inverted_prove_nothing() -> None:
    """A bound of V that is singular bounds no output, and keeps off no face of a box."""
    singular = exact.matrix([[Fraction(0)]], 1)
    with pytest.raises(NotProvedError, match="cannot be inverted"):
        conclusions.least_constants([[Fraction(1)]], singular)
    assert claims._reached(singular, [Fraction(1)]) == 0


def test_a_constant_that_is_hard_to_see_takes_more_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where an enclosure is wide, more bits are tried, and the last one stands."""
    monkeypatch.setattr(conclusions, "ACCURACY", 10**9)
    (least,) = conclusions.least_constants([[Fraction(1)]], exact.matrix([[Fraction(3)]], 1))
    assert least.overlaps(arb(1) / 3)


def test_expansions_far_out_are_defined_or_refused() -> None:
    """Logarithms near 1 and of logarithms have no expansion; (log y) / y decreases beyond e; 0 has a root."""
    near, far = Horizon(Fraction(1)), Horizon(Fraction(4))
    with pytest.raises(UndefinedError, match="a logarithm near 1"):
        near.bound((fmpq(-1), fmpq(0), fmpq(1)))
    assert far.bound((fmpq(0), fmpq(-1), fmpq(1))).hi >= arb(4).log() / 4
    assert Expansion(far, []).power(Fraction(1, 2)).terms == []
    logarithm = Expansion(far, [((fmpq(0), fmpq(0), fmpq(1)), fmpq(1))])
    with pytest.raises(UndefinedError, match="the logarithm of a logarithm"):
        logarithm.log()


@pytest.mark.parametrize("name", ["tanh", "softplus"])
def test_a_sign_that_is_not_proved_far_out(name: str) -> None:
    """Of a growing argument of unknown sign nothing is known."""
    unknown = Expansion(Horizon(Fraction(4)), [((fmpq(0), fmpq(1), fmpq(0)), Interval(arb(-1), arb(1)))])
    with pytest.raises(UndefinedError, match="a sign is not proved"):
        unknown.apply(name)


def test_values_say_what_they_are() -> None:
    """An interval shows its ends, what is none is refused, and a number beyond binary64 is malformed."""
    assert repr(constant(Fraction(1))) == "Interval(1.000000000, 1.000000000)"
    with pytest.raises(TypeError):
        as_interval(Expansion(Horizon(Fraction(4)), [(CONSTANT, fmpq(1))]))
    with pytest.raises(FormatError, match="too large"):
        read(b'{"a": 1e999}', floats=True)


def test_a_function_of_a_kind_is_an_expression() -> None:
    """A kind whose function is no expression is malformed."""
    result = Network(A=[(1, 0, 0.5)], kinds=[([], []), ([("tanh(", 1.0)], [])]).forged()
    assert isinstance(result, Malformed), result


def test_gains_beyond_binary64_are_refused() -> None:
    """Sums of weights that overflow prove nothing."""
    result = Network(B=((0, 0, 1e200),), w=np.full(N, 1e200)).forged()
    assert isinstance(result, Rejected), result
    assert result.where == "weights"


def test_a_network_without_inputs_has_no_gains() -> None:
    """Without B there is nothing to sum, and the decrease alone is stated."""
    result = Network(B=(), inputs=()).forged()
    assert isinstance(result, Accepted), result


def obstruction(z: list[float], choice: Any, arrays: dict[str, np.ndarray] | None = None) -> Any:
    """Return the answer about x' = x, with no weights that let it decrease."""
    unstable = model([], [[1.0]])
    content: dict[str, Any] = {
        "format": "persid-certificate-1", "claim": "L1-infeasible", "statement": "", "model": canonical_model(unstable),
        "model_sha256": model_sha256(unstable), "z": [dyadic(v) for v in z], "choice": choice, "companion": None,
        "kinds": [{"functions": [], "forms": [], "rays": [[[1, 0]]]}],
    }  # fmt: skip
    packed_arrays = None if arrays is None else packed(arrays)
    if packed_arrays is not None:
        content["companion"] = {"npz": "c.npz", "sha256": hashlib.sha256(packed_arrays).hexdigest()}
    return check(data(content), arrays=packed_arrays)


def test_an_obstruction_may_keep_its_choice_in_a_companion() -> None:
    """The rays that are chosen stand in the file or in an array, of integers within the number of rays."""
    for number, kind in ((0, Accepted), (5, Malformed), (-1, Malformed)):
        assert isinstance(obstruction([1.0], None, {"choice": np.array([number])}), kind)
    assert isinstance(obstruction([1.0], None), Malformed)
    assert isinstance(obstruction([1.0], [0]), Accepted)
    assert isinstance(obstruction([-1.0], [0]), Rejected)
    assert isinstance(obstruction([0.0], [0]), Rejected)


def test_outputs_have_a_hash_and_a_format() -> None:
    """The hash of the outputs is text, and an output model says that it is one."""
    certificate = plain()
    certificate["outputs"]["sha256"] = 3
    result = check(data(certificate))
    assert isinstance(result, Malformed), result
    assert result.where == "outputs.sha256"
    for wrong in (3, {"format": 3, "dynamics": 3, "outputs": [], "C": []}):
        with pytest.raises(FormatError):
            output_sha256(wrong)
