"""Claim L1: V = sum w_k |x_k| decreases along every solution, proved node by node over generators of small cones.

The specification, with its proof, is in docs/network-format.md.
"""

from collections.abc import Mapping, Sequence, Sized
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from persid_check import companion
from persid_check.expression import ExpressionError, parse
from persid_check.json_text import Stated
from persid_check.memory import Question
from persid_check.model import Model, holds_objects, sha256_of
from persid_check.networks import sentences
from persid_check.networks.claims import Forms, Kind, NetworkClaim, NetworkObstruction, NetworkSubject
from persid_check.networks.cone import Vector, generators, words
from persid_check.networks.members import Members, read_members
from persid_check.networks.nodes import MAX_FUNCTIONS, Column, Nodes, nodes_of
from persid_check.networks.table import Table, doubtful, table_of, table_of_sparse
from persid_check.reading import (
    MAX_FORMS,
    read_dyadic,
    read_dyadics,
    read_index,
    read_list,
    read_object,
    read_text,
    read_written,
)
from persid_check.results import FormatError, NotProvedError
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
    more = (DEVIATIONS,) if claim == "L1" and DEVIATIONS in data else ()
    read_heading(data, (*FIELDS[claim], *more))
    subject = _subject(claim, data, folder, arrays)
    if claim == "L1-infeasible":
        kinds = _kinds(data["kinds"], subject.nodes, ("functions", "forms", "rays"))
        z = _vector("z", data["z"], subject, "z")
        return NetworkObstruction(subject, kinds, z, _choice(data["choice"], subject, kinds))
    if data["operating_point"] not in ("reference", "every"):
        raise FormatError("operating_point", '"reference" or "every" is needed')
    every = data["operating_point"] == "every"
    kinds = _kinds(data["kinds"], subject.nodes, ("functions", "forms"))
    weights = _vector("weights", data["weights"], subject, "w")
    members = _members(data[DEVIATIONS], subject, every) if more else None
    return NetworkClaim(subject, every, kinds, weights, read_dyadic("kappa", data["kappa"]), members)


def _members(value: object, subject: NetworkSubject, every: bool) -> Members:
    if not (every and isinstance(subject.model, Model)):
        raise FormatError(DEVIATIONS, 'only a model that is written out has some, with the operating point "every"')
    return read_members(value, subject.model)


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


def _subject(claim: str, data: Stated, folder: Path | None, content: bytes | None) -> NetworkSubject:
    form, entry = data["model"], data["companion"]
    if not isinstance(form, dict):
        raise FormatError("model", "an object is needed")
    arrays = {} if entry is None else companion.load(_entry(entry), "companion", folder, content)
    if holds_objects(form):
        sparse = read_sparse(form, arrays)
        _refuse_unpaid(data, arrays, sparse.n)
        if sparse.n <= FILLED_STATES:
            raise FormatError("model", f"the network form is for more than {FILLED_STATES} states")
        if sha256_of(sparse.form()) != sha256_of(form):  # as texts: to Python 1 == True
            raise FormatError("model", "not the network form of the arrays in the companion")
        return NetworkSubject(claim, data["model_sha256"], form, sparse, table_of_sparse(sparse), arrays)
    model = read_written(form)
    return NetworkSubject(claim, data["model_sha256"], form, model, nodes_of(model), arrays)


def _refuse_unpaid(data: Mapping[str, object], arrays: companion.Arrays, n: int) -> None:
    """A number for each node stands in the file or in its companion before anything of that size is made."""
    where, name = ("weights", "w") if "weights" in data else ("z", "z")
    given = arrays.get(name) if data[where] is None else data[where]
    if not isinstance(given, Sized) or len(given) != n:
        raise FormatError(where, f"{n} numbers are needed, here or as {name!r} in the companion")


def _entry(value: object) -> Mapping[str, object]:
    return read_object("companion", value, ("npz", "sha256"))


def _vector(where: str, value: object, subject: NetworkSubject, name: str) -> "Sequence[Fraction] | ndarray":
    """Return n numbers of the file, or of its companion where the file says null."""
    if value is not None:
        return read_dyadics(where, value, subject.nodes.n)
    import numpy as np

    found = subject.arrays.get(name)
    if found is None or found.shape != (subject.nodes.n,) or found.dtype != np.dtype("<f8"):
        raise FormatError(where, f"the companion needs an array {name!r} of {subject.nodes.n} binary64 numbers")
    if not np.isfinite(found).all():
        raise FormatError(where, "a number is not finite")
    return found


def _kinds(value: object, nodes: Nodes | Table, known: tuple[str, ...]) -> tuple[Kind, ...]:
    """Return the kinds of the file in the order of the nodes' kinds."""
    entries = read_list("kinds", value)
    if len(entries) > MAX_KINDS:
        raise FormatError("kinds", f"at most {MAX_KINDS} are read")
    if len(entries) != len(nodes.kinds):  # before any is read: what no node has is not worth its parsing
        raise FormatError("kinds", f"{len(nodes.kinds)} occur among the nodes, and each is needed once, and no other")
    found = {}
    for t, entry in enumerate(entries):
        kind = _kind(f"kinds[{t}]", read_object(f"kinds[{t}]", entry, known))
        found[Question.of(kind.functions)] = kind
    of_nodes = [found.get(Question.of(functions)) for functions in nodes.kinds]
    if missing := [functions for functions, kind in zip(nodes.kinds, of_nodes, strict=True) if kind is None]:
        raise FormatError("kinds", f"the nodes with the functions {[text[:60] for text, _ in missing[0]]} have none")
    return tuple(kind for kind in of_nodes if kind is not None)


def _kind(where: str, entry: Mapping[str, object]) -> Kind:
    pairs = [read_list(f"{where}.functions", pair, 2) for pair in read_list(f"{where}.functions", entry["functions"])]
    if len(pairs) > MAX_FUNCTIONS:
        raise FormatError(f"{where}.functions", f"at most {MAX_FUNCTIONS} are read")
    functions = tuple((_expression(where, text), read_dyadic(f"{where}.functions", alpha)) for text, alpha in pairs)
    forms, rays = (_vectors(f"{where}.{name}", entry.get(name, []), 1 + len(pairs)) for name in ("forms", "rays"))
    return Kind(functions, forms, rays)


def _vectors(where: str, value: object, size: int) -> Forms:
    rows = read_list(where, value)
    if len(rows) > MAX_FORMS:
        raise FormatError(where, f"at most {MAX_FORMS} are read")
    return tuple(read_dyadics(f"{where}[{k}]", row, size) for k, row in enumerate(rows))


def _expression(where: str, text: object) -> str:
    expression = read_text(where, text, 5000)
    try:
        parse(expression)
    except ExpressionError as error:
        raise FormatError(where, str(error)) from None
    return expression


def _choice(value: object, subject: NetworkSubject, kinds: tuple[Kind, ...]) -> "Sequence[int] | ndarray":
    nodes = subject.nodes
    counts = [len(kind.rays) for kind in kinds]
    if value is not None:
        entries = read_list("choice", value, nodes.n)
        return tuple(read_index(f"choice[{k}]", entry, counts[int(nodes.kind[k])]) for k, entry in enumerate(entries))
    import numpy as np

    found = subject.arrays.get("choice")
    if found is None or found.shape != (nodes.n,) or found.dtype.kind != "i":
        raise FormatError("choice", f"the companion needs an array 'choice' of {nodes.n} integers")
    if not ((found >= 0) & (found < np.array(counts)[np.asarray(nodes.kind)])).all():
        raise FormatError("choice", "an index is negative or too large")
    return found
