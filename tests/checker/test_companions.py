"""Ledgers of large models: matrices in a companion, read strictly, mean what they mean when they are written out."""

import hashlib
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import persid as ps
from checker.ledgers import Sketch, data, draft
from checker.maker import model as model_object
from persid.certificates import encoding
from persid.certificates.certificate import Certificate
from persid.certificates.encoding import separated
from persid.models.sparse import archive
from persid_check import Accepted, Malformed, Rejected, canonical_model, check, flint_matrix, sparse
from persid_check.ledger import arrays as ledger_arrays
from persid_check.results import FormatError

Arrays = dict[str, np.ndarray]


@cache
def content() -> dict[str, Any]:
    """A small certificate whose matrices are proved by roots."""
    A = [[-3.0, 1.0, 0.5], [0.0, -2.0, 1.0], [0.25, 0.0, -2.0]]
    model = ps.PersidskiiModel(
        A0=A,
        terms=[("tanh(x)", None, A), ("x**3", np.eye(3)[:2], np.ones((3, 2)) / 64 - np.eye(3)[:, :2])],
        B=[[1.0], [0.0], [0.5]],
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flint_matrix, "LARGE", 1)
        answer = ps.certify(model, time_limit=20)
        assert isinstance(answer, ps.Certified)
        found = answer.certificate.content
    assert isinstance(found["proof"]["M"], dict)
    return dict(found)


def apart(monkeypatch: pytest.MonkeyPatch) -> tuple[dict[str, Any], Arrays]:
    """The content with its matrices apart, and these."""
    found = content()
    monkeypatch.setattr(encoding, "BESIDE", 1)
    monkeypatch.setattr(encoding, "LISTED", 1)
    return separated(found)


def joined(stated: dict[str, Any], arrays: Arrays) -> tuple[bytes, bytes]:
    """The bytes of a file and of its companion, the hash of which fits."""
    beside = archive(arrays)
    return data(stated | {"companion": {"npz": "a.npz", "sha256": hashlib.sha256(beside).hexdigest()}}), beside


def test_matrices_in_a_companion_are_proved_as_those_in_the_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The same sentence, model and hash, from bytes and from a folder; the model is compared by it."""
    _, arrays = apart(monkeypatch)
    assert sorted(arrays) == ["A0", "B", "proof.M", "proof.P", "terms.0.A", "terms.1.A", "terms.1.R"]
    found = Certificate.of(content())
    whole = check(data(content()))
    assert isinstance(whole, Accepted)
    assert found.statement == whole.statement
    assert len(found.data) < len(data(content()))
    found.save(tmp_path / "certificate.json")
    loaded = ps.load_certificate(tmp_path / "certificate.json")
    assert loaded.model == found.model == ps.PersidskiiModel.from_canonical(content()["model"])
    assert isinstance(check(tmp_path / "certificate.json"), Accepted)
    assert isinstance(ps.check(found, found.model), Accepted)
    other = ps.PersidskiiModel.from_dict(found.model.to_dict() | {"b": [1.0, 0.0, 0.0]})
    assert isinstance(ps.check(found, other), Rejected)
    (next(tmp_path.glob("*.npz"))).unlink()
    assert isinstance(check(tmp_path / "certificate.json"), Malformed)


FORGERIES: dict[str, Callable[[dict[str, Any], Arrays], object]] = {
    "a number of A0 is infinite": lambda stated, arrays: arrays["A0"].__setitem__(0, np.inf),
    "a number of A is none": lambda stated, arrays: arrays["terms.0.A"].__setitem__(2, np.nan),
    "A0 is short": lambda stated, arrays: arrays.update(A0=arrays["A0"][:-1]),
    "A0 is a row too short": lambda stated, arrays: arrays.update(A0=arrays["A0"][:-3]),
    "A0 is of integers": lambda stated, arrays: arrays.update(A0=arrays["A0"].astype("<i8")),
    "L is of floats": lambda stated, arrays: arrays.update({"proof.M": arrays["proof.M"].astype("<f8")}),
    "L is short": lambda stated, arrays: arrays.update({"proof.M": arrays["proof.M"][:-1]}),
    "L is long": lambda stated, arrays: arrays.update({"proof.M": np.append(arrays["proof.M"], 1)}),
    "an array is missing": lambda stated, arrays: arrays.pop("terms.1.R"),
    "two matrices are one array": lambda stated, arrays: stated["model"]["terms"][0].update(A="A0"),
    "x_ref is a name": lambda stated, arrays: stated["model"].update(x_ref="A0"),
    "the states are a name": lambda stated, arrays: stated["model"].update(states="A0"),
    "a matrix of P is a name": lambda stated, arrays: stated.update(P={"lower": "A0"}),
    "V is a root": lambda stated, arrays: stated["proof"].update(V=stated["proof"]["M"]),
    "a factor is a name": lambda stated, arrays: stated["proof"].update(M="proof.M"),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_companions_that_are_not_as_specified_are_malformed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers that are not finite, arrays of another size or kind, missing ones, and names where none may stand."""
    stated, arrays = apart(monkeypatch)
    stated, arrays = json.loads(json.dumps(stated)), {key: array.copy() for key, array in arrays.items()}
    assert isinstance(check(*joined(stated, arrays)[:1], arrays=joined(stated, arrays)[1]), Accepted)
    FORGERIES[name](stated, arrays)
    file, beside = joined(stated, arrays)
    assert isinstance(check(file, arrays=beside), Malformed)


