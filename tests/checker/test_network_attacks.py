"""Forged files of claim L1: false sums, foreign hashes, broken arrays and bombs; every one must be refused."""

import hashlib
import io
import json
import random
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from persid_check import Accepted, Malformed, Rejected, canonical_model, check, companion, model_sha256
from persid_check.model import model_of, sha256_of
from persid_check.networks.cone import generators
from persid_check.networks.nodes import nodes_of
from persid_check.networks.table import Table, doubtful, table_of_sparse
from persid_check.results import FormatError, NotProvedError
from persid_check.sparse import filled, read_sparse
from persid_check.work import limited

N = 401  # the smallest network form
TANH = ([("tanh(x)", 1.0)], [(1, 0), (0, 1), (1, -1)])
Entries = Sequence[tuple[int, int, float]]


def dyadic(number: float | Fraction) -> list[int]:
    """Return [m, e] with number = m 2^e."""
    top, bottom = Fraction(number).as_integer_ratio()
    return [top, 1 - bottom.bit_length()]


def member(values: np.ndarray, *, shape: str = "", kind: str = "", more: bytes = b"") -> bytes:
    """Return an .npy file of an array, with a false header if one is given."""
    names = {"f8": "<f8", "i8": "<i8", "i4": "<i4", "f4": "<f4"}
    head = f"{{'descr': '{kind or names[values.dtype.str[1:]]}', 'fortran_order': False, "
    head += f"'shape': {shape or f'({len(values)},)'}, }}\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + values.tobytes() + more


