"""Attacks on ledgers: every number changed, random models of known truth, and files of every wrong form."""

import copy
import functools
import json
import random
import resource
import runpy
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from checker import known_ledgers
from checker.drawn import outcomes
from checker.ledgers import ZERO, Sketch, curve, data, draft, model_object, point, solved
from checker.mutation import mutants
from checker.sampled import faults, faults_of_pairs
from persid.certificates.ledger import with_proof
from persid.errors import RoundingError
from persid.lyapunov.sectors import Curve, nondecreasing_pool, pool
from persid_check import Accepted, Malformed, Rejected, check, model_sha256
from persid_check.ledger.file import KINDS
from persid_check.results import FormatError, NotProvedError
from places import SHARED


def _mutated(names: tuple[str, ...], share: float, seed: int) -> tuple[int, int]:
    choose = random.Random(seed)
    total = accepted = 0
    for name in names:
        for path, new, mutant in mutants(known_ledgers.load(name)):
            if choose.random() >= share:
                continue
            total += 1
            if isinstance(check(data(mutant)), Accepted):
                accepted += 1
                found = faults(mutant, samples=40)
                assert found == [], (name, path, new)
    print(f"{total} mutants, {accepted} accepted, none with a fault")
    return total, accepted


@pytest.mark.long
def test_accepted_mutants_are_true_along_the_model() -> None:
    """Of a sample of changed numbers, every ledger that is still accepted holds at sampled states and inputs."""
    total, accepted = _mutated(known_ledgers.NAMES, 0.01, seed=1)
    assert total > 300
    assert 0 < accepted < total


@pytest.mark.slow
def test_all_mutants_of_all_ledgers() -> None:
    """The same for every number of every known ledger, more than 20,000 mutants."""
    total, _ = _mutated(known_ledgers.NAMES, 1.0, seed=2)
    assert total > 20_000


SCALARS = (
    "x**3", "sinh(x)", "tanh(x)", "arctan(x)", "sat(x)", "deadzone(x)", "relu(x)", "sin(x)", "softsign(x)", "x*abs(x)",
    "expm1(x)", "erf(x)", "x**3-3*x**2+2.5*x", "arcsinh(x)", "x**5", "softplus(x)-0.6931471805599453", "cos(x)-1",
    "pwl(x; -1.1: -1, -0.3: 0, 0.3: 0, 1: 2)", "pwl(x; -2: -1, -0.7: -1.5, 0: 0, 0.1: 0.3, 3: 0.3)",
)  # fmt: skip


def _scalar(choose: random.Random) -> Sketch:
    """x' = a x + c f(alpha x) + u, with forms of persid's pools, each as the strongest kind that is proved."""
    text, alpha = choose.choice(SCALARS), choose.choice((1, 1, 2, 0.5))
    shape = Curve((text,), (Fraction(alpha),))
    listed = [*nondecreasing_pool(shape)[:2], *pool(shape)[:2], (1.0, 0.0), (0.0, 1.0), (0.0, 1.0), (-1.0, 1.0)]
    kinds = [("nondecreasing", "sector")] * (len(listed) - 2) + [("one-signed",)] * 2
    forms = [form for row, names in zip(listed, kinds, strict=True) for form in _proved(text, alpha, row, names)[:1]]
    sectors = [k for k, (_, kind, _) in enumerate(forms) if kind != "one-signed"]
    signed = [k for k, (_, kind, _) in enumerate(forms) if kind == "one-signed"]
    densities = [k for k in sectors if forms[k][2]]
    facts = [("value", 0, k, q) for k in sectors for q in sectors if k < q]
    facts += [("one_signed", 0, k, 0, q) for k in signed for q in signed if k <= q]
    kappa = choose.choice((0, Fraction(1, 8)))
    a, c = choose.uniform(-2, 0.5), choose.uniform(-2, 1)
    model = model_object([(text, [[float(alpha)]], [[c]])], [[a]], [[1.0]])
    made = curve([(text, alpha)], *forms)
    claim = "rate-and-gain" if kappa else "iss"
    return Sketch(model, [made], [point(0, {0: 1}, [0], densities)], facts, claim, kappa)


def _proved(text: str, alpha: Any, l: Any, kinds: tuple[str, ...]) -> list[Any]:  # noqa: E741
    """The form as each kind that has a partition, with the least bound of its integral that has one, if any."""
    unsought, found = [0, [-1, 0, 1]], []
    for kind in kinds:
        if curve([(text, alpha)], (l, kind))["forms"][0]["cuts"] == unsought:
            continue
        bounds = [(l, kind, {"upper": (c, 0)}) for c in (0.25, 0.5, 1) if kind != "one-signed"]
        made = (form for form in bounds if curve([(text, alpha)], form)["forms"][0]["upper"][2] != unsought)
        found.append(next(made, (l, kind, {})))
    return found


