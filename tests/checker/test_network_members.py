"""Sets of networks: claim L1 of every model whose rows of coefficients lie in ellipsoids, and forgeries of it."""

import copy
import json
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest

import persid as ps
from checker.ledgers import data
from persid.lyapunov.deviations import Deviation
from persid.networks.certificate import NetworkCertificate
from persid.networks.members import prove_members
from persid_check import Malformed, Rejected, check
from persid_check.networks.members import Members

N = 5
RING = np.roll(np.eye(N), 1, axis=0)
MODEL = ps.PersidskiiModel(
    -2 * np.eye(N) + 0.4 * (RING + RING.T),
    [("tanh(x)", None, 0.3 * RING - np.eye(N))],
    np.eye(N)[:, :2],
    b=np.arange(N) / 9,
)


@cache
def _certified() -> tuple[NetworkCertificate, tuple[Deviation, ...]]:
    """A certificate of models in ellipsoids of every row but the last, about three quarters of what is possible."""
    drawn = 0.035 * np.random.default_rng(0).normal(size=(N - 1, 12, 12))
    rows = tuple(Deviation.of_row(i, N, X.T @ X) for i, X in enumerate(drawn))
    certificate = prove_members(MODEL, rows)
    assert certificate is not None
    assert prove_members(MODEL, [row.times(4) for row in rows]) is None
    return certificate, rows


def _content() -> dict[str, Any]:
    return copy.deepcopy(json.loads(_certified()[0].data))


def test_a_set_of_networks_is_spoken_of() -> None:
    """The sentence is about every member, and rate and gains are worse than those of the model alone."""
    certificate, alone = _certified()[0], prove_members(MODEL, [])
    assert check(certificate.data).further == certificate.further == ("members",)
    assert certificate.statement.startswith("Every member of the stated set of models about the model with 5 states")
    assert "x1, x2, x3, x4, zeta" in certificate.statement
    assert certificate.rate < alone.rate
    assert (certificate.gains > alone.gains).all()
    assert alone.further == ("members",)  # constants alone


def test_no_member_leaves_its_bound() -> None:
    """Of 200 members on the faces of the ellipsoids, with any constant, two solutions approach as is claimed."""
    certificate, rows = _certified()
    rng, count, h = np.random.default_rng(3), 200, 0.02
    D = np.zeros((count, N, 12))
    for i, row in enumerate(rows):
        height = rng.normal(size=(count, len(row.C)))
        D[:, i] = height / np.linalg.norm(height, axis=1, keepdims=True) @ row.C
    e = rng.normal(0, 2, (count, N))

    def F(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return MODEL.rhs(x, u) + np.einsum("kij,kj->ki", D, np.hstack([x, np.tanh(x), u])) + e

    pair = [rng.normal(0, 2, (count, N)) for _ in range(2)]
    inputs = [rng.normal(0, 1, (count, 2)) for _ in range(2)]
    apart = np.abs(inputs[0] - inputs[1])
    V = lambda: np.abs(pair[0] - pair[1]) @ certificate.w  # noqa: E731
    start, closest = V(), 0.0
    for k in range(1, 401):
        for j, (x, u) in enumerate(zip(pair, inputs, strict=True)):
            a = F(x, u)
            b = F(x + h / 2 * a, u)
            c = F(x + h / 2 * b, u)
            pair[j] = x + h / 6 * (a + 2 * b + 2 * c + F(x + h * c, u))
        bound = start * np.exp(-certificate.rate * k * h) + apart @ certificate.gains
        closest = max(closest, float((V() / bound).max()))
    assert 0.3 < closest <= 1


def test_the_bound_of_a_root_is_one() -> None:
    """What is added for an ellipsoid is at least |C E v|, and hardly more."""
    claim = _certified()[0].members
    assert isinstance(claim, Members)
    for ray in ([1, 0], [3, 2], [0, 1]):
        for k in range(N):
            for (i, size), row in zip(claim.sizes(k, ray), _certified()[1], strict=True):
                exact = [sum(Fraction(float(line[j])) * v for j, v in ((k, ray[0]), (N + k, ray[1]))) for line in row.C]
                square = sum(value**2 for value in exact)
                assert square <= size**2 <= square * (1 + Fraction(1, 2**58)), i


def _every(change: Callable[[list[Any]], Any]) -> Callable[[dict[str, Any]], None]:
    def changed(content: dict[str, Any]) -> None:
        for deviation in content["deviations"]:
            for row in deviation["C"]:
                for entry in row:
                    change(entry)

    return changed


FALSE: dict[str, Callable[[dict[str, Any]], Any]] = {
    "every C is four times as large": _every(lambda entry: entry[1].__setitem__(1, entry[1][1] + 2)),
    "an entry of C is a thousand times as large": lambda c: c["deviations"][0]["C"][-1][0][1].__setitem__(
        1, c["deviations"][0]["C"][-1][0][1][1] + 10
    ),
    "a row of C more": lambda c: c["deviations"][3]["C"].append([[0, [2, 0]]]),
    "an ellipsoid more": lambda c: c["deviations"].append({"state": 4, "C": [[[4, [4, 0]]]]}),
    "kappa is that of the model alone": lambda c: c.update(kappa=json.loads(prove_members(MODEL, []).data)["kappa"]),
}
MALFORMED: dict[str, Callable[[dict[str, Any]], Any]] = {
    "about the reference": lambda c: c.update(operating_point="reference"),
    "no C": lambda c: c["deviations"][0].pop("C"),
    "no state": lambda c: c["deviations"][0].pop("state"),
    "an epsilon": lambda c: c["deviations"][0].update(epsilon=[0, 0]),
    "a state twice": lambda c: c["deviations"][1].update(state=0),
    "a state too many": lambda c: c["deviations"][3].update(state=5),
    "an entry too many": lambda c: c["deviations"][3]["C"].append([[12, [1, 0]]]),
    "entries that do not rise": lambda c: c["deviations"][3]["C"].append([[1, [1, 0]], [0, [1, 0]]]),
    "no list": lambda c: c.update(deviations={}),
}


@pytest.mark.parametrize("name", FALSE)
def test_false_sets_are_rejected(name: str) -> None:
    """A larger set, or a faster rate, is not proved by the weights of the file."""
    content = _content()
    FALSE[name](content)
    assert isinstance(check(data(content)), Rejected)


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_sets_are_named(name: str) -> None:
    """What is not specified is malformed, and nothing is assumed to be 0."""
    content = _content()
    MALFORMED[name](content)
    assert isinstance(check(data(content)), Malformed)


def test_a_channel_without_a_column_is_read_by_no_set() -> None:
    """Its values have no slot, so nothing could bound them."""
    model = ps.PersidskiiModel([[-1.0]], [("x**3", None, [[0.0]])], [[1.0]])
    assert prove_members(model, [Deviation.of_row(0, 1, 1e-4 * np.eye(3))]) is None
    content = json.loads(prove_members(model, []).data)
    content["deviations"] = [{"state": 0, "C": [[[1, [1, -20]]]]}]
    assert isinstance(check(data(content)), Malformed)