def packed(members: dict[str, Any], how: int = zipfile.ZIP_STORED) -> bytes:
    """Return a zip file of arrays, or of members as they are."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", how) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content if isinstance(content, bytes) else member(content))
    return target.getvalue()


def columns(name: str, entries: Entries, width: int) -> dict[str, np.ndarray]:
    """Return the three arrays of a matrix with entries (row, column, value)."""
    ordered = sorted(entries, key=lambda entry: (entry[1], entry[0]))
    rows, places, values = (np.array([entry[part] for entry in ordered]) for part in range(3))
    starts = np.searchsorted(places, np.arange(width + 1)) if len(places) else np.zeros(width + 1)
    return {
        f"{name}.starts": starts.astype("<i8"),
        f"{name}.rows": rows.astype("<i8"),
        f"{name}.values": values.astype("<f8"),
    }


@dataclass
class Network:
    """A large network x' = A0 x + A f(x) + B u, and the claim made of it."""

    A0: Entries = field(default_factory=lambda: [(i, i, -2.0) for i in range(N)])
    A: Entries = ()
    f: Any = "tanh(x)"
    R: Entries | None = None
    B: Entries = ((0, 0, 1.0),)
    inputs: tuple[str, ...] = ("u1",)
    b: float = 0.0
    kinds: Sequence[Any] = (([], []),)
    w: Any = None
    kappa: float | Fraction = 0.5
    every: bool = True
    n: int = N

    def form_and_arrays(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the network form and the arrays of the companion."""
        height = self.n if self.R is None else 1 + max(row for row, _, _ in self.R)
        arrays = columns("A0", self.A0, self.n) | columns("B", self.B, len(self.inputs))
        terms = []
        if self.A:
            terms = [{"f": self.f, "R": None if self.R is None else {"shape": [height, self.n]}, "A": None}]
            arrays |= columns("terms.0.A", self.A, height)
        if self.R is not None:
            arrays |= columns("terms.0.R", self.R, self.n)
        if self.b:
            arrays["b"] = np.array([self.b] + [0.0] * (self.n - 1))
        skeleton = {
            "format": "persid-model-1",
            "states": self.n,
            "inputs": list(self.inputs),
            "u_ref": [(0.0).hex()] * len(self.inputs),
            "terms": terms,
            "B": None,
        }
        return read_sparse(skeleton, arrays).form(), arrays

    def forged(
        self, change: Callable[[dict[str, Any]], Any] = lambda content: None, how: int = zipfile.ZIP_STORED, **more: Any
    ) -> Any:
        """Return the checker's answer, after changes of the file and of the arrays (None: left out)."""
        form, arrays = self.form_and_arrays()
        arrays["w"] = np.asarray(np.ones(self.n) if self.w is None else self.w)
        whole = {
            k: v for k, v in {**arrays, **{k.replace("_", "."): v for k, v in more.items()}}.items() if v is not None
        }
        data = packed(whole, how)
        content = {
            "format": "persid-certificate-1",
            "claim": "L1",
            "statement": "",
            "model_sha256": sha256_of(form),
            "model": form,
            "operating_point": "every" if self.every else "reference",
            "kinds": [
                {
                    "functions": [[text, dyadic(alpha)] for text, alpha in functions],
                    "forms": [[dyadic(c) for c in row] for row in forms],
                }
                for functions, forms in self.kinds
            ],
            "kappa": dyadic(self.kappa),
            "weights": None,
            "companion": {"npz": "c.npz", "sha256": hashlib.sha256(data).hexdigest()},
        }
        change(content)
        return check(json.dumps(content).encode(), arrays=data)


def test_a_true_network_is_accepted() -> None:
    """What the attacks start from is accepted."""
    assert isinstance(Network().forged(), Accepted)
    assert isinstance(Network(A=[(0, 1, 0.5), (2, 1, 0.5)], kinds=[([], []), TANH]).forged(), Accepted)


@pytest.mark.parametrize("text", ["x", "(x)", "+x"])
def test_a_linear_term_is_merged_however_it_is_spelled(text: str) -> None:
    """A large network whose term is x alone is rejected: its linear terms belong to A0."""
    result = Network(A=[(0, 1, 0.5)], f=text, kinds=[([], []), ([(text, 1.0)], [(0, 1)])]).forged()
    assert isinstance(result, Rejected)
    assert "merged" in result.why


@pytest.mark.parametrize("every", [True, False])
def test_a_gain_that_underflows_is_not_zero(every: bool) -> None:
    """|B|'w of 2^-1300 underflows to 0 in binary64; the estimate names its input all the same, and so b's."""
    tiny = 2.0**-1000
    result = Network(B=[(0, 0, tiny)], b=tiny, w=np.full(N, 2.0**-300), every=every).forged()
    assert isinstance(result, Accepted)
    assert "sup|u1 - u1*|" in result.statement
    assert ("sup|v|" in result.statement) != every


def test_inputs_are_called_by_their_own_names() -> None:
    """The gain of an input named u2 that stands first is not printed as one of u1."""
    result = Network(inputs=("u2", "u1"), B=[(0, 0, 1.0), (0, 1, 5.0)]).forged()
    assert "sup|'u2' - 'u2'*| + 10.0001 sup|'u1' - 'u1'*|" in result.statement


def test_one_network_has_one_hash() -> None:
    """`true` for 1 and a network form of a small model would give a model a second hash: both are malformed."""

    def true_for_one(content: dict[str, Any]) -> None:
        content["model"]["B"]["entries"] = True
        content["model_sha256"] = sha256_of(content["model"])

    assert isinstance(Network().forged(true_for_one), Malformed)
    assert isinstance(Network(A0=[(0, 0, -2.0), (1, 1, -2.0)], n=2).forged(), Malformed)


def other_hash(content: dict[str, Any]) -> None:
    """Put the hash of another model."""
    content["model_sha256"] = sha256_of(Network(B=[(0, 0, 2.0)]).form_and_arrays()[0])


def other_model(content: dict[str, Any]) -> None:
    """Put another model with its hash beside the old arrays."""
    content["model"] = Network(B=[(0, 0, 2.0)]).form_and_arrays()[0]
    content["model_sha256"] = sha256_of(content["model"])


def test_arrays_of_another_model_are_refused() -> None:
    """Neither the hash nor the form of another model goes with the arrays."""
    assert isinstance(Network().forged(other_hash), Rejected)
    assert isinstance(Network().forged(other_model), Malformed)
    other = {"B": {"shape": [N, 1], "entries": 1, "sha256": "0" * 64}}
    assert isinstance(Network().forged(lambda content: content["model"].update(other)), Malformed)


@pytest.mark.parametrize(
    "w",
    [
        np.ones(N - 1),
        np.ones(N + 1),
        np.ones(N, np.int64),
        np.where(np.arange(N) == 7, np.nan, 1.0),
        np.where(np.arange(N) == 7, np.inf, 1.0),
        np.where(np.arange(N) == 7, 0.0, 1.0),
        np.where(np.arange(N) == 7, -0.0, 1.0),
        np.where(np.arange(N) == 7, -1.0, 1.0),
        np.where(np.arange(N) == 7, 5e-324, 1.0),
        np.where(np.arange(N) == 7, 1e300, 1.0),
    ],
    ids=["short", "long", "integers", "nan", "inf", "0", "-0", "-1", "subnormal", "1e300"],
)
def test_false_weights_are_refused(w: np.ndarray) -> None:
    """Weights of a wrong length or type, not positive, not finite, or too far from 1 to be summed are refused."""
    assert isinstance(Network(w=w).forged(), Rejected | Malformed)


@pytest.mark.parametrize(
    ("starts", "rows", "values"),
    [
        ([0, 2], [1, 0], [1.0, 1.0]),
        ([0, 2], [0, 0], [1.0, -1.0]),
        ([0, 1], [0], [0.0]),
        ([0, 1], [0], [-0.0]),
        ([0, 1], [0], [np.nan]),
        ([0, 1], [0], [np.inf]),
        ([0, 1], [-1], [1.0]),
        ([0, 1], [N], [1.0]),
        ([1, 1], [0], [1.0]),
        ([0, 2], [0], [1.0]),
        ([0, -1], [0], [1.0]),
        ([0], [0], [1.0]),
        ([0, 1, 1], [0], [1.0]),
        ([0, 2], [0, 1], [1.0]),
        ([0, 1], [0.0], [1.0]),
        ([0.0, 1.0], [0], [1.0]),
        ([0, 1], [0], [1]),
        ([0, 1], None, [1.0]),
    ],
)
def test_broken_matrices_are_malformed(starts: Any, rows: Any, values: Any) -> None:
    """Unsorted, double, zero, infinite or foreign entries, and starts of another shape, are malformed."""
    arrays = {"B_starts": starts, "B_rows": rows, "B_values": values}
    given = {name: None if part is None else np.array(part) for name, part in arrays.items()}
    assert isinstance(Network().forged(**given), Malformed)


def test_starts_that_wrap_around_are_malformed() -> None:
    """Column starts in 32 bits that went through an overflow fall, and are malformed."""
    starts = np.arange(N + 1).astype("<i4")
    assert isinstance(Network().forged(A0_starts=starts), Accepted)
    starts[5] = np.int64(2**31 + 5).astype("<i4")
    assert isinstance(Network().forged(A0_starts=starts), Malformed)


@pytest.mark.parametrize(
    "content",
    [
        member(np.ones(N), shape=f"({N}, 1)"),
        member(np.ones(N), shape="()"),
        member(np.ones(N), shape="(999999999999,)"),
        member(np.ones(N), shape=f"(-{N},)"),
        member(np.ones(N), kind=">f8"),
        member(np.ones(N), kind="|O"),
        member(np.ones(N), kind="<c8"),
        member(np.ones(N, "<f4")),
        member(np.ones(N), more=b"more"),
        member(np.ones(N)).replace(b"False", b" True"),
        member(np.ones(N)).replace(b"\x01\x00", b"\x02\x00", 1),
        b"",
    ],
)
def test_broken_members_are_malformed(content: bytes) -> None:
    """Other dimensions, types, orders, versions and sizes than the specified ones are malformed."""
    assert isinstance(Network().forged(w=content), Malformed)


def test_compressed_members_are_malformed() -> None:
    """A compressed member could be a bomb."""
    assert isinstance(Network().forged(how=zipfile.ZIP_DEFLATED), Malformed)


def nested(count: int) -> bytes:
    """Return a zip file each of whose arrays holds all later ones in its data."""

    def local(name: str, content: bytes) -> bytes:
        sizes = (zlib.crc32(content), len(content), len(content), len(name), 0)
        return struct.pack("<4s5H3L2H", b"PK\3\4", 20, 0, 0, 0, 33, *sizes) + name.encode() + content

    names, contents, body = [f"a{i}.npy" for i in range(count)], [member(np.ones(8))], b""
    for name in names[:0:-1]:
        inner = local(name, contents[0])
        contents.insert(0, member(np.frombuffer(inner + bytes(-len(inner) % 8), "<f8")))
    body = local(names[0], contents[0])
    place, directory = -1, b""
    for name, content in zip(names, contents, strict=True):
        place = body.find(b"PK\3\4", place + 1)
        sizes = (zlib.crc32(content), len(content), len(content), len(name), 0, 0, 0, 0, 0, place)
        directory += struct.pack("<4s6H3L5H2L", b"PK\1\2", 20, 20, 0, 0, 0, 33, *sizes) + name.encode()
    return body + directory + struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, count, count, len(directory), len(body), 0)