def _is_stable(content: dict[str, Any]) -> bool:
    """Truth for x' = F(x) + u: F has the sign of -x, and |F| grows beyond every bound at both ends."""
    from checker.independent import Model

    m = Model(content["model"])
    x = np.concatenate([s * np.geomspace(1e-5, 1e9, 7000) for s in (1, -1)])  # a slope of .01 needs far ends
    with np.errstate(all="ignore"):
        F = m.A0[0, 0] * x + sum(m.A[0, c] * f.value(m.R[c, 0] * x) for c, f in enumerate(m.f))
    inward = bool((np.sign(x) * F < 0)[~np.isnan(F)].all())
    return inward and abs(F[6999]) > 20 and abs(F[-1]) > 20


def _scalars(count: int, seed: int) -> Counter[str]:
    return outcomes(_scalar, _is_stable, count, seed)


@pytest.mark.long
def test_accepted_scalar_models_are_stable() -> None:
    """Of random models of one state with random forms, every one that is accepted is input-to-state stable."""
    counts = _scalars(60, seed=1)
    assert counts["Accepted"] >= 8


@pytest.mark.slow
def test_accepted_scalar_models_are_stable_of_five_thousand() -> None:
    """The same for 5,000 models."""
    assert _scalars(5000, seed=2)["Accepted"] > 500


def _several(model: dict[str, Any], choose: random.Random) -> Sketch:
    """Value, difference and sum facts for a model of the shared families."""
    n, terms = len(model["states"]), model["terms"]
    known = {
        "x**3": [((0, 1), "nondecreasing")],
        "sinh(x)": [((0, 1), "nondecreasing"), ((-1, 1), "nondecreasing")],
        "tanh(x)": [((0, 1), "nondecreasing"), ((1, -1), "nondecreasing")],
    }
    curves, points, facts, channel = [], [], [], 0
    for term in terms:
        place, rows = len(curves), np.eye(n).tolist() if term["R"] is None else term["R"]
        curves.append(curve([(term["f"], 1)], ((1, 0), "nondecreasing"), *known[term["f"]]))
        forms = range(len(known[term["f"]]) + 1)
        first = len(points)
        for row in rows:
            points.append(point(place, {i: v for i, v in enumerate(row) if v}, [channel], list(forms)))
            facts += [("value", len(points) - 1, k, q) for k in forms for q in forms if k < q]
            channel += 1
        if choose.random() < 0.5:
            pairs = [(p, q) for p in range(first, len(points)) for q in range(first, p)]
            facts += [("difference", p, q, sign, 1, len(forms) - 1) for p, q in pairs for sign in (-1, 1)]
    return Sketch(model, curves, points, facts)


_UNSTABLE = ("unstable_origin", "cooperative_bistable", "saturated")
_FAMILIES = ("dissipative", "column_dominance", "nonnormal", "lure", "port_hamiltonian", *_UNSTABLE)


def _families(count: int, seed: int) -> Counter[str]:
    if not (SHARED / "families.py").is_file():
        pytest.skip("families.py of the shared data is not on this machine")
    families = runpy.run_path(str(SHARED / "families.py"))
    choose, counts = random.Random(seed), Counter()
    for k in range(count):
        family, n = _FAMILIES[k % len(_FAMILIES)], choose.choice((2, 2, 3))
        ((_, truth, model),) = families["draw"](family, n=n, count=1, seed=seed + k)
        try:
            content = solved(_several(model, choose))
        except Exception as error:  # the solver gives up, or no factor is found: nothing to check
            if not isinstance(error, RoundingError) and type(error).__name__ != "SolverError":
                raise
            counts[f"{truth}, not made"] += 1
            continue
        answer = check(data(content))
        counts[f"{truth}, {type(answer).__name__}"] += 1
        if isinstance(answer, Accepted):
            assert truth == "iss", (family, k)
            assert faults(content, samples=40) == [], (family, k)
    print(dict(counts))
    return counts


@pytest.mark.long
def test_accepted_models_of_several_states_are_stable() -> None:
    """Of random models of known truth, only stable ones are accepted, and each ledger holds at sampled states."""
    counts = _families(24, seed=1)
    assert counts["iss, Accepted"] >= 4


