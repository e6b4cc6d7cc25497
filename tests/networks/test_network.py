"""Claim L1: weights found, their certificates and obstructions, sparse models and their files."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy import ndarray

import persid as ps
import persid_check
from persid.networks.certificate import NetworkCertificate, NetworkObstruction, certify_network

FUNCTIONS = ("tanh(x)", "x**3", "sinh(x)", "arctan(x)")


def quiet(line: str) -> None:
    """Say nothing."""


def ring(n: int, here: float, left: float, right: float) -> sp.csc_array:
    """Return the matrix of a ring of n nodes."""
    k = np.arange(n)
    rows, columns = np.concatenate([k, k, k]), np.concatenate([k, (k + 1) % n, (k - 1) % n])
    return sp.csc_array((np.repeat([here, right, left], n).astype(float), (rows, columns)), shape=(n, n))


def ring_model(n: int, coupling: float) -> ps.PersidskiiModel:
    """Return a ring of n nodes with four functions, two of which couple neighbours, and two inputs."""
    terms = [
        ("tanh(x)", None, ring(n, -1.0, 0.2, -0.1)),
        ("x**3", None, ring(n, -1.0, 0.0, 0.0)),
        ("sinh(x)", None, ring(n, -0.1, 0.0, 0.0)),
        ("arctan(x)", None, ring(n, -0.5, 0.1, 0.1)),
    ]
    B = sp.csc_array((np.ones(2), ([0, 1], [0, 1])), shape=(n, 2))
    return ps.PersidskiiModel(ring(n, -2.0, coupling, coupling), terms, B)


def random_model(rng: np.random.Generator, n: int, size: float) -> ps.PersidskiiModel:
    """Return a small dense network with coefficients of mixed sign, scaled arguments, and a constant b."""
    A0 = size * rng.normal(size=(n, n)) - np.diag(rng.uniform(0.5, 3, n))
    terms = []
    for f in rng.choice(FUNCTIONS, 2, replace=False):
        A = size * rng.normal(size=(n, n)) * (0.0 if f in ("x**3", "sinh(x)") else 1.0)
        terms.append((str(f), np.diag(rng.choice([0.5, 1.0, 2.0], n)), A - np.diag(rng.uniform(0, 1, n))))
    return ps.PersidskiiModel(A0, terms, rng.normal(size=(n, 1)), b=rng.normal(size=n))


def test_a_ring_is_certified_and_its_certificate_read_back(tmp_path: Path) -> None:
    """A ring of 500 nodes is certified; the saved file is accepted against the saved model, and read back."""
    model = ring_model(500, 0.5)
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Certified), verdict
    assert verdict.certificate.claim == "L1"
    verdict.certificate.save(tmp_path / "ring.cert.json")
    model.save(tmp_path / "ring.json")
    result = persid_check.check(tmp_path / "ring.cert.json", tmp_path / "ring.json")
    assert isinstance(result, ps.Accepted), result
    loaded = ps.load_certificate(tmp_path / "ring.cert.json")
    assert loaded.data == verdict.certificate.data
    assert loaded.model.sha256 == model.sha256
    assert loaded.rate == verdict.certificate.rate > 2
    assert isinstance(ps.check(loaded, model), ps.Accepted)
    assert isinstance(ps.check(loaded, ring_model(500, 0.4)), ps.Rejected)


@pytest.mark.parametrize("order", [sorted, lambda names: sorted(names, reverse=True)], ids=["sorted", "reversed"])
@pytest.mark.parametrize("n", [5, 500])
def test_a_certificate_is_known_by_its_claim_not_by_its_bytes(tmp_path: Path, n: int, order: Any) -> None:
    """A file written compactly, its fields in any order, loads as the same claim; the checker accepts it, too."""
    certificate = certify_network(ring_model(n, 0.5), True, quiet)
    assert isinstance(certificate, NetworkCertificate)
    certificate.save(tmp_path / "ring.json")
    shuffled = {name: certificate.content[name] for name in order(certificate.content)}
    (tmp_path / "ring.json").write_text(json.dumps(shuffled, separators=(",", ":")), encoding="utf-8")
    assert isinstance(ps.check(tmp_path / "ring.json"), ps.Accepted)
    loaded = ps.load_certificate(tmp_path / "ring.json")
    assert isinstance(loaded, NetworkCertificate)
    assert loaded.rate == certificate.rate
    assert loaded.model.sha256 == certificate.model.sha256


@pytest.mark.parametrize(
    "text", [b"", b"[]", b"{", b'{"claim": "L1"}', b'{"claim": "L1", "companion": {"npz": "../w.npz"}}', b"\xff"]
)
def test_what_is_no_certificate_is_refused_by_name(tmp_path: Path, text: bytes) -> None:
    """Bytes that hold no certificate are refused with the checker's reason, whatever they are."""
    (tmp_path / "none.json").write_bytes(text)
    with pytest.raises(ps.RejectedError, match="the checker does not accept it"):
        ps.load_certificate(tmp_path / "none.json")


