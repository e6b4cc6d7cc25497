"""What a certificate of stability says, whichever format its file has: V, its rate, its region and its outputs.

    V(x) = dx'P dx + 2 sum of integrals of the densities, one for each row of the states,     dx = x - x*.

The region is {x : lo <= r'dx <= hi for every strip, V(x) <= level}. Specification: docs/ledger.md, and for version 1
docs/certificate-format.md.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from persid._dyadics import exact
from persid._files import Json
from persid_check.ledger import FORMAT as LEDGER
from persid_check.ledger.assembly import assemble
from persid_check.ledger.file import read_ledger
from persid_check.model import Model, model_of
from persid_check.subject import groups_of
from persid_check.version_1.format import WORDS

Row = Mapping[int, Fraction]
STABILITY = (*WORDS, *WORDS.values())  # the claims that are spoken of here, by the words of both formats
_ZERO = Fraction(0)


@dataclass(frozen=True)
class Part:
    """The functions f_c(alpha y) of y = r'dx, and the forms over (y, f_1, …) that the proof uses; mu > 0 in V."""

    row: Row
    members: tuple[tuple[int, Fraction], ...]
    forms: tuple[tuple[Fraction, ...], ...]
    mu: tuple[Fraction, ...]

    @property
    def density(self) -> list[Fraction]:
        """The form whose integral, doubled, is this part's share of V."""
        total = [_ZERO] * (1 + len(self.members))
        for weight, form in zip(self.mu, self.forms, strict=True):
            total = [t + weight * c for t, c in zip(total, form, strict=True)]
        return total


@dataclass(frozen=True)
class Seen:
    """An output y_i = h(C_i x + …): (C_i dx)^2 <= constant V, h has the Lipschitz constant; `direct` is its row D_i."""

    name: str
    constant: Fraction
    lipschitz: Fraction
    direct: tuple[Fraction, ...]


@dataclass(frozen=True)
class Spread:
    """L w of a plant with |w|^2 <= |C zeta|^2 + epsilon^2, zeta = (x, channels, u - u*), and its multiplier s."""

    columns: tuple[Row, ...]
    C: tuple[Row, ...]
    s: Fraction
    epsilon: Fraction


@dataclass(frozen=True)
class Claim:
    """The claim of a file in exact numbers; `x`, `radius` and `u` are None without a stated operating point.

    Of a model with algebraic variables `x` are the states alone, and so are `parts` and `strips`.
    """

    kind: str
    model: Model
    x: tuple[Fraction, ...] | None
    radius: Fraction
    u: tuple[Fraction, ...] | None
    diagonal: bool
    inside: tuple[int, ...]  # channels whose values P reads beside the states
    P: tuple[tuple[Fraction, ...], ...]
    parts: tuple[Part, ...]
    gamma: Fraction | tuple[tuple[Fraction, ...], ...]
    kappa: Fraction
    p: Fraction
    dropped: tuple[int, ...]
    strips: tuple[tuple[Row, Fraction, Fraction], ...]
    level: Fraction
    input_bound: Fraction
    outputs: tuple[Seen, ...]
    deviations: tuple[Spread, ...]
    square: Fraction  # of the ball about x_ref that a practical claim leaves, without inputs

    @property
    def constant_supply(self) -> Fraction:
        """What the constant parts of the deviations add to V': the sum of s epsilon^2."""
        return sum((each.s * each.epsilon**2 for each in self.deviations), _ZERO)

    @property
    def has_rate(self) -> bool:
        """Whether a rate and a gain are claimed."""
        return self.kind != "iss"

    @property
    def centre(self) -> tuple[Fraction, ...]:
        """The middle of the ball in which x* lies."""
        return tuple(self.model.x_ref)[: self.model.order] if self.x is None else self.x

    @property
    def drops_states(self) -> bool:
        """Whether a state stands in V through functions alone."""
        return any(i < self.model.order for i in self.dropped)


def claim_of(content: Json) -> Claim:
    """Return what the object of a certificate claims, of either format."""
    model, ledger = model_of(content["model"], discrete=True, algebraic=True), content["format"] == LEDGER
    point, rows = content["operating_point"], content["P"]
    x, radius, u = (None, _ZERO, None) if point is None else _ball(point, model.order)
    kind = content["claim"] if ledger else WORDS[content["claim"]]
    strips = _strips(content) if ledger else _box(content, x or tuple(model.x_ref), radius)
    parts = _points(content) if ledger else _groups(content, model)
    return Claim(
        kind=kind,
        model=model,
        x=x,
        radius=radius,
        u=u,
        diagonal="diagonal" in rows,
        inside=tuple(rows.get("channels", ())),
        P=tuple((exact(v),) for v in rows["diagonal"]) if "diagonal" in rows else _lower(rows["lower"]),
        parts=tuple(part for part in parts if _is_of_states(part.row, model)),
        gamma=_lower(content["gamma"]["lower"]) if isinstance(content["gamma"], dict) else exact(content["gamma"]),
        kappa=exact(content.get("kappa", (0, 0))),
        p=exact(content.get("p", (0, 0))),
        dropped=tuple(content["dropped"]),
        strips=tuple(strip for strip in strips if _is_of_states(strip[0], model)),
        level=exact(content.get("level", (0, 0))),
        input_bound=exact(content.get("input_bound", (0, 0))),
        outputs=tuple(_seen(content)),
        deviations=tuple(_spread(each) for each in content.get("deviations", ())),
        square=_square(content) if kind == "practical" else _ZERO,
    )