@pytest.mark.slow
def test_accepted_models_of_several_states_are_stable_of_two_thousand() -> None:
    """The same for 2,000 models."""
    assert _families(2000, seed=100)["iss, Accepted"] > 300


_SLOPED = ("tanh(x)", "sat(x)", "relu(x)", "deadzone(x)", "softsign(x)", "softplus(x)-0.6931471805599453",
           "pwl(x; -1: -0.5, 0: 0, 2: 0.25, 3: 1.25)", "sin(x)", "expm1(x)")  # fmt: skip


def _loop(choose: random.Random) -> Sketch:
    """A plant of two or three states in a loop with a function, which mostly has slopes from 0 to 1."""
    n, f, k = choose.choice((2, 3)), choose.choice(_SLOPED), choose.choice((0.5, 2.0, 8.0))
    rng = np.random.default_rng(choose.randrange(10**6))
    A0 = rng.normal(size=(n, n)).round(3)
    A0 -= np.eye(n) * round(float(np.linalg.eigvals(A0).real.max()) + choose.uniform(-0.1, 1), 3)
    row, column = (k * rng.normal(size=n)).round(3), rng.normal(size=(n, 1)).round(3)
    model = model_object([(f, [row.tolist()], column.tolist())], A0.tolist(), np.eye(n)[:, :1].tolist(), n=n)
    kappa = choose.choice((0, Fraction(1, 32)))
    bounds = [{"upper": (1, 0), "lower": (1, j)} if choose.random() < 0.8 else {"upper": (1, 0)} for j in (1, 0)]
    forms = curve([(f, 1)], ((0, 1), "nondecreasing", bounds[0]), ((1, -1), "nondecreasing", bounds[1]))
    at = point(0, {i: v for i, v in enumerate(row.tolist()) if v}, [0], [0, 1])
    facts = [("value", 0, 0, 1), ("slope", 0, 0, 1), ("slope", 0, 0, 0), ("slope", 0, 1, 1)]
    return Sketch(model, [forms], [at], facts, "rate-and-gain" if kappa else "iss", kappa, inside=(0,))


def _comes_to_rest(content: dict[str, Any]) -> bool:
    """Truth for loops, as far as runs tell: linear at 0 and far out, and from large and small starts."""
    from checker.independent import Model

    m, rng = Model(content["model"]), np.random.default_rng(0)
    ends = [np.linalg.eigvals(m.J(s * np.ones(m.n))).real.max() for s in (0.0, 1e3, -1e3)]
    x = rng.normal(size=(40, m.n)) * np.geomspace(0.01, 300, 40)[:, None]
    start, h = np.linalg.norm(x, axis=1), 0.02
    if max(ends) > -1e-6:
        return False
    for _ in range(int(max(100, min(10 / -max(ends), 4000)) / h)):
        ks, y = [], x
        for share in (0.5, 0.5, 1.0, 0.0):
            ks.append(_field(m, y))
            y = x + share * h * ks[-1]
        x = x + h / 6 * (ks[0] + 2 * ks[1] + 2 * ks[2] + ks[3])
    return bool((np.linalg.norm(x, axis=1) < 0.9 * start).all())


def _field(m: Any, x: np.ndarray) -> np.ndarray:
    return x @ m.A0.T + m.f[0].value(x @ m.R[0])[:, None] * m.A[:, 0]


@pytest.mark.long
def test_accepted_loops_come_to_rest() -> None:
    """Of random loops with values and slopes in the proof, every accepted one is stable, and its ledger holds."""
    assert outcomes(_loop, _comes_to_rest, 60, seed=1)["Accepted"] >= 8


@pytest.mark.slow
def test_accepted_loops_come_to_rest_of_three_thousand() -> None:
    """The same for 3,000 loops."""
    assert outcomes(_loop, _comes_to_rest, 3000, seed=2)["Accepted"] > 400


_ODD: tuple[Any, ...] = (
    None, True, False, "", "x", "any", [], {}, [[]], [{}], {"a": 1}, 0, -1, 10**30, -(10**300), [0, 0], [1, -2000],
    [1, 2000], [1, 10**9], [[1, 0]], "0x1.0p+0", "é" * 50, [None], [[0, [1, 0]]] * 3, {"lower": []}, {"diagonal": []},
    {"shape": [1, 32000000], "rows": [], "columns": [], "values": []}, {"shape": [10**30, -1], "npz": "../a.npz"},
)  # fmt: skip