def test_arrays_that_overlap_are_malformed() -> None:
    """Arrays that lie inside each other's data could take a thousand times the file's size."""
    with pytest.raises(FormatError):
        companion.read(nested(6))
    assert len(companion.read(nested(1))["a0"]) == 8


def test_a_name_twice_is_malformed() -> None:
    """Of two arrays with one name, nobody could know which was meant."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("w.npy", member(np.ones(N)))
        with pytest.warns(UserWarning, match="Duplicate"):
            archive.writestr("w.npy", member(np.zeros(N)))
    with pytest.raises(FormatError):
        companion.read(target.getvalue())


def test_damaged_companions_are_answered() -> None:
    """Whatever bytes are changed, a companion is read or refused, and never raises anything else."""
    good, rng = packed({"a": np.arange(5.0), "b": np.arange(3)}), random.Random(1)
    for _ in range(3000):
        damaged = bytearray(good)
        for _ in range(rng.choice([1, 2, 4])):
            damaged[rng.randrange(len(damaged))] = rng.choice([0, 1, 128, 255, rng.randrange(256)])
        try:
            companion.read(bytes(damaged[: rng.choice([None, rng.randrange(len(damaged))])]))
        except FormatError:
            continue


@pytest.mark.parametrize("name", ["../c.npz", "/c.npz", "a/c.npz", "..npz", "c.npy", ".c.npz", "c\x00.npz", "c.npz\n"])
def test_a_companion_is_a_plain_file_name(name: str) -> None:
    """Names that could lead elsewhere are malformed, whatever their content's hash."""
    assert isinstance(Network().forged(lambda content: content["companion"].update(npz=name)), Malformed)


