"""Claim L1: V = sum w_k |x_k| decreases along every solution, proved node by node over generators of small cones.

The specification, with its proof, is in docs/network-format.md.
"""

from collections.abc import Mapping, Sequence, Sized
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from persid_check import companion
from persid_check.canonical import holds_objects
from persid_check.entry import Entry
from persid_check.expression import parse
from persid_check.json_text import Stated
from persid_check.model import Model, read_model, sha256_of
from persid_check.networks import sentences
from persid_check.networks.claims import Forms, Kind, NetworkClaim, NetworkObstruction, NetworkSubject
from persid_check.networks.cone import Vector, generators, words
from persid_check.networks.members import Members, read_members
from persid_check.networks.nodes import MAX_FUNCTIONS, Column, Nodes, nodes_of
from persid_check.networks.table import Table, doubtful, table_of, table_of_sparse
from persid_check.reading import MAX_FORMS
from persid_check.results import NotProvedError
from persid_check.search.memory import Question
from persid_check.search.prover import prove_continuous, prove_nondecreasing, prove_sector_form
from persid_check.sparse import FILLED_STATES, SparseModel, read_sparse
from persid_check.subject import COMMON, read_heading
from persid_check.work import spend

if TYPE_CHECKING:
    from numpy import ndarray

EXACT_WORK = 500_000  # coefficients times generators that are worth checking in fractions, without NumPy
PRODUCTS = 4  # of fractions, that a step counts for
MAX_KINDS = 100_000
MAX_DOUBTFUL = 20_000  # columns redone in fractions

DEVIATIONS = "deviations"  # a field that claim L1 may have
FIELDS = {
    "L1": (*COMMON, "operating_point", "kinds", "kappa", "weights", "companion"),
    "L1-infeasible": (*COMMON, "kinds", "z", "choice", "companion"),
}