def _places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _places(entry, (*path, key))
    elif isinstance(value, list):
        for i, entry in enumerate(value):
            yield from _places(entry, (*path, i))


def _disfigured(content: Any, path: tuple[Any, ...], new: Any) -> Any:
    if not path:
        return new
    changed = copy.deepcopy(content)
    at = changed
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = new
    return changed


@pytest.mark.parametrize("name", ["spring", "region", "plant", "g_ball", "one_signed", "slopes", "steps_values_region"])
def test_a_wrong_type_anywhere_is_answered(name: str) -> None:
    """A value of another type, size or depth at any place is answered, never a traceback, and quickly."""
    choose, content = random.Random(name), known_ledgers.load(name)
    places = list(_places(content))
    for _ in range(400):
        path, new = choose.choice(places), choose.choice(_ODD)
        started = time.process_time()
        answer = check(data(_disfigured(content, path, new)))
        assert isinstance(answer, Accepted | Rejected | Malformed)
        assert time.process_time() - started < 5, (path, new)
        if isinstance(answer, Accepted):
            assert path[:1] in (("statement",), ("curves",), ("points",), ("facts",), ("operating_point",), ("gamma",),
                                ("deviations",), ("input_bound",), ("P",), ("strips",), ("outputs",), ("proof",),
                                ("spanning",), ("kappa",), ("p",), ("level",), ("dropped",)), path  # fmt: skip
            assert faults(_disfigured(content, path, new), samples=60) == []