@pytest.mark.parametrize("every", [True, False])
@pytest.mark.parametrize(
    ("network", "kinds"),
    [
        ({"A0": [(i, i, -2.0) for i in range(1, N)], "A": [(0, 0, -1.0)]}, [([], []), TANH]),
        ({"A0": [(i, i, -2.0) for i in range(1, N)]}, [([], [])]),
        ({"A": [(1, 0, 0.5)]}, [([], []), ([("tanh(x)", 1.0)], [])]),
        ({"A": [(1, 0, 0.5)]}, [([], []), ([("tanh(x)", 1.0)], [(0, 1), (0.999, -1)])]),
        ({"A": [(1, 0, 0.5)], "f": "1/x"}, [([], []), ([("1/x", 1.0)], [])]),
        ({"A": [(1, 0, 0.5)], "f": "cos(x)"}, [([], []), ([("cos(x)", 1.0)], [(0.99, -1), (0.99, 1)])]),
        ({"A": [(1, 0, 0.5)], "R": [(0, 0, -1.0)]}, [([], []), ([("tanh(x)", -1.0)], TANH[1])]),
        ({"A": [(1, 0, 0.5)], "R": [(0, 0, 1.0), (0, 1, 1.0)]}, [([], []), TANH]),
        ({"A": [(1, 0, 0.5)], "R": [(1, 0, 1.0)]}, [([], []), TANH]),
        ({"A": [(1, 0, 0.5)], "f": "x"}, [([], []), ([("x", 1.0)], [(1, -1), (-1, 1)])]),
        ({"A": [(1, 0, 0.5)]}, [TANH]),
        ({"A": [(1, 0, 0.5)]}, [([], [])]),
        ({"A": [(1, 0, 0.5)]}, [([], []), ([("tanh(x)", 0.5)], TANH[1])]),
        ({"A": [(i, 0, 0.5) for i in range(8)]}, [([], []), TANH]),
    ],
)
def test_false_claims_about_networks_are_refused(every: bool, network: dict[str, Any], kinds: Any) -> None:
    """Absent decay, missing or false forms, poles, rows of other shapes, kinds of other nodes: none is accepted."""
    assert isinstance(Network(**network, kinds=kinds, every=every, kappa=2.0**-60).forged(), Rejected | Malformed)