def read_network(
    data: Stated, folder: Path | None = None, arrays: bytes | None = None
) -> NetworkClaim | NetworkObstruction:
    """Return the value of the JSON object of claim L1 or "L1-infeasible".

    Its companion, where it names one, is given as bytes or stands in the folder.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    claim = data["claim"]
    given = read_heading(data, FIELDS[claim], (DEVIATIONS,) * (claim == "L1"))
    subject = _subject(given, folder, arrays)
    if claim == "L1-infeasible":
        kinds = _kinds(given["kinds"], subject.nodes, ("functions", "forms", "rays"))
        return NetworkObstruction(subject, kinds, _vector(given["z"], subject, "z"), _choice(given, subject, kinds))
    every = given["operating_point"].one_of(("reference", "every")) == "every"
    kinds = _kinds(given["kinds"], subject.nodes, ("functions", "forms"))
    weights = _vector(given["weights"], subject, "w")
    members = _members(given[DEVIATIONS], subject, every) if DEVIATIONS in given else None
    return NetworkClaim(subject, every, kinds, weights, given["kappa"].dyadic(), members)


def _members(entry: Entry, subject: NetworkSubject, every: bool) -> Members:
    if not (every and isinstance(subject.model, Model)):
        entry.refuse('only a model that is written out has some, with the operating point "every"')
    return read_members(entry, subject.model)


def prove_network(claim: NetworkClaim) -> tuple[str, tuple[str, ...]]:
    """Prove claim L1 and return its sentence and steps.

    Raises:
        NotProvedError: a step of the proof fails.
    """
    if claim.kappa <= 0 or claim.spread[0] <= 0:
        raise NotProvedError("weights", "kappa and every weight must be positive")
    _prove_continuous(claim.subject.model)
    rays = [_prove_cone(t, kind, claim.every) for t, kind in enumerate(claim.kinds)]
    nodes = claim.subject.nodes
    left, how = _to_redo(claim, rays)
    for k in left:
        _prove_decrease(k, nodes.column(k), rays[int(nodes.kind[k])], claim)
    gains, offset = _gains(claim)
    statement = sentences.decrease(claim, gains, offset)
    return statement, sentences.decrease_steps(claim, [len(found) for found in rays], how)


def _to_redo(claim: NetworkClaim, rays: Sequence[tuple[Vector, ...]]) -> tuple[Sequence[int], str]:
    """Return the nodes to check in fractions: all of a small network, else those that bounded sums leave in doubt."""
    nodes = claim.subject.nodes
    if isinstance(nodes, Nodes):
        if claim.members is not None or nodes.entries * max(len(found) * len(found[0]) for found in rays) <= EXACT_WORK:
            return range(nodes.n), "in fractions"
        nodes = table_of(nodes)
    left = doubtful(nodes, rays, companion.binary64(claim.weights), claim.kappa).tolist()
    if len(left) > MAX_DOUBTFUL:
        raise NotProvedError("weights", f"{len(left)} nodes are in doubt after the bounded sums; more margin is needed")
    return left, f"{nodes.n - len(left)} nodes by bounded binary64 sums and {len(left)} in fractions"


def prove_no_weights(claim: NetworkObstruction) -> tuple[str, tuple[str, ...]]:
    """Prove that no weights exist with the cones of the forms, and return the sentence and steps.

    Raises:
        NotProvedError: a step of the proof fails.
    """
    nodes = claim.subject.nodes
    _prove_continuous(claim.subject.model)
    for t, kind in enumerate(claim.kinds):
        for ray in kind.rays:
            if ray[0] < 0 or any(_dot(form, ray) < 0 for form in kind.forms):
                raise NotProvedError(f"kinds[{t}].rays", "a ray lies outside the cone of the forms")
    active = [(k, Fraction(value)) for k, value in enumerate(claim.z) if value]
    if len(active) > MAX_DOUBTFUL:
        raise NotProvedError("z", f"at most {MAX_DOUBTFUL} entries may be positive")
    if any(value < 0 for _, value in active):
        raise NotProvedError("z", "no entry may be negative")
    total: dict[int, Fraction] = {}
    strict = False
    for k, value in active:
        ray = claim.kinds[int(nodes.kind[k])].rays[int(claim.choice[k])]
        strict = strict or ray[0] > 0
        column = nodes.column(k)
        spend(len(column) * len(ray) // PRODUCTS)
        for i, size in _sizes(column, k, ray):
            total[i] = total.get(i, Fraction(0)) + value * size
    if any(value < 0 for value in total.values()) or not (strict or any(total.values())):
        raise NotProvedError("z", "it is not true that M z >= 0 with M z or some z v_0 positive")
    return sentences.no_weights(claim), sentences.no_weights_steps(claim)


def _prove_continuous(model: Model | SparseModel) -> None:
    found = [c.text for c in model.channels] if isinstance(model, Model) else [f for t in model.terms for f in t.texts]
    for text in dict.fromkeys(found):
        if not prove_continuous(((parse(text), Fraction(1)),)):
            raise NotProvedError("model", f"{text} is not proved continuous on R")


def _prove_cone(t: int, kind: Kind, every: bool) -> tuple[Vector, ...]:
    """Prove the forms of one kind, and return generators of the cone cut out by them and by v_0 = |y| >= 0."""
    curve = tuple((parse(text), alpha) for text, alpha in kind.functions)
    proves = prove_nondecreasing if every else prove_sector_form
    for f, form in enumerate(kind.forms):
        if not proves(curve, form):
            what = "nondecreasing" if every else "a sector form"
            raise NotProvedError(f"kinds[{t}].forms[{f}]", f"it is not proved to be {what} on R")
    size = 1 + len(curve)
    return generators((_y(size), *kind.forms), size)


def _prove_decrease(k: int, column: Column, rays: Sequence[Vector], claim: NetworkClaim) -> None:
    """Prove w_k T_k + sum w_i |T_i| + kappa w_k v_0 <= 0, T_i = sum v_s A_s[i, k], for every generator v.

    Of members w_i |C_i E_k v| is added for every ellipsoid.
    """
    spend(len(rays) * len(column) * len(rays[0]) * words(rays) // PRODUCTS)
    own = Fraction(claim.weights[k])
    for ray in rays:
        sizes = _sizes(column, k, ray) + (claim.members.sizes(k, ray) if claim.members is not None else [])
        if sum((Fraction(claim.weights[i]) * size for i, size in sizes), claim.kappa * own * ray[0]) > 0:
            raise NotProvedError("weights", f"V does not decrease at rate kappa through node {k}")


def _gains(claim: NetworkClaim) -> tuple[list[Fraction], bool]:
    """Return upper bounds of (|B|'w)_l for every input, then of |b|'w if b counts as an input; and whether it does."""
    model = claim.subject.model
    if isinstance(model, SparseModel):
        return _sparse_gains(claim, model)
    offset = not claim.every and any(model.b)
    rows = [(*row, b) if offset else row for row, b in zip(model.B, model.b, strict=True)]
    sums = [Fraction(0)] * (model.m + offset)
    for w, row in zip(claim.weights, rows, strict=True):
        for j, value in enumerate(row):
            sums[j] += Fraction(w) * abs(Fraction(value)) if value else 0
    if claim.members is not None:
        for j in range(model.m):
            sums[j] += sum((Fraction(claim.weights[i]) * size for i, size in claim.members.of_input(j)), Fraction(0))
    return sums, offset


def _sparse_gains(claim: NetworkClaim, model: SparseModel) -> tuple[list[Fraction], bool]:
    """Return the same from binary64 sums, raised by N 2^-51 of themselves for N operations and 2^-1000 an entry.

    A product that underflows loses at most 2^-1075, and all of them together may leave the sum 0.
    """
    import numpy as np

    w = companion.binary64(claim.weights)
    sums: ndarray = np.zeros(len(model.inputs))
    entries: ndarray = np.zeros(len(model.inputs), np.int64)
    if model.B is not None:
        entries = np.diff(model.B.starts)
        node = np.repeat(np.arange(len(sums)), entries)
        sums = np.bincount(node, weights=np.abs(model.B.values) * w[model.B.rows], minlength=len(sums))
    offset = not claim.every and model.b is not None
    if model.b is not None and offset:
        sums, entries = np.append(sums, np.abs(model.b) @ w), np.append(entries, model.n)
    if not np.isfinite(sums).all():
        raise NotProvedError("weights", "|B|'w is too large for a binary64")
    raised, tiny = 1 + Fraction(model.n + 8, 2**51), Fraction(1, 2**1000)
    pairs = zip(sums.tolist(), entries.tolist(), strict=True)
    return [Fraction(value) * raised + count * tiny for value, count in pairs], offset


def _sizes(column: Column, k: int, ray: Sequence[Fraction | int]) -> list[tuple[int, Fraction]]:
    """Return (i, M[i, k]): T_k on the diagonal, |T_i| elsewhere."""
    found = []
    for i, coefficients in column.items():
        T = _dot(coefficients, ray)
        found.append((i, T if i == k else abs(T)))
    return found


def _dot(a: Sequence[Fraction], b: Sequence[Fraction | int]) -> Fraction:
    return sum((p * q for p, q in zip(a, b, strict=True) if p and q), Fraction(0))


def _y(size: int) -> tuple[Fraction, ...]:
    return (Fraction(1), *(Fraction(0),) * (size - 1))


def _subject(given: Mapping[str, Entry], folder: Path | None, content: bytes | None) -> NetworkSubject:
    entry, companions = given["model"], given["companion"]
    form, claim, stated = entry.value, given["claim"].value, given["model_sha256"].value
    if not isinstance(form, dict):
        entry.refuse("an object is needed")
    if companions.value is not None:
        companions.fields(("npz", "sha256"))
    arrays = {} if companions.value is None else companion.load(companions.value, "companion", folder, content)
    if holds_objects(form):
        sparse = read_sparse(form, arrays)
        _refuse_unpaid(given["weights" if "weights" in given else "z"], arrays, sparse.n)
        if sparse.n <= FILLED_STATES:
            entry.refuse(f"the network form is for more than {FILLED_STATES} states")
        if sha256_of(sparse.form()) != sha256_of(form):  # as texts: to Python 1 == True
            entry.refuse("not the network form of the arrays in the companion")
        return NetworkSubject(claim, stated, form, sparse, table_of_sparse(sparse), arrays)
    model = read_model(entry)
    return NetworkSubject(claim, stated, form, model, nodes_of(model), arrays)


def _refuse_unpaid(entry: Entry, arrays: companion.Arrays, n: int) -> None:
    """A number for each node stands in the file or in its companion before anything of that size is made."""
    name = "w" if entry.where == "weights" else "z"
    given = arrays.get(name) if entry.value is None else entry.value
    if not isinstance(given, Sized) or len(given) != n:
        entry.refuse(f"{n} numbers are needed, here or as {name!r} in the companion")


def _vector(entry: Entry, subject: NetworkSubject, name: str) -> "Sequence[Fraction] | ndarray":
    """Return n numbers of the file, or of its companion where the file says null."""
    if entry.value is not None:
        return entry.dyadics(subject.nodes.n)
    import numpy as np

    found = subject.arrays.get(name)
    if found is None or found.shape != (subject.nodes.n,) or found.dtype != np.dtype("<f8"):
        entry.refuse(f"the companion needs an array {name!r} of {subject.nodes.n} binary64 numbers")
    if not np.isfinite(found).all():
        entry.refuse("a number is not finite")
    return found


def _kinds(entry: Entry, nodes: Nodes | Table, known: tuple[str, ...]) -> tuple[Kind, ...]:
    """Return the kinds of the file in the order of the nodes' kinds."""
    listed = entry.items(longest=MAX_KINDS)
    if len(listed) != len(nodes.kinds):  # before any is read: what no node has is not worth its parsing
        entry.refuse(f"{len(nodes.kinds)} occur among the nodes, and each is needed once, and no other")
    kinds = [_kind(each.fields(known)) for each in listed]
    found = {Question.of(kind.functions): kind for kind in kinds}
    of_nodes = [found.get(Question.of(functions)) for functions in nodes.kinds]
    if missing := [functions for functions, kind in zip(nodes.kinds, of_nodes, strict=True) if kind is None]:
        entry.refuse(f"the nodes with the functions {[text[:60] for text, _ in missing[0]]} have none")
    return tuple(kind for kind in of_nodes if kind is not None)


def _kind(given: Mapping[str, Entry]) -> Kind:
    pairs = [pair.items(2) for pair in given["functions"].items(longest=MAX_FUNCTIONS)]
    functions = tuple((_expression(text), alpha.dyadic()) for text, alpha in pairs)
    forms, rays = (_vectors(given[name], 1 + len(pairs)) if name in given else () for name in ("forms", "rays"))
    return Kind(functions, forms, rays)


def _vectors(entry: Entry, size: int) -> Forms:
    return tuple(row.dyadics(size) for row in entry.items(longest=MAX_FORMS))


def _expression(entry: Entry) -> str:
    entry.program()
    return entry.text(5000)


def _choice(
    given: Mapping[str, Entry], subject: NetworkSubject, kinds: tuple[Kind, ...]
) -> "Sequence[int] | ndarray":  # fmt: skip
    entry, nodes, counts = given["choice"], subject.nodes, [len(kind.rays) for kind in kinds]
    if entry.value is not None:
        return tuple(each.index(counts[int(nodes.kind[k])]) for k, each in enumerate(entry.items(nodes.n)))
    import numpy as np

    found = subject.arrays.get("choice")
    if found is None or found.shape != (nodes.n,) or found.dtype.kind != "i":
        entry.refuse(f"the companion needs an array 'choice' of {nodes.n} integers")
    if not ((found >= 0) & (found < np.array(counts)[np.asarray(nodes.kind)])).all():
        entry.refuse("an index is negative or too large")
    return found
