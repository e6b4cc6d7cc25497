# ruff: noqa: E741 (l is the letter of the mathematics)
"""A second, tiny checker of claim G, written from docs/certificate-format.md alone.

Fractions for the matrices, mpmath's intervals (exp only) for the functions x**k (odd k), sinh(x), tanh(x).
It answers "accepted", "refused" or "unsupported".
"""

import hashlib
import json
import re
from fractions import Fraction
from math import factorial
from typing import Any

from mpmath import iv, mpf

iv.prec = 120
ORDER = 9


class UnsupportedError(Exception):
    """A claim, an operating point or a function that this checker does not know."""


class RefusedError(Exception):
    """Something is not proved."""


def verdict(text: bytes) -> str:
    """Check the bytes of a certificate."""
    try:
        _check(json.loads(text))
    except UnsupportedError:
        return "unsupported"
    except (RefusedError, ValueError, KeyError, IndexError, TypeError):
        return "refused"
    return "accepted"


def _require(truth: bool, what: str) -> None:
    if not truth:
        raise RefusedError(what)


def _dyadic(pair: list[int]) -> Fraction:
    _require(len(pair) == 2 and all(type(v) is int for v in pair) and abs(pair[1]) <= 2000, "dyadic")
    return Fraction(pair[0]) * Fraction(2) ** pair[1]


def _check(data: dict[str, Any]) -> None:
    if data["claim"] != "G" or data["operating_point"] is not None:
        raise UnsupportedError
    model = data["model"]
    text = json.dumps(model, sort_keys=True, separators=(",", ":"))
    _require(hashlib.sha256(text.encode()).hexdigest() == data["model_sha256"], "hash")
    n = len(model["states"])
    A0 = [[_exact(v) for v in row] for row in model["A0"]]
    channels = _channels(model, n, A0)
    groups = _groups(channels)
    size = n + len(channels)
    G = [A0[i] + [channel[2][i] for channel in channels] for i in range(n)]
    E = [[Fraction(0)] * n for _ in range(size)]
    S = [[Fraction(0)] * size for _ in range(size)]
    for i in range(n):
        for j in range(n):
            E[i][j] = _P(data["P"], i, j)
    P = [row[:] for row in E[:n]]
    _require(len(data["groups"]) == len(groups), "groups")
    touched: set[int] = set()
    for (row, members), proof in zip(groups, data["groups"], strict=True):
        touched |= _add_group(E, S, row, members, proof, channels, n)
    Q = _plus(_plus(_product(E, G), _transposed(_product(E, G))), S)
    B = [[_exact(v) for v in row] for row in model["B"]]
    if any(_exact(v) for v in model["b"]):
        B = [[*row, _exact(v)] for row, v in zip(B, model["b"], strict=True)]
    EB = _product(E, B)
    for d in data["dropped"]:
        _require(n <= d < size and d not in touched and data["dropped"].count(d) == 1, "dropped")
        _require(not any(row[d] for row in G) and not any(Q[d]) and not any(E[d]) and not any(EB[d]), "dropped row")
    kept = [i for i in range(size) if i not in data["dropped"]]
    gamma, m = _dyadic(data["gamma"]), len(B[0])
    M = [[-Q[i][j] for j in kept] + [-EB[i][k] for k in range(m)] for i in kept]
    M += [[-EB[i][k] for i in kept] + [gamma if k == l else Fraction(0) for l in range(m)] for k in range(m)]
    _require(gamma > 0, "gamma")
    _definite(P, data["proof"]["P"])
    _definite(M, data["proof"]["Q"])


def _exact(text: str) -> Fraction:
    return Fraction(float.fromhex(text))


def _P(P: dict[str, Any], i: int, j: int) -> Fraction:
    if "diagonal" in P:
        return _dyadic(P["diagonal"][i]) if i == j else Fraction(0)
    return _dyadic(P["lower"][max(i, j)][min(i, j)])


def _channels(
    model: dict[str, Any], n: int, A0: list[list[Fraction]]
) -> list[tuple[str, list[Fraction], list[Fraction]]]:
    found = []
    for term in model["terms"]:
        identity = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
        R = identity if term["R"] is None else [[_exact(v) for v in row] for row in term["R"]]
        for k, row in enumerate(R):
            f = term["f"] if isinstance(term["f"], str) else term["f"][k]
            column = [_exact(term["A"][i][k]) for i in range(n)]
            if f.strip() == "x":
                for i in range(n):
                    A0[i][:] = [a + column[i] * r for a, r in zip(A0[i], row, strict=True)]
            else:
                found.append((f, row, column))
    return found