def test_one_function_at_two_scales_is_two_slots() -> None:
    """2 tanh(y/2) is no tanh(y): with their rows exchanged the forms are false."""
    R = [(0, 0, 1.0), (1, 0, 0.5)]
    forms = {1.0: [(0, 1, 0), (0, 0, 1), (1, 0, -2), (0, -1, 2)], 0.5: [(0, 1, 0), (0, 0, 1), (0, 2, -1), (1, 0, -1)]}
    base = {"A": [(1, 0, -1.0), (1, 1, 2.0)], "R": R}
    functions = [("tanh(x)", 1.0), ("tanh(x)", 0.5)]
    for rate, accepted in ((1.0, True), (0.5, False)):
        kinds = [([], []), (functions, forms[rate])]
        answer = Network(**base, kinds=kinds).forged()
        assert isinstance(answer, Accepted) == accepted
        swapped = Network(**base, kinds=[([], []), (functions[::-1], forms[rate])]).forged()
        assert isinstance(swapped, Malformed)


def test_a_kind_with_fewer_generators_is_summed_as_well() -> None:
    """Nodes of a kind with fewer generators than another one's are proved by bounded sums too."""
    result = Network(A=[(0, 0, -1.0)], kinds=[TANH, ([], [])]).forged()
    assert isinstance(result, Accepted)
    assert f"{N} nodes by bounded binary64 sums and 0 in fractions" in " ".join(result.steps)


@pytest.mark.parametrize("excess", [2.0**-53, 2.0**-200, 2.0**-290, 2.0**-1000, 5e-324])
def test_sums_that_binary64_cannot_tell_from_zero_are_refused(excess: float) -> None:
    """With the rate equal to the margin, a coupling far below a unit in the last place is found all the same."""
    A0 = [(i, i, -2.0) for i in range(N)]
    assert isinstance(Network(A0=A0, kappa=2.0).forged(), Accepted)
    assert isinstance(Network(A0=[*A0, (3, 0, excess)], kappa=2.0).forged(), Rejected)
    assert isinstance(Network(A0=A0, kappa=2 + Fraction(1, 2**1500)).forged(), Rejected)


def test_cancellation_within_an_entry_is_refused() -> None:
    """y - tanh y is in the cone for small y, so that 2^53 + 1 less 2^53 does not vanish by rounding."""
    big = 2.0**53
    A0 = [(i, i, -2.0) for i in range(N)] + [(1, 0, -big)]
    forms = [(1, -1), (-(1 - 2.0**-20), 1), (0, 1)]  # the second one is false
    assert isinstance(Network(A0=A0, A=[(1, 0, big)], kinds=[([], []), (TANH[0], forms)]).forged(), Rejected)
    assert isinstance(Network(A0=A0, A=[(1, 0, big)], kinds=[([], []), TANH]).forged(), Rejected)


