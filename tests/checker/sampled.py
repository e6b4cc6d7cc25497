# ruff: noqa: E741 (l is the letter of the mathematics)
"""What an accepted ledger asserts, looked at in floating point along the model itself: V, V' and the bounds, sampled.

Written from sections 1, 2, 4, 5, 7 and 10 of docs/ledger.md; no matrix is assembled here. An empty list means that no
fault was found.
"""

from fractions import Fraction
from typing import Any

import numpy as np

from checker.independent import Model
from persid.models.functions import scalar_function

TOLERANCE = 1e-6
SAMPLES = 400
Array = np.ndarray
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_PARTS = 24


def number(pair: list[int]) -> float:
    """A dyadic in floating point."""
    limit = Fraction(2) ** 900
    return float(min(limit, max(-limit, Fraction(pair[0]) * Fraction(2) ** pair[1])))


class Sampled:
    """V and its derivative by x, evaluated point by point from the file."""

    def __init__(self, content: dict[str, Any]) -> None:
        self.content, self.model = content, Model(content["model"])
        point = content["operating_point"]
        self.x = self.model.x_ref if point is None else np.array([number(v) for v in point["x"]])
        self.u = self.model.u_ref if point is None else np.array([number(v) for v in point["u"]])
        self.null = point is None
        self.discrete = content["model"].get("time") == "discrete"
        stored = content["P"]
        self.inside = stored.get("channels", [])
        if "diagonal" in stored:
            self.P = np.diag([number(v) for v in stored["diagonal"]])
        else:
            L = np.zeros((self.model.n + len(self.inside),) * 2)
            for i, row in enumerate(stored["lower"]):
                L[i, : i + 1] = [number(v) for v in row]
            self.P = L + np.tril(L, -1).T
        self.points = []
        for each in content["points"]:
            curve = content["curves"][each["curve"]]
            row = np.zeros(self.model.n)
            for i, v in each["row"]:
                row[i] = number(v)
            functions = [(scalar_function(text), number(a)) for text, a in curve["functions"]]
            self.points.append((each, curve, row, functions, float(row @ (self.x - self.model.x_ref))))

    def phi(self, p: int, y: Array) -> Array:
        """Phi_p at y, one row a value."""
        _, _, _, functions, star = self.points[p]
        columns = [y]
        for f, a in functions:
            base = 0.0 if self.null else f.value(np.array([a * star]))
            columns.append(f.value(a * (star + y)) - base)
        return np.stack(columns, axis=-1)

    def integral(self, p: int, l: Array, y: float) -> float:
        """The integral of l'Phi_p from 0 to y."""
        edges = np.linspace(0.0, y, _PARTS + 1)
        middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
        inner = (middle[:, None] + half[:, None] * _NODES).ravel()
        return float(((self.phi(p, inner) @ l).reshape(_PARTS, -1) @ _WEIGHTS * half).sum())

    def form(self, p: int, k: int) -> Array:
        """Form k at point p."""
        return np.array([number(v) for v in self.points[p][1]["forms"][k]["l"]])

    def z(self, x: Array) -> tuple[Array, Array]:
        """The state and the values that P reads, and their derivative by x."""
        m, values, slopes = self.model, [], []
        for c in self.inside:
            f, row = m.f[c], m.R[c]
            base = 0.0 if self.null else f.value(np.array(row @ (self.x - m.x_ref)))
            y = np.array(row @ (self.x - m.x_ref + x))
            values.append(float(f.value(y) - base))
            slopes.append(float(f.derivative(y)) * row)
        return np.append(x, values), np.vstack([np.eye(m.n), *slopes])

    @property
    def reads_functions(self) -> bool:
        """Whether V is more than a quadratic form of the state."""
        return bool(self.inside) or any(mu[0] for each, *_ in self.points for _, mu in each["densities"])

    def V(self, x: Array) -> float:
        """V at x, relative to x*."""
        z, _ = self.z(x)
        total = float(z @ self.P @ z)
        for p, (each, _, row, _, _) in enumerate(self.points):
            for k, mu in each["densities"]:
                if mu[0]:
                    total += 2 * number(mu) * self.integral(p, self.form(p, k), float(row @ x))
        return total

    def gradient(self, x: Array) -> Array:
        """The gradient of V."""
        z, slopes = self.z(x)
        total = 2 * slopes.T @ self.P @ z
        for p, (each, _, row, _, _) in enumerate(self.points):
            for k, mu in each["densities"]:
                if mu[0]:
                    total = total + 2 * number(mu) * float(self.phi(p, np.array([row @ x]))[0] @ self.form(p, k)) * row
        return total

    def rise(self, x: Array, v: Array) -> Array:
        """x', or x+ in discrete time, without deviations: x relative to x*, v the input less u*."""
        m, at = self.model, self.x + x - self.model.x_ref
        channels = np.array([f.value(np.array([row @ at]))[0] for f, row in zip(m.f, m.R, strict=True)])
        rest = np.zeros(m.n)
        if not self.null:  # what makes x* rest exactly: the centre of its ball does nearly
            here = self.x - m.x_ref
            still = np.array([f.value(np.array([row @ here]))[0] for f, row in zip(m.f, m.R, strict=True)])
            rest = m.A0 @ here + m.A @ still + m.B @ (self.u - m.u_ref) + m.b
        return m.A0 @ at + m.A @ channels + m.B @ (self.u - m.u_ref + v) + m.b - rest


