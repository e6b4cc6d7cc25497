# ruff: noqa: E741 (l is the letter of the mathematics)
"""A second, small checker of ledgers, written from docs/ledger.md alone: claims iss and rate-and-gain about x_ref.

Fractions for the matrix, in one dense sum over rows of zeta; for the functions x**k (odd k), sinh(x), tanh(x) its own
bisection by mpmath, which needs no partition. It answers "accepted", "refused" or "unsupported".
"""

import hashlib
import json
from fractions import Fraction
from typing import Any

from mpmath import iv, mpf

from checker.second import (
    RefusedError,
    UnsupportedError,
    _channels,
    _dyadic,
    _exact,
    _iv,
    _product,
    _require,
    _transposed,
)
from checker.second import _jet as jet
from checker.second import _sector_form as sector_form

Row = list[Fraction]
_ZERO = Fraction(0)


def verdict(text: bytes) -> str:
    """Check the bytes of a ledger."""
    try:
        _check(json.loads(text))
    except UnsupportedError:
        return "unsupported"
    except (RefusedError, ValueError, KeyError, IndexError, TypeError, AttributeError, ZeroDivisionError):
        return "refused"
    return "accepted"


def _check(data: dict[str, Any]) -> None:
    _require(data["format"] == "persid-certificate-2", "format")
    if data["claim"] not in ("iss", "rate-and-gain") or data["operating_point"] is not None or data["outputs"]:
        raise UnsupportedError
    if data["facts"]["one_signed"] or data["facts"]["constant"] or data["spanning"] or "identity" in data["facts"]:
        raise UnsupportedError
    form = data["model"]
    text = json.dumps(form, sort_keys=True, separators=(",", ":"))
    _require(hashlib.sha256(text.encode()).hexdigest() == data["model_sha256"], "hash")
    n = len(form["states"])
    A0 = [[_exact(v) for v in row] for row in form["A0"]]
    channels = _channels(form, n, A0)
    B = [[_exact(v) for v in row] for row in form["B"]]
    if any(_exact(v) for v in form["b"]):
        B = [[*row, _exact(v)] for row, v in zip(B, form["b"], strict=True)]
    m, own = len(B[0]), n + len(channels)
    columns = [column for deviation in data["deviations"] for column in deviation["columns"]]
    inside = data["P"].get("channels", [])
    _require(all(type(c) is int and 0 <= c < len(channels) for c in inside) and inside == sorted(set(inside)), "inside")
    last = own + m + len(columns)
    size, sigma = last + len(inside), {c: last + i for i, c in enumerate(inside)}
    L = [[sum((_dyadic(v) for k, v in column if k == i), _ZERO) for column in columns] for i in range(n)]
    rest = [_ZERO] * len(inside)
    G = [[*A0[i], *(channel[2][i] for channel in channels), *B[i], *L[i], *rest] for i in range(n)]
    steps = _is_discrete(form)
    # the derivative of z, or z+ in discrete time
    G += [[Fraction(j == sigma[c] or (steps and j == n + c)) for j in range(size)] for c in inside]
    z = [*range(n), *(n + c for c in inside)]
    kappa, p = _dyadic(data["kappa"]), _dyadic(data["p"])
    rated = data["claim"] == "rate-and-gain"
    _require((kappa > 0 and p > 0) if rated else kappa == p == 0, "kappa, p")
    _require(not data["strips"] and not any(data["level"][:1]) and not any(data["input_bound"][:1]), "region")
    points = [_Point(data, each, channels, n, size) for each in data["points"]]
    _require({c for point in points for c in point.channels} == set(range(len(channels))), "a channel without point")
    M = [[_ZERO] * size for _ in range(size)]
    P, Pt = _P(data["P"], len(z)), _P(data["P"], len(z))
    half = [[_ZERO] * size for _ in z]  # half the gradient by z, rows over zeta
    for i, a in enumerate(z):
        for j, b in enumerate(z):
            half[i][b], M[a][b] = P[i][j], -kappa * P[i][j]
    _require(not data["facts"].get("slope" if steps else "step"), "slopes are facts of flows, steps of steps")
    for point in points:
        _densities(M, half, point, kappa)
        _squares(Pt, point, inside)
        if steps:
            _gained(M, point, G, sigma)
    _facts(M, points, data["facts"])
    _along(M, points, data["facts"].get("slope", []), G, sigma)
    if steps:
        _require(kappa < 1, "kappa in steps")
        _step(M, P, G, z)
        _over_steps(M, points, data["facts"].get("step", []), G, sigma)
    for i in range(0 if steps else len(z)):
        _add(M, half[i], G[i], Fraction(-1))
    _bounds(M, data, own, m)
    dropped = data["dropped"]
    _require(all(n <= d < own and not any(M[d]) for d in dropped) and len(set(dropped)) == len(dropped), "dropped")
    kept = [i for i in range(size) if i not in dropped]
    _dominated([[M[i][j] for j in kept] for i in kept], data["proof"]["M"])
    for i in range(n):
        Pt[i][i] -= p
    _dominated(Pt, data["proof"]["P"])