def largest(table: Table, rays: Any, w: Any, kappa: Fraction, k: int) -> Fraction:
    """Return the largest sum of node k over its generators, by plain fractions."""
    totals = []
    for ray in rays[int(table.kind[k])]:
        sizes = {i: sum(a * v for a, v in zip(row, ray, strict=True)) for i, row in table.column(k).items()}
        parts = (Fraction(float(w[i])) * (T if i == k else abs(T)) for i, T in sizes.items())
        totals.append(sum(parts, kappa * Fraction(float(w[k])) * ray[0]))
    return max(totals)


@pytest.mark.parametrize("spread", [(0, 1), (-60, 60), (200, 310), (-1070, -1000)])
def test_bounded_sums_of_many_slots_and_kinds(spread: tuple[int, int]) -> None:
    """Wide, huge and subnormal coefficients, wide weights, long integer rays: what binary64 proves is true."""
    rng, proved = np.random.default_rng(5), 0
    for _ in range(40):
        n, slots = int(rng.integers(2, 7)), int(rng.integers(1, 6))
        node = np.repeat(np.arange(n), n - 1)
        row = np.concatenate([np.delete(np.arange(n), k) for k in range(n)])
        size = 2.0 ** rng.integers(*spread, slots)[:, None]
        values, diagonal = rng.normal(size=(slots, len(node))) * size, rng.normal(size=(slots, n)) * size
        kinds = tuple(tuple((f"f{t}{s}", Fraction(1)) for s in range(slots - 1)) for t in range(2))
        table = Table(n, kinds, np.arange(n) % 2, row, node, values, diagonal)
        sizes = Table(n, kinds, np.arange(n) % 2, row, node, np.abs(values), np.abs(diagonal))
        rays = [[(1, *map(int, rng.integers(-(2**60), 2**60, slots - 1) >> 58)) for _ in range(r)] for r in (1, 3)]
        w, kappa = 2.0 ** rng.integers(-9, 9, n) * (1 + rng.random(n)), Fraction(1, 3)
        for k in range(n):
            whole = largest(sizes, [[np.abs(ray).tolist() for ray in found] for found in rays], w, kappa, k)
            for margin in (0, 2.0 ** (int(rng.integers(-2, 12)) - 53)):
                diagonal[0, k] -= float((largest(table, rays, w, kappa, k) + whole * Fraction(margin)) / Fraction(w[k]))
        with np.errstate(all="ignore"):
            left = set(doubtful(table, rays, w, kappa).tolist())
        for k in set(range(n)) - left:
            assert largest(table, rays, w, kappa, k) <= 0
            proved += 1
    assert (proved > 0) == (spread[0] > -1000)


def scattered(rng: np.random.Generator, height: int, width: int) -> Entries:
    """Return about half of a matrix's entries, random."""
    places = [(i, j) for i in range(height) for j in range(width) if rng.random() < 0.5]
    return [(i, j, float(rng.normal())) for i, j in places]


def test_sparse_and_plain_models_have_the_same_nodes() -> None:
    """Random rows, texts and columns are laid out by node as the plain reader does, entry by entry."""
    rng = np.random.default_rng(3)
    texts = ["tanh(x)", "sinh(x)", "x**3"]
    for _ in range(150):
        n, height = int(rng.integers(1, 6)), int(rng.integers(1, 6))
        arrays = columns("A0", scattered(rng, n, n), n) | columns("terms.0.A", scattered(rng, n, height), height)
        arrays |= columns(
            "terms.0.R", [(i, int(rng.integers(n)), float(rng.choice([0.5, 1]))) for i in range(height)], n
        )
        arrays |= columns("terms.1.A", scattered(rng, n, n), n)
        term = {"f": [str(f) for f in rng.choice(texts, height)], "R": {"shape": [height, n]}, "A": None}
        terms = [term, {"f": "tanh(x)", "R": None, "A": None}]
        model = read_sparse({"format": "persid-model-1", "states": n, "terms": terms, "B": None}, arrays)
        plain, table = nodes_of(model_of(canonical_model(filled(model)))), table_of_sparse(model)
        for k in range(n):
            assert plain.kinds[plain.kind[k]] == table.kinds[int(table.kind[k])]
            found = {i: tuple(row) for i, row in table.column(k).items() if any(row)}
            assert {i: tuple(row) for i, row in plain.column(k).items()} == found