def _groups(channels: list[Any]) -> list[tuple[list[Fraction], list[tuple[int, Fraction]]]]:
    found: list[tuple[list[Fraction], list[tuple[int, Fraction]]]] = []
    for c, (_, row, _) in enumerate(channels):
        for first, members in found:
            ratios = {b / a for a, b in zip(first, row, strict=True) if a}
            if (
                len(ratios) == 1
                and min(ratios) > 0
                and all(bool(a) == bool(b) for a, b in zip(first, row, strict=True))
            ):
                members.append((c, ratios.pop()))
                break
        else:
            found.append((row, [(c, Fraction(1))]))
    return found


def _add_group(E: Any, S: Any, row: Any, members: Any, proof: Any, channels: Any, n: int) -> set[int]:
    """Add one group to E and S, prove its forms, and return the channels that its used forms touch."""
    forms = [[_dyadic(v) for v in form] for form in proof["forms"]]
    mu, taus = [_dyadic(v) for v in proof["mu"]], [(k, l, _dyadic(tau)) for k, l, tau in proof["products"]]
    _require(len(mu) == len(forms) and all(v >= 0 for v in mu), "mu")
    _require(all(0 <= k < l < len(forms) and tau >= 0 for k, l, tau in taus), "tau")
    _require(len({(k, l) for k, l, _ in taus}) == len(taus), "a pair twice")
    vectors = []
    for form in forms:
        _require(len(form) == 1 + len(members), "form")
        vector = [form[0] * r for r in row] + [Fraction(0)] * len(channels)
        for (c, _), value in zip(members, form[1:], strict=True):
            vector[n + c] = value
        vectors.append(vector)
    used = {k for k, v in enumerate(mu) if v} | {k for *pair, tau in taus if tau for k in pair}
    for k in used:
        _sector_form(forms[k], [(channels[c][0], alpha) for c, alpha in members])
    for k, v in enumerate(mu):
        for i, a in enumerate(vectors[k]):
            E[i][:] = [e + v * a * r for e, r in zip(E[i], row, strict=True)] if v and a else E[i]
    for k, l, tau in taus:
        for i, a in enumerate(vectors[k]):
            for j, b in enumerate(vectors[l]):
                S[i][j] += tau * a * b
                S[j][i] += tau * a * b
    return {n + c for k in used for (c, _), value in zip(members, forms[k][1:], strict=True) if value}


def _product(A: Any, B: Any) -> Any:
    columns = list(zip(*B, strict=True))
    return [
        [sum((a * b for a, b in zip(row, column, strict=True) if a and b), Fraction(0)) for column in columns]
        for row in A
    ]


def _transposed(A: Any) -> Any:
    return [list(row) for row in zip(*A, strict=True)]


def _plus(A: Any, B: Any) -> Any:
    return [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(A, B, strict=True)]