def _other(choose: random.Random, path: tuple[Any, ...], old: Any) -> Any:
    """Something else of the same kind: a number, a kind of form, a centre, a list cut short or in another order."""
    if isinstance(old, bool) or old is None:
        return choose.choice((None, "any", [[0, 0], [0, 0]]))
    if isinstance(old, str) and path[-1] == "is":
        return choose.choice(KINDS)
    if isinstance(old, str) and "0x" in old:
        return (float.fromhex(old) * choose.choice((-1.0, 0.0, 0.5, 0.875, 1.125, 2.0)) + 0.0).hex()
    if isinstance(old, int):
        return choose.choice((0, -old, old + 1, old - 1, 2 * old, old // 2))
    if isinstance(old, list) and old:
        return choose.choice((old[:-1], old[1:], old[::-1], [*old, old[-1]]))
    return old


def _refactored(count: int, seed: int) -> Counter[str]:
    """One or two places are changed and the factors made anew, so that lemmas and facts alone stand in the way."""
    choose, counts = random.Random(seed), Counter[str]()
    names = [name for name in known_ledgers.NAMES if name[:2] != "m_"]
    for _ in range(count):
        name = choose.choice(names)
        content = copy.deepcopy(known_ledgers.load(name))
        changed = [p for p in _places(content) if p and p[0] not in ("format", "statement", "proof", "model_sha256")]
        for _ in range(choose.choice((1, 1, 2))):
            path = choose.choice(changed)
            with suppress(KeyError, IndexError, TypeError):  # the first change may have cut it off
                old = functools.reduce(lambda at, key: at[key], path, content)
                content = _disfigured(content, path, _other(choose, path, old))
        with suppress(FormatError, RoundingError, NotProvedError, ArithmeticError):
            content = content | {"model_sha256": model_sha256(content["model"])}
            content = with_proof(content)
        answer = check(data(content))
        counts[type(answer).__name__] += 1
        if isinstance(answer, Accepted):
            assert faults(content, samples=80) == [], (name, content)
            if "incremental" in answer.further:
                counts["of any two solutions"] += 1
                assert faults_of_pairs(content, samples=80) == [], (name, content)
    print(dict(counts))
    return counts


@pytest.mark.long
def test_accepted_changes_with_factors_of_their_own_are_true() -> None:
    """Of ledgers with one or two places changed and new factors, each that is accepted holds at sampled states."""
    counts = _refactored(300, seed=1)
    assert counts["Accepted"] > 20


@pytest.mark.slow
def test_accepted_changes_with_factors_of_their_own_are_true_of_twenty_thousand() -> None:
    """The same for 20,000 changes."""
    assert _refactored(20_000, seed=2)["Accepted"] > 1000


def _costly() -> Iterator[tuple[str, bytes]]:
    """Files that would take long, or much memory, for their length."""
    base = copy.deepcopy(known_ledgers.load("rated"))
    many = copy.deepcopy(base)
    many["curves"][0]["forms"][0]["cuts"] = [-12, [*range(-300_000, 0), 0, *range(1, 300_000)]]
    yield "many cuts", _hashed(many)
    long = copy.deepcopy(base)
    text = "+".join(["tanh(tanh(tanh(x)))"] * 47)
    long["model"]["terms"][0]["f"] = long["curves"][0]["functions"][0][0] = text
    long["curves"][0]["continuous"] = [0, [-32, 0, 32]]
    long["curves"][0]["forms"][0]["cuts"] = [-10, list(range(-40_000, 40_000))]
    yield "long functions, many cuts", _hashed(long)
    tower = copy.deepcopy(base)
    text = "tanh(x)" + "+0*sin(((2**64)**64)**15)" * 20
    tower["model"]["terms"][0]["f"] = tower["curves"][0]["functions"][0][0] = text
    tower["curves"][0]["continuous"] = [0, [-32, 0, 32]]
    yield "towers of powers", _hashed(tower)
    facts = copy.deepcopy(base)
    facts["facts"]["value"] = [[0, 0, 1, [1, -40]]] * 200_000
    yield "many facts", _hashed(facts)
    points = copy.deepcopy(base)
    points["points"] = [base["points"][0]] * 9_000 + base["points"]
    yield "many points", _hashed(points)
    wide = copy.deepcopy(base)
    wide["model"]["terms"] = [{"f": "tanh(x)", "R": [["0x0.0p+0"] * 2] * 1000, "A": [["0x0.0p+0"] * 1000] * 2}]
    yield "many channels", _hashed(wide)
    deep = copy.deepcopy(base)
    deep["deviations"] = [{"columns": [[]] * 5000, "C": [], "s": [1, 0], "epsilon": [0, 0]}]
    yield "many deviations", _hashed(deep)
    bits = copy.deepcopy(base)
    bits["P"] = {"lower": [[[2**2000 + 1, -2000]], [[3, 2000], [2**2000 + 1, -2000]]]}
    yield "long numbers", _hashed(bits)
    yield from _read_often()
    yield from _long_bounds()


def _hashed(content: dict[str, Any]) -> bytes:
    return data(content | {"model_sha256": model_sha256(content["model"])})


def _read_often() -> Iterator[tuple[str, bytes]]:
    """A few bytes, many times, that make the checker read something long."""
    base = copy.deepcopy(known_ledgers.load("rated"))
    text = "+".join(["tanh(x)"] * 120)
    base["model"]["terms"][0]["f"] = base["curves"][0]["functions"][0][0] = text
    form = base["curves"][0]["forms"][0] | {"l": [[1, 10], [1, 0]], "upper": None}
    base["curves"][0]["forms"] = [form]
    base["points"] = [point | {"densities": []} for point in base["points"]]
    rest = base | {"facts": base["facts"] | {"value": [[0, 0, 0, ZERO]] * 50_000}}
    yield "facts of forms that rest at 0", _hashed(rest)
    odd = base | {"facts": base["facts"] | {"value": [], "difference": [[0, 1, 1, 0, 0, ZERO]] * 50_000}}
    yield "sums of odd functions", _hashed(odd)
    wide, size = copy.deepcopy(known_ledgers.load("rated")), 1200
    zero, one = (0.0).hex(), (1.0).hex()
    wide["model"]["terms"] = [{"f": "tanh(x)", "R": [[one, zero]] * size, "A": [[zero] * size] * 2}]
    form = form | {"l": [[1, 0], *[ZERO] * size], "is": "nondecreasing"}
    wide["curves"] = [wide["curves"][0] | {"functions": [["tanh(x)", [1, 0]]] * size, "forms": [form]}]
    wide["points"] = [{"curve": 0, "row": [[0, [1, 0]]], "channels": list(range(size)), "densities": []}]
    wide["facts"]["value"] = [[0, 0, 0, [1, 0]]] * 20_000
    yield "facts of long forms of zeros", _hashed(wide)
    spanned = copy.deepcopy(known_ledgers.load("m_cubes"))
    spanned["points"][0]["densities"] = [[0, ZERO]] * 20_000 + spanned["points"][0]["densities"]
    spanned["spanning"] = [spanned["spanning"][0]] * 20_000 + spanned["spanning"]
    yield "many spanning pairs", data(spanned)


def _long_bounds() -> Iterator[tuple[str, bytes]]:
    """Proved matrices of long numbers, and many bounds that are wanted from them."""
    n = 100
    sketch = Sketch(model_object([], (-np.eye(n)).tolist(), [[0.0]] * n, n=n), [], [], [], "region", 1, full=False)
    content = draft(sketch)
    content["P"] = {"diagonal": [[2**2000 + 2 * i + 1, -2000] for i in range(n)]}
    content |= {"gamma": [1, 0], "p": [1, -1], "level": [1, 0], "input_bound": ZERO}
    content["strips"] = [[[[i % n, [1, 0]], [(i + 1) % n, [1, 0]]][:: 1 if i % n < n - 1 else -1], [-9, 0], [9, 0]]
                         for i in range(2_000)]  # fmt: skip
    yield "many strips of a long P", data(with_proof(content))
    inputs = copy.deepcopy(known_ledgers.load("region"))
    inputs["model"]["inputs"] = [f"u{i}" for i in range(n)]
    inputs["model"]["u_ref"] = [(0.0).hex()] * n
    inputs["model"]["B"] = [[(0.0).hex()] * n for _ in range(2)]
    if inputs["operating_point"] is not None:
        inputs["operating_point"]["u"] = [ZERO] * n
    gains = [[[1, 900] if i == j else [1, -2000] for j in range(i + 1)] for i in range(n)]
    inputs["gamma"] = {"lower": gains}
    inputs["model_sha256"] = model_sha256(inputs["model"])
    yield "powers of a long Gamma", data(with_proof(inputs))


@pytest.mark.long
def test_time_and_memory_are_bounded_by_the_length() -> None:
    """A file made to be costly is answered within 200 microseconds and 400 bytes for each of its bytes, and a base."""
    for name, content in _costly():
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        started = time.process_time()
        answer = check(content)
        took = time.process_time() - started
        more = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        print(
            f"{name}: {len(content)} bytes, {took:.2f} s, {more / 1e6:.0f} MB, {type(answer).__name__}: {answer}"[:220]
        )
        assert isinstance(answer, Rejected | Malformed | Accepted)
        assert took < 8 + 2e-4 * len(content), name
        assert more < 3e8 + 400 * len(content), name


def test_a_matrix_that_is_not_written_out_is_refused_before_it_is_made() -> None:
    """Zeros for null, triplets and companions in the model are malformed, and take no memory for what they would be."""
    base = known_ledgers.load("spring")
    term = base["model"]["terms"][0]
    many = [f"x{i}" for i in range(1000)]
    wide = {"states": many, "terms": [{"f": "tanh(x)", "R": None, "A": None}] * 3000, "A0": None, "B": None}
    triplets = {"shape": [2, 2], "rows": [0], "columns": [0], "values": [1]}
    changes: list[dict[str, Any]] = [wide, *({name: None} for name in ("A0", "B", "b", "x_ref", "u_ref", "terms"))]
    changes += [{"A0": triplets}, {"B": {"npz": "a.npz", "name": "B", "sha256": ""}}]
    changes += [{"terms": [term | {"A": value}]} for value in (None, triplets)]
    for change in changes:
        content = base | {"model": base["model"] | change}
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        answer = check(data(content))
        assert isinstance(answer, Malformed), change
        assert answer.where.startswith("model."), change
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB
    given = {"format": "persid-model-1", "inputs": [], "B": [], **{name: wide[name] for name in ("states", "terms")}}
    answer = check(data(base), data(given))
    assert isinstance(answer, Malformed)
    assert answer.why == "more than 3000 channels"


def test_a_long_file_of_format_2_is_refused_before_it_is_parsed() -> None:
    """Where its head names the format, 16 MiB is the limit before a list of it is made."""
    head = json.dumps(known_ledgers.load("spring"))[:-1]
    long = (head + ', "more": [' + "[]," * (6 * 2**20) + "[]]}").encode()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    answer = check(long)
    assert isinstance(answer, Malformed)
    assert answer.why == f"more than {2**24} bytes"
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB: nothing was parsed


def test_json_of_every_kind_is_answered() -> None:
    """Texts that are no object, or objects that name the format and nothing else, are malformed with a place."""
    named = '"format": "persid-certificate-2"'
    texts = (
        "",
        "[]",
        "1",
        '"x"',
        "null",
        f"{{{named}}}",
        f"{{{named}, {named}}}",
        '{"format": [2]}',
        "{" * 100,
        "[" * 10**6,
    )
    for text in texts:
        assert isinstance(check(text.encode()), Malformed)
    whole = json.dumps(known_ledgers.load("spring")).encode()
    choose = random.Random(0)
    for _ in range(300):
        at, size = choose.randrange(len(whole)), choose.randrange(1, 40)
        assert isinstance(check(whole[:at] + whole[at + size :]), Accepted | Rejected | Malformed)