def test_a_companion_of_a_small_model_is_summed_in_fractions() -> None:
    """Weights in a companion beside a plain model are exact as well: the gain is rounded up, not to the nearest."""
    model = {"format": "persid-model-1", "states": ["x1"], "inputs": ["u1"], "A0": [[-1]], "terms": [], "B": [[0.1]]}
    plain = model_of(canonical_model(model))
    data = packed({"w": np.array([0.1])})
    form: dict[str, Any] = {}

    def small(file: dict[str, Any]) -> None:
        form.update(file, model=canonical_model(model), model_sha256=model_sha256(model))
        form["companion"] = {"npz": "c.npz", "sha256": hashlib.sha256(data).hexdigest()}

    Network().forged(small)  # the same claim, about the small model
    result = check(json.dumps(form).encode(), arrays=data)
    assert isinstance(result, Accepted)
    assert Fraction(0.1) * Fraction(plain.B[0][0]) * 2 > Fraction(2, 100)
    assert "0.0200001 sup|u1 - u1*|" in result.statement


@pytest.mark.parametrize(
    "change",
    [
        {"z": [1, 0], "choice": [1, 1]},
        {"z": [-1, -1], "choice": [0, 0]},
        {"z": [0, 0], "choice": [0, 0]},
        {"z": [1, 1], "choice": [0, 0]},
        {"z": [1, 1], "choice": [2, 2]},
        {"z": [1, 1], "choice": [-1, 0]},
        {"z": [1, 1], "choice": [3, 0]},
        {"z": [1], "choice": [0]},
    ],
)
def test_false_obstructions_are_refused(change: dict[str, Any]) -> None:
    """A stable network has no obstruction: negative or zero z, rays outside the cone, false indices do not help."""
    model = {"format": "persid-model-1", "states": ["x", "y"], "A0": [[-2, 1], [1, -2]], "terms": [], "B": [[], []]}
    model["terms"] = [{"f": "tanh(x)", "A": [[0.0, 0.5], [0.0, 0.0]]}]
    rays = [[(1,), (0,), (-1,)], [(1, 0), (0, 0), (0, 1)]]
    kinds = [
        {
            "functions": [[text, dyadic(alpha)] for text, alpha in functions],
            "forms": [[dyadic(c) for c in form] for form in forms],
            "rays": [[dyadic(c) for c in ray] for ray in found],
        }
        for (functions, forms), found in zip([([], []), TANH], rays, strict=True)
    ]
    content = {
        "format": "persid-certificate-1",
        "claim": "L1-infeasible",
        "statement": "",
        "model_sha256": model_sha256(model),
        "model": canonical_model(model),
        "kinds": kinds,
        "z": [dyadic(value) for value in change["z"]],
        "choice": change["choice"],
        "companion": None,
    }
    assert isinstance(check(json.dumps(content).encode()), Rejected | Malformed)


def test_a_cone_that_takes_too_long_is_refused() -> None:
    """Twenty forms of 2000 bits in nine dimensions: the steps are counted, and the file's allowance ends them."""
    rng = random.Random(1)
    forms = [[Fraction(rng.getrandbits(2000) - 2**2000 // 3) for _ in range(9)] for _ in range(20)]
    with limited(100_000), pytest.raises(NotProvedError):
        generators(forms, 9)