@pytest.mark.parametrize("member", ["w", "A0.values", "A0.rows", "terms.3.A.starts", "B.values"])
def test_a_changed_companion_is_malformed(tmp_path: Path, member: str) -> None:
    """A companion with one number changed is malformed, even if the file names its hash; weights are rejected then."""
    import hashlib

    from persid.models.sparse import archive
    from persid_check.companion import read

    certificate = certified(ring_model(500, 0.5))
    arrays = {name: values.copy() for name, values in read(certificate.arrays or b"").items()}
    arrays[member][1] = -arrays[member][1] if arrays[member].dtype.kind == "f" else arrays[member][1] + 1
    changed = archive(arrays)
    assert isinstance(persid_check.check(certificate.data, arrays=changed), ps.Malformed)
    content = json.loads(certificate.data)
    content["companion"]["sha256"] = hashlib.sha256(changed).hexdigest()
    wanted = ps.Rejected if member == "w" else ps.Malformed
    assert isinstance(persid_check.check(json.dumps(content).encode(), arrays=changed), wanted)


def certified(model: ps.PersidskiiModel) -> NetworkCertificate:
    """Return the certificate of claim L1 of a model."""
    found = certify_network(model, True, quiet)
    assert isinstance(found, NetworkCertificate), found
    return found


def test_companions_are_read_strictly() -> None:
    """Compressed members, other types, pickles, dimensions, other sizes and files that are no zip are refused."""
    import io
    import zipfile

    from persid_check.companion import read

    def stored(values: Any, name: str = "a.npy", method: int = zipfile.ZIP_STORED, cut: int = 0) -> bytes:
        inner, outer = io.BytesIO(), io.BytesIO()
        np.save(inner, values)
        with zipfile.ZipFile(outer, "w", method) as archive:
            archive.writestr(name, inner.getvalue()[: len(inner.getvalue()) - cut])
        return outer.getvalue()

    good = np.arange(5.0)
    assert (read(stored(good))["a"] == good).all()
    bad = [
        stored(good, method=zipfile.ZIP_DEFLATED),
        stored(good.astype(np.float32)),
        stored(good.astype(">f8")),
        stored(good.reshape(1, 5)),
        stored(np.array([None, {}], dtype=object)),
        stored(good, cut=8),
        stored(good, name="a.txt"),
        b"PK",
        b"",
    ]
    for data in bad:
        with pytest.raises(persid_check.FormatError):
            read(data)


@pytest.mark.parametrize("name", ["../a.npz", "/a.npz", "a", ".npz", "a/b.npz", "a\\b.npz", "a\n.npz"])
def test_companions_have_plain_names(name: str, tmp_path: Path) -> None:
    """A companion outside the folder of its file is refused by its name."""
    from persid_check.companion import load

    with pytest.raises(persid_check.FormatError, match="plain file name"):
        load({"npz": name, "sha256": "0" * 64}, "companion", tmp_path)


def estimate(certificate: NetworkCertificate, model: ps.PersidskiiModel, rng: np.random.Generator) -> ndarray:
    """Return by how much V' exceeds -kappa V + sum of gains at random pairs of states and inputs: never positive."""
    w, kappa = certificate.w, certificate.rate
    found = []
    for scale in (1e-3, 0.3, 1.0, 3.0, 6.0):
        x, other = scale * rng.normal(size=(2, 200, model.n))
        u, v = rng.normal(size=(2, 200, model.m))
        d = x - other
        slope = np.sum(w * np.sign(d) * (model.rhs(x, u) - model.rhs(other, v)), axis=1)
        beta = kappa * certificate.gains
        found.append((slope + kappa * np.abs(d) @ w - np.abs(u - v) @ beta) / (1 + np.abs(slope)))
    return np.concatenate(found)


@pytest.mark.long
def test_what_is_certified_decreases_everywhere() -> None:
    """Of random networks, those certified about every equilibrium contract at random pairs of states and inputs."""
    rng = np.random.default_rng(3)
    count = 0
    for _ in range(16):
        n = int(rng.integers(1, 6))
        model = random_model(rng, n, rng.uniform(0.05, 0.6) / n)
        found = certify_network(model, False, quiet)
        if isinstance(found, NetworkCertificate):
            count += 1
            assert found.every_input
            assert estimate(found, model, rng).max() < 1e-12
    assert count >= 5


