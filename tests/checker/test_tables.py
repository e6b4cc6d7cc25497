"""Tables of knots and values: read exactly, and a sum of hinges that hides nothing from a proof."""

import random
from fractions import Fraction
from itertools import pairwise

import pytest
from flint import ctx

from persid.certificates.partitions import cuts_of
from persid.models.lookup_tables import lookup_table
from persid_check.enclosure import PRECISION, constant, value, value_and_slope
from persid_check.expression import MAX_KNOTS, ExpressionError, Program, Table, parse, table_of
from persid_check.ledger.lemmas import Lemma


def drawn(choose: random.Random) -> Table:
    """A random table, as it is meant: rising knots, exact."""
    count = choose.randint(2, 9)
    knots = sorted({choose.choice((0.0, choose.uniform(-3, 3), choose.randint(-6, 6) / 4)) for _ in range(2 * count)})
    values = [choose.choice((0.0, choose.uniform(-3, 3), t, 2 * t)) for t in knots]
    if len(knots) < 2:
        return drawn(choose)
    return tuple((Fraction(t), Fraction(v)) for t, v in zip(knots, values, strict=True))


def text_of(table: Table) -> str:
    """The table as an expression."""
    return lookup_table(*([float(entry) for entry in column] for column in zip(*table, strict=True)))


def at(table: Table, x: Fraction) -> Fraction:
    """The value between two knots, or beyond the ends: what a table means, by the first lesson on it."""
    (t, v), (s, w) = next((pair for pair in pairwise(table) if x <= pair[1][0]), table[-2:])
    return v + (w - v) / (s - t) * (x - t)


def run(program: Program, x: Fraction) -> Fraction:
    """A program in exact fractions, for the few words that hinges take."""
    stack: list[Fraction] = []
    for step in program:
        if step.name in ("x", "number"):
            stack.append(x if step.name == "x" else step.value)
        elif step.name in ("relu", "neg"):
            stack.append(max(stack.pop(), Fraction(0)) if step.name == "relu" else -stack.pop())
        else:
            b, a = stack.pop(), stack.pop()
            stack.append({"+": a + b, "-": a - b, "*": a * b}[step.name])
    (found,) = stack
    return found


def test_hinges_are_the_table_exactly() -> None:
    """The sum of hinges of a random table has its values, in exact fractions, at knots, between and beyond them."""
    choose = random.Random(1)
    for _ in range(300):
        table = drawn(choose)
        program = parse(text_of(table))
        assert table_of(text_of(table)) == table
        points = [t for t, _ in table] + [Fraction(choose.uniform(-9, 9)) for _ in range(9)] + [Fraction(0)]
        assert all(run(program, x) == at(table, x) for x in points)


def test_slopes_within_a_piece_are_those_of_the_piece() -> None:
    """On a piece from knot to knot the enclosed slope is that piece's, as sharp as one division, and 0 is exact."""
    choose = random.Random(2)
    with ctx.workprec(PRECISION):
        for _ in range(100):
            table = drawn(choose)
            program = parse(text_of(table))
            for (t, v), (s, w) in pairwise(table):
                piece = constant(t).hull(constant(s))
                found = value_and_slope(program, piece, constant(Fraction(1)))[1]
                slope = constant((w - v) / (s - t))
                assert found.lo <= slope.lo
                assert slope.hi <= found.hi
                assert float(found.hi - found.lo) <= 1e-50 * (1 + abs(float(slope.lo)))
                if v == w:
                    assert (float(found.lo), float(found.hi)) == (0, 0)


def test_the_value_at_zero_is_exact() -> None:
    """A table that vanishes at 0 does so to the last bit, whatever its slopes: sector functions need it."""
    choose = random.Random(3)
    with ctx.workprec(PRECISION):
        for _ in range(200):
            table = drawn(choose)
            found = value(parse(text_of(table)), constant(Fraction(0)))
            assert found.lo <= constant(at(table, Fraction(0))).hi
            assert at(table, Fraction(0)) != 0 or (float(found.lo), float(found.hi)) == (0, 0)