def _Gamma(content: dict[str, Any], width: int) -> Array:
    stored = content["gamma"]
    if not isinstance(stored, dict):
        return number(stored) * np.eye(width)
    L = np.zeros((width, width))
    for i, row in enumerate(stored["lower"]):
        L[i, : i + 1] = [number(v) for v in row]
    return L + np.tril(L, -1).T


def _strips(look: Sampled) -> list[tuple[Array, float, float]]:
    found = []
    for _, curve, row, _, _ in look.points:
        if curve["domain"] is not None:
            found.append((row, *(number(v) for v in curve["domain"])))
    for stored, lo, hi in look.content["strips"]:
        row = np.zeros(look.model.n)
        for i, v in stored:
            row[i] = number(v)
        found.append((row, number(lo), number(hi)))
    return found


def faults(content: dict[str, Any], seed: int = 0, samples: int = SAMPLES) -> list[str]:
    """Faults with what an accepted ledger asserts."""
    rng, look = np.random.default_rng(seed), Sampled(content)
    strips, claim = _strips(look), content["claim"]
    kappa, p = number(content["kappa"]), number(content["p"])
    counts_b = look.null and bool(look.model.b.any())
    Gamma = _Gamma(content, look.model.m + counts_b)
    spread = sum(number(d["s"]) * number(d["epsilon"]) ** 2 for d in content["deviations"])
    slack, below = _offsets(look, kappa)
    found: list[str] = []
    with np.errstate(all="ignore"):
        for _ in range(samples):
            x = rng.normal(size=look.model.n) * 10 ** rng.uniform(-3, 1.2)
            if strips:
                x *= rng.uniform(0.2, 1) * min(
                    1.0, *(((hi if row @ x > 0 else -lo) / max(abs(row @ x), 1e-300)) for row, lo, hi in strips)
                )
            v = rng.normal(size=look.model.m) * 10 ** rng.uniform(-3, 2) * rng.choice([0.0, 1.0])
            full = np.append(v, 1.0) if counts_b else v
            V, gradient, drift = look.V(x), look.gradient(x), look.rise(x, v)
            if not np.isfinite([V, *gradient, *drift]).all() or np.abs([*gradient, *drift]).max() > 1e12:
                continue
            sizes, worst = _worst(look, x, full, gradient)
            change = float(gradient @ drift) + worst
            limit = -kappa * V + float(full @ Gamma @ full) + spread + slack
            size = float(np.abs(gradient) @ (np.abs(drift) + sizes)) + abs(limit) + abs(V)
            if look.discrete:  # V after the step instead of the derivative along the solution
                if not _stays(look, strips, x, full, kappa, Gamma, spread):
                    continue
                after = _worst_step(look, x, full, drift)
                change, size = after - V, abs(after) + abs(limit) + abs(V)
            if change > limit + TOLERANCE * size + 1e-12:
                found.append(f"V' = {change} > {limit} at x = {x}, v = {v}")
            if claim != "iss" and p * float(x @ x) - below - TOLERANCE * (abs(V) + p * float(x @ x)) > V:
                found.append(f"V = {V} < p |x|^2 at {x}")
            z = np.abs(look.z(x)[0])
            if claim == "iss" and -TOLERANCE * float(z @ np.abs(look.P) @ z) > V:
                found.append(f"V = {V} < 0 at {x}")
            found += _output_faults(look, x, V)
        found += _region_faults(look, strips, Gamma, kappa, spread, rng)
    return found[:5]


def _stays(look: Sampled, strips: Any, x: Array, v: Array, kappa: float, Gamma: Array, spread: float) -> bool:
    """Whether V after a step is spoken of: of a region whose V reads functions only from the level set, for inputs
    that it admits."""
    if not strips or not look.reads_functions:
        return True
    level = number(look.content["level"])
    return bool(look.V(x) <= level and float(v @ Gamma @ v) + spread <= kappa * level)


def _worst_step(look: Sampled, x: Array, v: Array, after: Array) -> float:
    """The largest V after a step with deviations, of some directions of each."""
    rng, ends = np.random.default_rng(0), [after]
    for deviation, radius in zip(look.content["deviations"], _radii(look, x, v), strict=True):
        L = _columns(look, deviation)
        push = L.T @ look.gradient(after)
        found = [push, *rng.normal(size=(4, L.shape[1]))]
        ends = [end + L @ (w / max(np.linalg.norm(w), 1e-300)) * radius for end in ends for w in found]
    return max(look.V(end) for end in ends)