def test_solutions_stay_below_the_bound() -> None:
    """Simulated runs of a certified network with a constant b stay below the bound about its equilibrium."""
    rng = np.random.default_rng(5)
    model = random_model(rng, 3, 0.1)
    certificate = certified(model)
    assert np.abs(model.rhs(certificate.operating_point)).max() < 1e-9
    t = np.linspace(0, 4, 81)
    for _ in range(3):
        x0, u = 2 * rng.normal(size=3), rng.uniform(-1, 1, (81, 1))
        run = model.simulate(x0, t, u)[0]
        away = np.linalg.norm(run.x - certificate.operating_point, axis=1)
        assert (away <= certificate.bound(x0, 1.0, t) + 1e-6).all()
        weighted = certificate.V(x0[None])[0] * np.exp(-certificate.rate * t) + certificate.gains.sum()
        assert (certificate.V(run.x) <= weighted + 1e-6).all()


def test_linear_networks_reach_the_spectral_abscissa() -> None:
    """For x' = M x with M Metzler the best weighted l1 rate is -max Re eig M: RATE_SHARE of it, or more, is found."""
    M = np.array([[-3.0, 1.0, 0.2], [0.5, -2.0, 0.3], [0.1, 0.7, -1.5]])
    certificate = certified(ps.PersidskiiModel(M))
    abscissa = -np.linalg.eigvals(M).real.max()
    assert 0.89 * abscissa < certificate.rate <= abscissa


def test_weights_may_differ_by_many_orders() -> None:
    """A cascade with gains of 100 from node to node needs weights that grow by 100 from node to node, and gets them."""
    n = 5
    certificate = certified(ps.PersidskiiModel(-np.eye(n) + 100 * np.eye(n, k=-1)))
    assert certificate.w[0] / certificate.w[-1] > 1e7


@pytest.mark.parametrize("n", [3, 500, 9000])
def test_a_strong_coupling_is_proved_to_be_out_of_reach(n: int, tmp_path: Path) -> None:
    """A ring whose coupling exceeds its decay has no weights: the obstruction is accepted, for part of a large ring."""
    found = certify_network(ring_model(n, 5.0), True, quiet)
    assert isinstance(found, NetworkObstruction)
    found.save(tmp_path / "obstruction.json")
    result = persid_check.check(tmp_path / "obstruction.json")
    assert isinstance(result, ps.Accepted)
    assert "stability is not refuted" in result.statement


def test_an_obstruction_that_is_none_is_rejected() -> None:
    """z = 0, a negative z, and the obstruction of a strong ring in the file of a weak one are rejected."""
    found = certify_network(ring_model(3, 5.0).dense(), True, quiet)
    assert isinstance(found, NetworkObstruction)
    weak = ring_model(3, 0.1).dense()
    form = {"model": persid_check.canonical_model(weak.to_dict()), "model_sha256": weak.sha256}
    for change in ({"z": [[0, 0]] * 3}, {"z": [[1, 0], [1, 0], [-1, 0]]}, form):
        result = persid_check.check(json.dumps({**found.content, **change}).encode())
        assert isinstance(result, ps.Rejected), result


def test_one_growing_node_is_an_obstruction() -> None:
    """x' = x + u beside a stable node, and x' = -tanh x + u, have no weights; the second by a ray with a small tanh."""
    for model in (
        ps.PersidskiiModel(np.diag([-1.0, 1.0]), B=np.ones((2, 1))),
        ps.PersidskiiModel(np.zeros((1, 1)), [("tanh(x)", None, [[-1.0]])], [[1.0]]),
    ):
        assert isinstance(certify_network(model, True, quiet), NetworkObstruction)


@pytest.mark.parametrize(
    "model",
    [
        ps.PersidskiiModel([[2.0]], [("sinh(x)", [[0.1]], [[-10.0]])]),
        ps.PersidskiiModel([[1.0]], [("tanh(x)", None, [[0.0]])]),
        ps.PersidskiiModel([[1.0]], [("sinh(x)", None, [[0.0]])], [[1.0]]),
        ps.PersidskiiModel([[0.0]], [("tanh(x)", None, [[-1.0]])], [[1.0]]),
        ps.PersidskiiModel([[0.0]], [("deadzone(x)", None, [[-1.0]])], [[1.0]]),
        ps.PersidskiiModel([[0.0, 1.0], [0.0, 0.0]], [("tanh(x)", None, [[0.0, 0.0], [-1.0, -1.0]])]),
    ],
    ids=["rows not normalised", "zero column", "absent sinh", "tanh alone", "dead zone", "B = 0"],
)
def test_models_that_are_not_stable_get_no_weights(model: ps.PersidskiiModel) -> None:
    """No model of the theory's list of temptations is certified by a weighted l1 norm."""
    assert not isinstance(certify_network(model, True, quiet), NetworkCertificate)