KNEE = "pwl(x; -2: -1.5, -0.7: -0.7, 0.3: 0.3, 1.1: 0.7, 3: 0.7)"


@pytest.mark.parametrize(
    ("text", "form", "kind", "c", "holds"),
    [
        (KNEE, (0, 1), "nondecreasing", 0, True),
        (KNEE, (0, 1), "sector", 0, True),
        (KNEE, ("1.0001", -1), "nondecreasing", 0, True),
        (KNEE, ("0.9999", -1), "sector", 0, False),
        (KNEE, (0, 1), "growing", 0, False),
        (KNEE, ("0.001", 1), "growing", 0, True),
        (KNEE, (0, 1), "upper", 1, True),
        (KNEE, (0, 1), "upper", "0.999", False),
        ("pwl(x; -1: -1, 1: 1)", (1, -1), "sector", 0, True),
        ("pwl(x; -1: -1, 0: 0, 1: 2)", (-1, 1), "nondecreasing", 0, True),
        ("pwl(x; -1: -1, 0: 0, 1: 2)", (2, -1), "nondecreasing", 0, True),
        ("pwl(x; -1: -1, 0: 0, 1: 2)", (0, 1), "upper", "0.5", True),
        ("pwl(x; -1: -1, 0: 0, 1: 2)", (0, 1), "upper", "0.499", False),
        ("pwl(x; -1: -0.3, -0.4: 0, 0.4: 0, 1: 0.3)", (0, 1), "sector", 0, True),
        ("pwl(x; -1: -0.3, -0.4: 0, 0.4: 0, 1: 0.3)", (0, 1), "growing", 0, False),
        ("pwl(x; -1: 2, 0: 0, 1: 2)", (0, 1), "one-signed", 0, True),
        ("pwl(x; -1: 2, 0: 0, 1: 2, 3: 2, 9: -0.001)", (0, 1), "one-signed", 0, False),
    ],
)  # fmt: skip
def test_facts_about_tables(text, form, kind, c, holds) -> None:
    """Sectors, slopes, growth and integrals of tables are proved where they are true, and not where they just fail."""
    with ctx.workprec(PRECISION):
        row = tuple(Fraction(v) for v in form)
        lemma = Lemma(((parse(text), Fraction(1)),), row, kind, c=Fraction(c))
        cuts = cuts_of(lemma, None)
        assert (cuts is not None) == holds
        assert cuts is None or lemma.unproved(cuts, None) is None


def test_random_tables_keep_their_facts() -> None:
    """Of random tables exactly those whose slopes have one sign are proved nondecreasing, and none else."""
    choose = random.Random(4)
    counts = [0, 0]
    with ctx.workprec(PRECISION):
        for _ in range(150):
            table = drawn(choose)
            table = choose.choice((table, tuple(zip((t for t, _ in table), sorted(v for _, v in table), strict=True))))
            lemma = Lemma(((parse(text_of(table)), Fraction(1)),), (Fraction(0), Fraction(1)), "nondecreasing")
            rises = all(v <= w for (_, v), (_, w) in pairwise(table))
            assert (cuts_of(lemma, None) is not None) == rises
            counts[rises] += 1
    assert min(counts) > 30


def test_a_table_has_limits() -> None:
    """As many knots as the page says are read, one more is refused, and so is a text that is longer than it says."""
    knots = [f"{k}: {k}" for k in range(MAX_KNOTS)]
    assert parse(f"pwl(x; {', '.join(knots)})")
    with pytest.raises(ExpressionError, match="64 knots"):
        parse(f"pwl(x; {', '.join([*knots, '99: 0'])})")
    with pytest.raises(ExpressionError, match="64 knots"):
        parse(f"pwl(x; {', '.join(knots)}) + pwl(x; 0: 0, 1: 1)")
    with pytest.raises(ExpressionError, match="4001 characters"):
        parse("pwl(x; 0: 0, 1: 1)".ljust(4001))
    with pytest.raises(ExpressionError, match="at most 1000"):
        parse("x".ljust(1001))