@pytest.mark.parametrize("key", ["A0", "terms.1.A", "terms.1.R", "B"])
def test_another_model_in_the_companion_is_rejected(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One number of a matrix changed in its last place has another hash."""
    stated, arrays = apart(monkeypatch)
    arrays = arrays | {key: np.nextafter(arrays[key], 9)}
    file, beside = joined(stated, arrays)
    answer = check(file, arrays=beside)
    assert isinstance(answer, Rejected)
    assert answer.where == "model_sha256"


@pytest.mark.parametrize("key", ["proof.M", "proof.P"])
def test_another_root_in_the_companion_is_rejected(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Roots of nothing, of extreme integers and with the sign of one entry changed prove nothing."""
    stated, arrays = apart(monkeypatch)
    extreme = np.full_like(arrays[key], -(2**63))
    flipped = arrays[key].copy()
    flipped[0] += max(1, abs(int(flipped[0])))
    for forged in (extreme, extreme - 1, flipped):
        file, beside = joined(stated, arrays | {key: forged})
        answer = check(file, arrays=beside)
        assert isinstance(answer, Rejected), answer
        assert answer.where == key


def test_a_companion_is_needed_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another hash, another name, no file and one too long are malformed; so it is without NumPy, with a hint."""
    file, beside = joined(*apart(monkeypatch))
    assert isinstance(check(file), Malformed)
    assert isinstance(check(file, arrays=beside + b"0"), Malformed)
    assert isinstance(check(file.replace(b"a.npz", b"../a.npz"), arrays=beside), Malformed)
    monkeypatch.setattr(ledger_arrays, "LONGEST", len(beside) - 1)
    assert isinstance(check(file, arrays=beside), Malformed)
    monkeypatch.setattr(ledger_arrays, "LONGEST", len(beside))
    assert isinstance(check(file, arrays=beside), Accepted)
    monkeypatch.setitem(__import__("sys").modules, "numpy", None)
    answer = check(file, arrays=beside)
    assert isinstance(answer, Malformed)
    assert "pip install numpy" in answer.why


def test_products_of_long_numbers_are_limited_by_the_length_of_a_file() -> None:
    """A linear term of 250 states whose numbers spread over all exponents: 5 MB with several took minutes."""
    n = 250
    exponents = np.random.default_rng(0).integers(-1070, 1020, (2, n * n))
    A, R = np.ldexp(1.0, exponents)
    zeros = [[0.0] * n] * n
    stated = draft(Sketch(model_object([("x", None, zeros)], zeros, [[]] * n, n=n), [], [], [], full=False))
    stated["model"]["terms"] = [{"f": "x", "R": "R", "A": "A"}]
    written, beside = joined(stated, {"A": A, "R": R})
    answer = check(written, arrays=beside)
    assert isinstance(answer, Rejected)
    assert "products of its matrices are too long for a file of this length" in answer.why


def test_sparse_rows_are_counted_before_they_are_filled_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model of 200 bytes with 50,000 rows of 400 entries took 3.4 GB before it was refused."""
    monkeypatch.setattr(sparse, "filled", lambda _: pytest.fail("filled in"))
    term = {
        "f": "tanh(x)",
        "R": {"shape": [50_000, 400], "coo": [[0], [0], [1.0]]},
        "A": {"shape": [400, 50_000], "coo": [[0], [0], [1.0]]},
    }
    with pytest.raises(FormatError, match="more than 3000 channels"):
        canonical_model({"format": "persid-model-1", "states": 400, "terms": [term], "B": None})