def test_sparse_and_dense_matrices_are_one_model_up_to_400_states() -> None:
    """A sparse model and the same one filled in have one hash, one right side, one Jacobian, one simulation."""
    model = ring_model(30, 0.5)
    dense, x = model.dense(), np.linspace(-1, 1, 30)
    assert model.is_sparse
    assert not dense.is_sparse
    assert model.sha256 == dense.sha256
    assert np.allclose(model.rhs(x), dense.rhs(x))
    assert np.allclose(model.jacobian(x).toarray(), dense.jacobian(x))
    t = np.linspace(0, 1, 5)
    assert np.array_equal(model.simulate(x, t)[0].x, dense.simulate(x, t)[0].x)


@pytest.mark.parametrize("n", [30, 450])
def test_sparse_models_are_saved_exactly(tmp_path: Path, n: int) -> None:
    """A sparse model read back has the same numbers and hash; a large one stands in a companion of the same stem."""
    model = ring_model(n, 0.1 + math.pi)
    model.save(tmp_path / "ring.json")
    assert (tmp_path / "ring.npz").is_file() == (n > 400)
    loaded = ps.load_model(tmp_path / "ring.json")
    assert loaded.sha256 == model.sha256
    assert (loaded.A0 != model.A0).nnz == 0
    assert [term.f for term in loaded.terms] == [term.f for term in model.terms]


def test_a_false_companion_of_a_model_is_refused(tmp_path: Path) -> None:
    """A companion that is missing, or has another hash, is a ModelError that names it."""
    ring_model(450, 0.1).save(tmp_path / "ring.json")
    (tmp_path / "ring.npz").write_bytes((tmp_path / "ring.npz").read_bytes()[:-1] + b"x")
    with pytest.raises(ps.ModelError, match=r"ring\.npz has another SHA-256"):
        ps.load_model(tmp_path / "ring.json")
    (tmp_path / "ring.npz").unlink()
    with pytest.raises(ps.ModelError, match=r"ring\.npz"):
        ps.load_model(tmp_path / "ring.json")


def test_scaled_and_repeated_functions_have_their_own_slots() -> None:
    """Several rows on one node, with different factors, in a sparse model give the same certificate as a dense one."""
    n = 450
    k = np.arange(n)
    R = sp.csc_array((np.tile([0.5, 2.0], n), (np.arange(2 * n), np.repeat(k, 2))), shape=(2 * n, n))
    A = sp.csc_array((np.tile([-1.0, 0.25], n), (np.repeat(k, 2), np.arange(2 * n))), shape=(n, 2 * n))
    model = ps.PersidskiiModel(ring(n, -2.0, 0.2, 0.3), [("tanh(x)", R, A)])
    certificate = certified(model)
    (kind,) = certificate.content["kinds"]
    assert [m * 2.0**e for _, (m, e) in kind["functions"]] == [0.5, 2.0]
    small = certified(ps.PersidskiiModel(ring(5, -2.0, 0.2, 0.3), [("tanh(x)", R[:10, :5], A[:5, :10])]))
    assert certificate.rate == pytest.approx(small.rate, rel=1e-6)


def test_the_command_line_certifies_a_sparse_model_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`persid certify` on a model with a companion writes the certificate and its companion; `persid check` accepts."""
    from persid.commands.cli import main

    ring_model(450, 0.5).save(tmp_path / "ring.json")
    out = str(tmp_path / "out" / "ring.cert.json")
    assert main(["certify", str(tmp_path / "ring.json"), "-o", out, "--quiet"]) == 0
    assert len(list((tmp_path / "out").glob("network-*.npz"))) == 1
    assert main(["check", out, "--model", str(tmp_path / "ring.json")]) == 0
    assert "claim L1" in capsys.readouterr().out


def test_a_large_ring_keeps_the_rate_of_a_small_one() -> None:
    """Cones of larger networks have fewer generators, still enough for four functions a node."""
    assert certified(ring_model(80_000, 0.5)).rate == pytest.approx(certified(ring_model(100, 0.5)).rate, rel=0.01)


@pytest.mark.slow
def test_a_million_states() -> None:
    """A ring of a million states with four functions is certified."""
    assert certified(ring_model(1_000_000, 0.5)).rate > 2


@pytest.mark.parametrize("sparse", [False, True])
def test_gains_are_not_lost_to_underflow(monkeypatch: pytest.MonkeyPatch, sparse: bool) -> None:
    """An input with a tiny effect has a gain above zero, and one without an effect has none."""
    A0, B = -np.eye(2), np.array([[2.0**-1060, 0.0], [0.0, 0.0]])
    model = ps.PersidskiiModel(sp.csc_array(A0), [], sp.csc_array(B)) if sparse else ps.PersidskiiModel(A0, [], B)
    found = certify_network(model, True, quiet)
    assert isinstance(found, NetworkCertificate)
    monkeypatch.setattr(NetworkCertificate, "w", np.full(2, 2.0**-30))  # products below the least number there is
    assert found.gains[0] > 0
    assert found.gains[1] == 0
    assert found.gain > 0