def _is_discrete(form: dict[str, Any]) -> bool:
    """Section 10: both fields, or none."""
    if "time" not in form and "dt" not in form:
        return False
    _require(form["time"] == "discrete" and _exact(form["dt"]) > 0, "time")
    return True


def _after(point: "_Point", k: int, G: list[Row], sigma: dict[int, int]) -> Row:
    """Form k at a point after the step: l_0 r'x+ and the values s + sigma, of channels that P reads."""
    first, *others = point.coefficients(k)
    row = [first * sum((r * g[j] for r, g in zip(point.row, G, strict=False)), _ZERO) for j in range(point.size)]
    for c, v in zip(point.channels, others, strict=True):
        if v:
            row[sigma[c]] += v
            row[point.n + c] += v
    return row


def _gained(M: list[Row], point: "_Point", G: list[Row], sigma: dict[int, int]) -> None:
    """Take away 2 mu (g+ (y+ - y) - d/2 (g+ - g)^2) of each density."""
    for k, pair in point.stored["densities"]:
        mu, lower = _dyadic(pair), point.curve["forms"][k]["lower"]
        if mu:
            _require(point.is_nondecreasing(k), "a density of steps")
            after, now = _after(point, k, G, sigma), point.form(k)
            y = [sum((r * g[j] for r, g in zip(point.row, G, strict=False)), _ZERO) for j in range(point.size)]
            _add(M, after, [a - b for a, b in zip(y, point.y(), strict=True)], -mu)
            if lower is not None:  # the others are not supported
                gap = [a - b for a, b in zip(after, now, strict=True)]
                _add(M, gap, gap, mu * _dyadic(lower[0]) / 2)


def _over_steps(M: list[Row], points: list["_Point"], facts: list[Any], G: list[Row], sigma: dict[int, int]) -> None:
    for a, b, sign, k, l, pair in facts:
        tau, first, second = _dyadic(pair), points[_index(a, points)], points[_index(b, points)]
        _require(tau >= 0 and type(sign) is int and sign in (-1, 0, 1), "step")
        if sign:
            _require(first.stored["curve"] == second.stored["curve"], "step")
            _require(first.is_nondecreasing(k) and first.is_nondecreasing(l), "step")
        else:
            _require(a == b and first.is_sector(k) and first.is_sector(l), "step")
        rows = []
        for f in (k, l):
            now = second.form(f) if sign else [_ZERO] * len(M)
            _require(
                not sign
                or all(c in sigma for c, v in zip(second.channels, second.coefficients(f)[1:], strict=True) if v),
                "P",
            )
            rows.append([v + sign * w for v, w in zip(_after(first, f, G, sigma), now, strict=True)])
        _add(M, rows[0], rows[1], -tau)


def _step(M: list[Row], P: list[Row], G: list[Row], z: list[int]) -> None:
    """Add z'P z - z+'P z+."""
    n, size = len(P), len(M)
    for i in range(n):
        for j in range(n):
            M[z[i]][z[j]] += P[i][j]
            if P[i][j]:
                for a in range(size):
                    for b in range(size):
                        M[a][b] -= P[i][j] * G[i][a] * G[j][b]


def _rooted(A: list[Row], root: dict[str, Any]) -> None:
    """Section 6, by a root: 2^b D A D - L L' is strictly diagonally dominant."""
    size, (h, b, L) = len(A), (root["shifts"], root["bits"], root["L"])
    if isinstance(L, str):
        raise UnsupportedError
    _require(len(h) == len(L) == size and all(len(row) == i + 1 for i, row in enumerate(L)), "root")
    two = Fraction(2)
    for i in range(size):
        row = []
        for j in range(size):
            squares = sum((x * y for x, y in zip(L[i], L[j], strict=False)), 0)
            row.append(two**b * two ** (h[i] + h[j]) * A[i][j] - squares)
        _require(row[i] > sum((abs(v) for j, v in enumerate(row) if j != i), _ZERO), "dominance")