def _definite(M: Any, T: Any) -> None:
    """Both ways: the file's T must work, and Gauss's pivots must be positive."""
    size = len(M)
    _require(
        len(T) == size and all(len(row) == i + 1 and all(type(v) is int for v in row) for i, row in enumerate(T)), "T"
    )
    full = [[Fraction(v) for v in row] + [Fraction(0)] * (size - len(row)) for row in T]
    C = _product(_product(full, M), _transposed(full))
    _require(all(C[i][i] > 0 for i in range(size)), "diagonal")
    scale = [
        Fraction(1, 2 ** (C[i][i].numerator.bit_length() // 2)) * 2 ** (C[i][i].denominator.bit_length() // 2)
        for i in range(size)
    ]
    for i in range(size):
        rest = sum(abs(C[i][j]) * scale[j] for j in range(size) if j != i)
        _require(rest < C[i][i] * scale[i], "dominance")
    A = [row[:] for row in M]
    for k in range(size):
        _require(A[k][k] > 0, "pivot")
        for i in range(k + 1, size):
            factor = A[i][k] / A[k][k]
            A[i] = [a - factor * b for a, b in zip(A[i], A[k], strict=True)]


# --- y l'phi(y) >= 0, for t = |y|: all supported functions are odd, so one side is enough


def _sector_form(form: list[Fraction], members: list[tuple[str, Fraction]]) -> None:
    terms: list[tuple[str, int, Fraction, Fraction]] = [("power", 1, Fraction(1), form[0])] if form[0] else []
    for (text, alpha), l in zip(members, form[1:], strict=True):
        if not l:
            continue
        power = re.fullmatch(r"x\*\*(\d+)", text)
        if power and int(power[1]) % 2:
            terms.append(("power", int(power[1]), alpha, l))
        elif text in ("sinh(x)", "tanh(x)"):
            terms.append((text[:4], 0, alpha, l))
        else:
            raise UnsupportedError
    if terms:
        Y = _tail(terms)
        _compact(terms, _near_zero(terms), Y)


def _jet(kind: str, k: int, alpha: Any, t: Any, exact: bool) -> list[Any]:
    """Taylor coefficients of f(alpha t) about t: at 0 exactly, else over an interval."""
    if kind == "power":
        return [
            _binomial(k, j) * alpha**k * (t ** (k - j) if k > j or not exact else 1) if j <= k else 0 * alpha
            for j in range(ORDER)
        ]
    if kind == "sinh":
        if exact:
            return [alpha**j / factorial(j) if j % 2 else Fraction(0) for j in range(ORDER)]
        up, down = iv.exp(alpha * t), iv.exp(-alpha * t)
        return [(up - down if j % 2 == 0 else up + down) / 2 * alpha**j / factorial(j) for j in range(ORDER)]
    jet = [Fraction(0) if exact else 1 - 2 / (1 + iv.exp(2 * alpha * t))]
    for j in range(ORDER - 1):
        square = sum((jet[i] * jet[j - i] for i in range(j + 1)), 0 * alpha)
        jet.append(alpha * ((1 if j == 0 else 0) - square) / (j + 1))
    return jet


def _binomial(k: int, j: int) -> int:
    return factorial(k) // (factorial(j) * factorial(k - j))


def _iv(value: Fraction) -> Any:
    return iv.mpf(value.numerator) / iv.mpf(value.denominator)


def _sum(terms: Any, t: Any) -> list[Any]:
    jets = [[_iv(l) * v for v in _jet(kind, k, _iv(alpha), t, False)] for kind, k, alpha, l in terms]
    return [sum(column, iv.mpf(0)) for column in zip(*jets, strict=True)]


def _near_zero(terms: Any) -> Fraction:
    """G = c_m(xi) t^m with the first exact coefficient that is not zero: positive on (0, h]."""
    jets = [[l * v for v in _jet(kind, k, alpha, Fraction(0), True)] for kind, k, alpha, l in terms]
    first = next((m for m, column in enumerate(zip(*jets, strict=True)) if sum(column)), None)
    if first is None:
        raise RefusedError("no sign near 0")
    for h in (Fraction(2) ** -k for k in range(-2, 20)):
        if _sum(terms, iv.mpf([0, mpf(h.numerator) / h.denominator]))[first].a > 0:
            return h
    raise RefusedError("no sign near 0")


def _tail(terms: Any) -> Fraction:
    """Where the fastest function outweighs the rest: sinh(a t) >= e^(a t) (1 - e^(-2 a Y)) / 2, tanh <= 1."""
    sinh = [(alpha, l) for kind, _, alpha, l in terms if kind == "sinh"]
    powers: dict[int, Fraction] = {}
    for kind, k, alpha, l in terms:
        if kind == "power":
            powers[k] = powers.get(k, Fraction(0)) + l * alpha**k
    bounded = sum((abs(l) for kind, _, _, l in terms if kind == "tanh"), Fraction(0))
    if len(sinh) > 1:
        raise UnsupportedError
    for Y in (Fraction(2) ** k for k in range(2, 12)):
        if sinh:
            (alpha, l), rate = sinh[0], _iv(sinh[0][0] * Y)
            if any(alpha * Y < k for k in powers):
                continue
            rest = sum((_iv(max(-v, Fraction(0)) * Y**k) for k, v in powers.items()), _iv(bounded)) * iv.exp(-rate)
            room = _iv(l) / 2 * (1 - iv.exp(-2 * rate)) - rest
        elif any(powers.values()):
            top = max(k for k, v in powers.items() if v)
            rest = sum((max(-v, Fraction(0)) * Y ** (k - top) for k, v in powers.items() if k < top), bounded / Y**top)
            room = _iv(powers[top] - rest)
        else:
            room = iv.mpf(1 if all(l > 0 for *_, l in terms) else -1)
        if room.a > 0:
            return Y
    raise RefusedError("no sign at infinity")


def _compact(terms: Any, start: Fraction, end: Fraction) -> None:
    pieces, budget = [(start, end)] if start < end else [], 4000
    while pieces:
        a, b = pieces.pop()
        budget -= 1
        _require(budget > 0, "budget")
        t = iv.mpf([mpf(a.numerator) / a.denominator, mpf(b.numerator) / b.denominator])
        middle = (a + b) / 2
        G, D = _sum(terms, t)[:2]
        if G.a >= 0:
            continue
        at = _sum(terms, iv.mpf(mpf(middle.numerator) / middle.denominator))[0]
        _require(at.b >= 0, "a wrong sign")
        if (at + D * (t - iv.mpf(mpf(middle.numerator) / middle.denominator))).a >= 0:
            continue
        pieces += [(a, middle), (middle, b)]