def faults_of_pairs(content: dict[str, Any], seed: int = 0, samples: int = SAMPLES) -> list[str]:
    """Faults with what a ledger asserts of any two solutions: V(d)' <= -kappa V(d) + (u - u~)'Gamma (u - u~)."""
    rng, look, found = np.random.default_rng(seed), Sampled(content), []
    m, kappa = look.model.m, number(content["kappa"])
    Gamma = _Gamma(content, m + (look.null and bool(look.model.b.any())))[:m, :m]
    for _ in range(samples):
        x, y = rng.normal(size=(2, look.model.n)) * 10 ** rng.uniform(-3, 1.2)
        v, w = rng.normal(size=(2, m)) * 10 ** rng.uniform(-3, 2)
        d, rise = x - y, look.rise(x, v) - look.rise(y, w)
        V = float(d @ look.P @ d)
        change = float(rise @ look.P @ rise) - V if look.discrete else 2 * float(d @ look.P @ rise)
        limit = -kappa * V + float((v - w) @ Gamma @ (v - w))
        if change > limit + TOLERANCE * (abs(change) + abs(limit) + V) + 1e-12:
            found.append(f"{change} > {limit} between {x} and {y}")
    return found[:5]


def _offsets(look: Sampled, kappa: float) -> tuple[float, float]:
    slack = below = 0.0
    for each, curve, *_ in look.points:
        for k, mu in each["densities"]:
            form = curve["forms"][k]
            other = form if form["lower"] is None else curve["forms"][form["lower"][1]]
            below += 2 * number(mu) * number(other["offset"])
            slack += 0.0 if form["upper"] is None else kappa * 2 * number(mu) * number(form["upper"][1])
    for p, j, tau in look.content["facts"]["constant"]:
        slack += 2 * number(tau) * number(look.points[p][1]["products"][j][2])
    return slack, below


def _worst(look: Sampled, x: Array, v: Array, gradient: Array) -> tuple[Array, float]:
    """The most that deviations add to V', and their sizes."""
    total, sizes = 0.0, np.zeros(look.model.n)
    for deviation, radius in zip(look.content["deviations"], _radii(look, x, v), strict=True):
        L = _columns(look, deviation)
        total += float(np.linalg.norm(L.T @ gradient)) * radius
        sizes = sizes + np.abs(L).sum(axis=1) * radius
    return sizes, total


def _radii(look: Sampled, x: Array, v: Array) -> list[float]:
    """The sizes that deviations may have at x and v."""
    m, found = look.model, []
    at = look.x + x - m.x_ref
    channels = np.array([f.value(np.array([row @ at]))[0] for f, row in zip(m.f, m.R, strict=True)])
    if not look.null:
        here = look.x - m.x_ref
        channels = channels - np.array([f.value(np.array([row @ here]))[0] for f, row in zip(m.f, m.R, strict=True)])
    zeta = np.concatenate([x, channels, v])
    for deviation in look.content["deviations"]:
        square = number(deviation["epsilon"]) ** 2
        for row in deviation["C"]:
            square += sum(number(value) * zeta[i] for i, value in row) ** 2
        found.append(float(np.sqrt(max(square, 0.0))))
    return found


def _columns(look: Sampled, deviation: dict[str, Any]) -> Array:
    L = np.zeros((look.model.n, len(deviation["columns"])))
    for c, row in enumerate(deviation["columns"]):
        for i, value in row:
            L[i, c] = number(value)
    return L


def _output_faults(look: Sampled, x: Array, V: float) -> list[str]:
    found, block = [], look.content["outputs"] or {"C": [], "constants": []}
    for row, c in zip(block["C"], block["constants"], strict=True):
        y = sum(float.fromhex(v) * x[i] for i, v in enumerate(row))
        if y * y > number(c) * V * (1 + TOLERANCE):
            found.append(f"the output {y} at {x} is larger than its bound")
    return found


def _region_faults(look: Sampled, strips: Any, Gamma: Array, kappa: float, spread: float, rng: Any) -> list[str]:
    if look.content["claim"] != "region":
        return []
    level, bound = number(look.content["level"]), number(look.content["input_bound"])
    found = []
    largest = float(np.linalg.eigvalsh(Gamma)[-1]) if len(Gamma) else 0.0
    if largest * bound**2 + spread > kappa * level * (1 + TOLERANCE):
        found.append("the input bound is too large")
    for row, lo, hi in strips:
        for _ in range(60):
            x = rng.normal(size=look.model.n) * 10 ** rng.uniform(-2, 1)
            if not row @ x:
                continue
            x *= (hi if row @ x > 0 else -lo) / abs(row @ x)
            if all(a - 1e-9 <= r @ x <= b + 1e-9 for r, a, b in strips) and look.V(x) <= level * (1 - TOLERANCE):
                found.append(f"V <= level on a face, at {x}")
    return found