def _dominated(A: list[Row], T: Any) -> None:
    """Section 6, with its powers of two; and Gauss's pivots."""
    if isinstance(T, dict):
        _rooted(A, T)
        return
    size = len(A)
    _require(len(T) == size and all(len(row) == i + 1 for i, row in enumerate(T)), "T")
    full = [[Fraction(v) for v in row] + [_ZERO] * (size - len(row)) for row in T]
    _require(all(type(v) is int for row in T for v in row), "T")
    C = _product(_product(full, A), _transposed(full))
    _require(all(C[i][i] > 0 for i in range(size)), "diagonal")
    scale = [Fraction(2) ** -(_bits(C[i][i]) // 2) for i in range(size)]
    for i in range(size):
        rest = sum((abs(C[i][j]) * scale[j] for j in range(size) if j != i), _ZERO)
        _require(rest < C[i][i] * scale[i], "dominance")
    pivots = [row[:] for row in A]
    for k in range(size):
        _require(pivots[k][k] > 0, "pivot")
        for i in range(k + 1, size):
            factor = pivots[i][k] / pivots[k][k]
            pivots[i] = [a - factor * b for a, b in zip(pivots[i], pivots[k], strict=True)]


def _bits(value: Fraction) -> int:
    """The b with 2^(b-1) <= value < 2^b."""
    b = value.numerator.bit_length() - value.denominator.bit_length()
    while Fraction(2) ** b <= value:
        b += 1
    while Fraction(2) ** (b - 1) > value:
        b -= 1
    return b


def _densities(M: list[Row], half: list[Row], point: "_Point", kappa: Fraction) -> None:
    for k, pair in point.stored["densities"]:
        mu, row = _dyadic(pair), point.form(k)
        _require(mu >= 0, "mu")
        if not mu:
            continue
        _require(point.is_sector(k), "density")
        for i, r in enumerate(point.row):
            half[i] = [h + mu * r * v for h, v in zip(half[i], row, strict=True)]
        if kappa:
            _add(M, point.y(), row, -kappa * mu * point.upper(k))


def _squares(Pt: list[Row], point: "_Point", inside: list[int]) -> None:
    """Bounds from below: by the square of the form itself, the others are not supported."""
    place = {c: point.n + i for i, c in enumerate(inside)}
    for k, pair in point.stored["densities"]:
        lower, l = point.curve["forms"][k]["lower"], point.coefficients(k)
        if lower is None:
            continue
        d, j = _dyadic(lower[0]), lower[1]
        if point.coefficients(j) != [Fraction(i == 0) - d * v for i, v in enumerate(l)]:
            raise UnsupportedError
        _require(d >= 0 and point.is_nondecreasing(j) and point.is_sector(k), "lower")
        row = [l[0] * r for r in point.row] + [_ZERO] * len(inside)
        for c, v in zip(point.channels, l[1:], strict=True):
            if v:
                row[place[c]] += v
        _add(Pt, row, row, _dyadic(pair) * d / 2)


def _along(M: list[Row], points: list["_Point"], facts: list[Any], G: list[Row], sigma: dict[int, int]) -> None:
    """Products of two forms of (r'G zeta, sigma); the supported functions are all Lipschitz and 0 at 0."""
    for p, k, l, pair in facts:
        tau, point = _dyadic(pair), points[_index(p, points)]
        _require(tau >= 0 and point.is_nondecreasing(k) and point.is_nondecreasing(l), "slope")
        rows = []
        for f in (k, l):
            first, *others = point.coefficients(f)
            row = [first * sum((r * g[j] for r, g in zip(point.row, G, strict=False)), _ZERO) for j in range(len(M))]
            for c, v in zip(point.channels, others, strict=True):
                if v:
                    row[sigma[c]] += v
            rows.append(row)
        _add(M, rows[0], rows[1], -tau)


def _facts(M: list[Row], points: list["_Point"], facts: dict[str, Any]) -> None:
    for p, k, l, pair in facts["value"]:
        tau, point = _dyadic(pair), points[_index(p, points)]
        _require(tau >= 0 and point.is_sector(k) and point.is_sector(l), "value")
        _add(M, point.form(k), point.form(l), -tau)
    for a, b, sign, k, l, pair in facts["difference"]:
        tau, first, second = _dyadic(pair), points[_index(a, points)], points[_index(b, points)]
        _require(tau >= 0 and sign in (1, -1) and first.stored["curve"] == second.stored["curve"], "difference")
        _require(first.is_nondecreasing(k) and first.is_nondecreasing(l), "difference")
        rows = [[v + sign * w for v, w in zip(first.form(f), second.form(f), strict=True)] for f in (k, l)]
        _add(M, rows[0], rows[1], -tau)  # the functions that are supported here are odd


def _bounds(M: list[Row], data: dict[str, Any], own: int, m: int) -> None:
    gamma = data["gamma"]
    _require(isinstance(gamma, dict) or _dyadic(gamma) > 0, "gamma")
    for i in range(m):
        for j in range(m):
            joint = _dyadic(gamma) if not isinstance(gamma, dict) and i == j else _ZERO
            M[own + i][own + j] += _dyadic(gamma["lower"][max(i, j)][min(i, j)]) if isinstance(gamma, dict) else joint
    place = own + m
    for deviation in data["deviations"]:
        s = _dyadic(deviation["s"])
        _require(s > 0 and _dyadic(deviation["epsilon"]) >= 0, "s")
        for listed in deviation["C"]:
            row = [sum((_dyadic(v) for k, v in listed if k == i), _ZERO) for i in range(own + m)]
            _add(M, row, row, -s / 2)
        for _ in deviation["columns"]:
            M[place][place] += s
            place += 1


def _index(i: int, listed: list[Any]) -> int:
    _require(type(i) is int and 0 <= i < len(listed), "index")
    return i


def _P(stored: dict[str, Any], n: int) -> list[Row]:
    if "diagonal" in stored:
        return [[_dyadic(stored["diagonal"][i]) if i == j else _ZERO for j in range(n)] for i in range(n)]
    return [[_dyadic(stored["lower"][max(i, j)][min(i, j)]) for j in range(n)] for i in range(n)]


def _add(M: list[Row], p: Row, q: Row, factor: Fraction) -> None:
    """Add factor (p q' + q p'), the form 2 factor (p'zeta)(q'zeta)."""
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            if a and b:
                M[i][j] += factor * a * b
                M[j][i] += factor * a * b


class _Point:
    """A point with its curve: rows over zeta, and the kinds of its forms, proved anew."""

    def __init__(self, data: dict[str, Any], stored: dict[str, Any], channels: list[Any], n: int, size: int) -> None:
        self.stored, self.size, self.n = stored, size, n
        self.curve = data["curves"][_index(stored["curve"], data["curves"])]
        if self.curve["shift"] is not None:
            raise RefusedError("shift")
        _require(self.curve["domain"] is None and not self.curve["products"], "domain")
        self.row = [sum((_dyadic(v) for k, v in stored["row"] if k == i), _ZERO) for i in range(n)]
        self.channels = stored["channels"]
        self.members = [(text.replace(" ", ""), _dyadic(a)) for text, a in self.curve["functions"]]
        _require(len(self.channels) == len(self.members), "channels")
        for c, (text, alpha) in zip(self.channels, self.members, strict=True):
            known, row, _ = channels[_index(c, channels)]
            _require(known.replace(" ", "") == text and alpha != 0 and row == [alpha * r for r in self.row], "channel")
        for k in range(len(self.curve["forms"])):
            self.prove(k)

    def y(self) -> Row:
        return [*self.row, *[_ZERO] * (self.size - self.n)]

    def coefficients(self, k: int) -> Row:
        return [_dyadic(v) for v in self.curve["forms"][_index(k, self.curve["forms"])]["l"]]

    def form(self, k: int) -> Row:
        l = self.coefficients(k)
        found = [l[0] * r for r in self.y()]
        for c, v in zip(self.channels, l[1:], strict=True):
            found[self.n + c] += v
        return found

    def prove(self, k: int) -> None:
        """The form is what the file says; with a bound only where a rule of the page gives it."""
        entry, l = self.curve["forms"][k], self.coefficients(k)
        _require(len(l) == 1 + len(self.members), "form")
        if entry["is"] not in ("sector", "nondecreasing"):
            raise UnsupportedError
        _require(_dyadic(entry["offset"]) == 0, "offset")
        if entry["is"] == "sector":
            sector_form(l, self.members)
        else:
            _nondecreasing(l, self.members)
        if entry["upper"] is not None:
            c, e, cuts = entry["upper"]
            if cuts is not None or _dyadic(e):
                raise UnsupportedError
            line = not any(l[1:]) and l[0] >= 0 and _dyadic(c) >= Fraction(1, 2)
            _require(line or (entry["is"] == "nondecreasing" and _dyadic(c) >= 1), "upper")

    def is_sector(self, k: int) -> bool:
        return self.curve["forms"][_index(k, self.curve["forms"])]["is"] in ("sector", "nondecreasing")

    def is_nondecreasing(self, k: int) -> bool:
        return self.curve["forms"][_index(k, self.curve["forms"])]["is"] == "nondecreasing"

    def upper(self, k: int) -> Fraction:
        upper = self.curve["forms"][k]["upper"]
        _require(upper is not None, "upper")
        return _dyadic(upper[0])


def _nondecreasing(l: Row, members: list[tuple[str, Fraction]]) -> None:
    """D = l_0 + sum l_j a_j f_j'(a_j t) >= 0 for t >= 0: all supported functions are odd, so D is even."""
    terms = [("power", 1, Fraction(1), l[0])] if l[0] else []
    odd = [((text, abs(a)), v if a > 0 else -v) for (text, a), v in zip(members, l[1:], strict=True)]
    for (text, alpha), v in odd:
        if v and text in ("sinh(x)", "tanh(x)"):
            terms.append((text[:4], 0, alpha, v))
        elif v and text[:3] == "x**" and text[3:].isdigit() and int(text[3:]) % 2:
            terms.append(("power", int(text[3:]), alpha, v))
        elif v:
            raise UnsupportedError
    if not terms:
        return
    end = _slope_tail(terms)
    start = _slope_germ(terms)
    pieces, budget = [(start, end)] if start < end else [], 6000
    while pieces:
        a, b = pieces.pop()
        budget -= 1
        _require(budget > 0, "budget")
        D, half = _slopes(terms, a, b), _slopes(terms, (a + b) / 2, (a + b) / 2)[0]
        if D[0].a >= 0:
            continue
        _require(half.b >= 0, "a slope of the wrong sign")
        reach = iv.mpf([-1, 1]) * _iv((b - a) / 2)
        if not (half + D[1] * reach).a >= 0:
            pieces += [(a, (a + b) / 2), ((a + b) / 2, b)]


def _slopes(terms: Any, a: Fraction, b: Fraction) -> list[Any]:
    t = iv.mpf([mpf(a.numerator) / a.denominator, mpf(b.numerator) / b.denominator])
    jets = [[_iv(l) * v for v in jet(kind, k, _iv(alpha), t, False)] for kind, k, alpha, l in terms]
    total = [sum(column, iv.mpf(0)) for column in zip(*jets, strict=True)]
    return [total[1], 2 * total[2]]


def _slope_germ(terms: Any) -> Fraction:
    """D = m c_m t^(m-1) + ... with the first exact coefficient that is not zero."""
    exact = [[l * v for v in jet(kind, k, alpha, Fraction(0), True)] for kind, k, alpha, l in terms]
    first = next((m for m, column in enumerate(zip(*exact, strict=True)) if sum(column)), None)
    if first is None:
        raise RefusedError("no sign near 0")
    for h in (Fraction(2) ** -k for k in range(-2, 20)):
        t = iv.mpf([0, mpf(h.numerator) / h.denominator])
        jets = [[_iv(l) * v for v in jet(kind, k, _iv(alpha), t, False)] for kind, k, alpha, l in terms]
        if sum((column[first] for column in jets), iv.mpf(0)).a > 0:  # D^(m-1) / (m-1)! is m times it
            return h
    raise RefusedError("no sign near 0")


def _slope_tail(terms: Any) -> Fraction:
    """cosh(a t) >= e^(a t) / 2, 0 <= tanh' <= 4 e^(-2 a t)."""
    sinh = [(alpha, l) for kind, _, alpha, l in terms if kind == "sinh"]
    tanh = [(alpha, l) for kind, _, alpha, l in terms if kind == "tanh"]
    powers: dict[int, Fraction] = {}
    for kind, k, alpha, l in terms:
        if kind == "power":
            powers[k - 1] = powers.get(k - 1, _ZERO) + l * k * alpha**k
    if len(sinh) > 1 or len(tanh) > 1:
        raise UnsupportedError
    for Y in (Fraction(2) ** k for k in range(1, 12)):
        small = _iv(max(-tanh[0][1], _ZERO) * tanh[0][0]) * 4 * iv.exp(-2 * _iv(tanh[0][0] * Y)) if tanh else iv.mpf(0)
        if sinh:
            (alpha, l), rate = sinh[0], _iv(sinh[0][0] * Y)
            if any(alpha * Y < k for k in powers):
                continue
            rest = sum((_iv(max(-v, _ZERO) * Y**k) for k, v in powers.items()), small) * iv.exp(-rate)
            room = _iv(l * alpha) / 2 - rest
        elif any(powers.values()):
            top = max(k for k, v in powers.items() if v)
            rest = sum(
                (_iv(max(-v, _ZERO) * Y ** (k - top)) for k, v in powers.items() if k < top), small / _iv(Y**top)
            )
            room = _iv(powers[top]) - rest
        else:
            room = iv.mpf(1 if tanh[0][1] > 0 else -1)
        if room.a > 0:
            return Y
    raise RefusedError("no sign at infinity")