def _square(content: Json) -> Fraction:
    """Return (max(c_0 + kappa e_V, 0) / kappa + o_V) / p."""
    ledger = read_ledger(content)
    matrices = assemble(ledger)
    return (max(matrices.supply / ledger.kappa + matrices.above, _ZERO) + matrices.below) / ledger.p


def _is_of_states(row: Row, model: Model) -> bool:
    return all(i < model.order for i in row)


def _spread(stored: Json) -> Spread:
    columns, C = (tuple(_row(row) for row in stored[name]) for name in ("columns", "C"))
    return Spread(columns, C, exact(stored["s"]), exact(stored["epsilon"]))


def _ball(point: Json, order: int) -> tuple[tuple[Fraction, ...], Fraction, tuple[Fraction, ...]]:
    return _exact(point["x"])[:order], exact(point["radius"]), _exact(point["u"])


def _exact(pairs: Sequence[Sequence[int]]) -> tuple[Fraction, ...]:
    return tuple(exact(pair) for pair in pairs)


def _lower(rows: Sequence[Sequence[Sequence[int]]]) -> tuple[tuple[Fraction, ...], ...]:
    return tuple(_exact(row) for row in rows)


def _row(pairs: Sequence[Any]) -> Row:
    return {i: exact(pair) for i, pair in pairs}


def _groups(content: Json, model: Model) -> Iterator[Part]:
    """Parts of version 1: every form of a group is used."""
    for group, stored in zip(groups_of(model), content["groups"], strict=True):
        yield Part(group.row, tuple(group.members), tuple(map(_exact, stored["forms"])), _exact(stored["mu"]))


def _points(content: Json) -> Iterator[Part]:
    """Parts of the ledger: of each point the forms of its curve that a density or a fact uses."""
    used: list[dict[int, Fraction]] = [{} for _ in content["points"]]
    for p, point in enumerate(content["points"]):
        for k, mu in point["densities"]:
            used[p][k] = used[p].get(k, _ZERO) + exact(mu)
    facts = content["facts"]
    pairs = [(p, k) for p, *ks, _ in (*facts["value"], *facts.get("slope", ())) for k in ks]
    products = [(p, content["curves"][content["points"][p]["curve"]]["products"][i]) for p, i, _ in facts["constant"]]
    pairs += [(p, k) for p, product in products for k in product[:2]]
    pairs += [pair for p, k, q, j, _ in facts["one_signed"] for pair in ((p, k), (q, j))]
    pairs += [(point, form) for p, q, _, k, j, _ in facts["difference"] for point in (p, q) for form in (k, j)]
    for p, k in pairs:
        used[p].setdefault(k, _ZERO)
    for point, mine in zip(content["points"], used, strict=True):
        curve = content["curves"][point["curve"]]
        members = zip(point["channels"], (exact(alpha) for _, alpha in curve["functions"]), strict=True)
        forms = tuple(_exact(curve["forms"][k]["l"]) for k in sorted(mine))
        yield Part(_row(point["row"]), tuple(members), forms, tuple(mine[k] for k in sorted(mine)))


def _strips(content: Json) -> Iterator[tuple[Row, Fraction, Fraction]]:
    for point in content["points"]:
        domain = content["curves"][point["curve"]]["domain"]
        if domain is not None:
            yield _row(point["row"]), exact(domain[0]), exact(domain[1])
    for row, lo, hi in content["strips"]:
        yield _row(row), exact(lo), exact(hi)


def _box(content: Json, centre: Sequence[Fraction], radius: Fraction) -> Iterator[tuple[Row, Fraction, Fraction]]:
    """The box of version 1 as strips about x*, for every x* in the ball."""
    for i, (side, x) in enumerate(zip(content.get("box", ()), centre, strict=False)):
        yield {i: Fraction(1)}, exact(side[0]) - x + radius, exact(side[1]) - x - radius


def _seen(content: Json) -> Iterator[Seen]:
    """The outputs; in the ledger a Lipschitz constant stands before its cuts."""
    block = content.get("outputs")
    if not block:
        return
    ledger, steep = content["format"] == LEDGER, block["lipschitz"] or [[1, 0]] * len(block["outputs"])
    found = [exact(entry[0] if ledger and block["lipschitz"] else entry) for entry in steep]
    for name, c, L, row in zip(block["outputs"], block["constants"], found, block["D"], strict=True):
        yield Seen(name, exact(c), L, tuple(Fraction(float.fromhex(v)) for v in row))
