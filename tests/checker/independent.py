# ruff: noqa: E741 (l is the letter of the mathematics)
"""What an accepted file asserts, looked at once more in floating point by other code: sampling, eigenvalues, Newton.

Written from docs/certificate-format.md. It can only find fault: an empty list means that no fault was found.
"""

import math
from fractions import Fraction
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from persid.models.functions import scalar_function

TOLERANCE = 1e-7
Array = np.ndarray


def _number(pair: list[int]) -> float:
    limit = Fraction(2) ** 1000  # a mutant may say more
    return float(min(limit, max(-limit, Fraction(pair[0]) * Fraction(2) ** pair[1])))


def _numbers(pairs: list[list[int]]) -> Array:
    return np.array([_number(pair) for pair in pairs])


def _matrix(rows: list[list[str]], width: int) -> Array:
    return np.array([[float.fromhex(v) for v in row] for row in rows]).reshape(len(rows), width)


class Model:
    """The model as floats: channels (function, row, column) and groups of (channel, alpha)."""

    def __init__(self, form: dict[str, Any]) -> None:
        n, m = len(form["states"]), len(form["inputs"])
        self.n, self.m = n, m
        self.A0, self.B = _matrix(form["A0"], n), _matrix(form["B"], m)
        self.b, self.x_ref, self.u_ref = (
            np.array([float.fromhex(v) for v in form[k]]) for k in ("b", "x_ref", "u_ref")
        )
        self.f, rows, columns = [], [], []
        for term in form["terms"]:
            R = np.eye(n) if term["R"] is None else _matrix(term["R"], n)
            A = _matrix(term["A"], len(R))
            for k, row in enumerate(R):
                text = term["f"] if isinstance(term["f"], str) else term["f"][k]
                if text.strip() == "x":
                    self.A0 = self.A0 + np.outer(A[:, k], row)
                else:
                    self.f.append(scalar_function(text))
                    rows.append(row)
                    columns.append(A[:, k])
        self.R = np.array(rows).reshape(len(rows), n)
        self.A = np.array(columns).reshape(len(columns), n).T
        self.groups: list[tuple[Array, list[tuple[int, float]]]] = []
        for c, row in enumerate(self.R):
            self._join(c, row)

    def _join(self, c: int, row: Array) -> None:
        for first, members in self.groups:
            scale = np.abs(first).max()
            alpha = np.abs(row).max() / scale if scale else 1.0
            if (alpha or not row.any()) and np.array_equal(alpha * first, row):
                members.append((c, alpha or 1.0))
                return
        self.groups.append((row, [(c, 1.0)]))

    def F(self, x: Array, u: Array) -> Array:
        d = x - self.x_ref
        values = np.array([f.value(np.array(y)) for f, y in zip(self.f, self.R @ d, strict=True)])
        return self.A0 @ d + self.A @ values + self.B @ (u - self.u_ref) + self.b

    def J(self, x: Array) -> Array:
        slopes = [f.derivative(np.array(y)) for f, y in zip(self.f, self.R @ (x - self.x_ref), strict=True)]
        return self.A0 + self.A @ np.diag(np.array(slopes).reshape(-1)) @ self.R

    def rest(self, ball: dict[str, Any], u: Array) -> tuple[Array, bool]:
        """Newton's equilibrium from the centre, and whether it lies in the ball."""
        x = centre = _numbers(ball["x"])
        for _ in range(30):
            x = x - np.linalg.lstsq(self.J(x), self.F(x, u), rcond=None)[0]
        inside = np.abs(x - centre).max() <= _number(ball["radius"]) * (1 + 1e-6) + 1e-9
        return x, bool(inside and np.abs(self.F(x, u)).max() < 1e-6)


def faults(certificate: dict[str, Any]) -> list[str]:
    """Return what is found wrong with an accepted certificate."""
    model = Model(certificate["model"])
    with np.errstate(all="ignore"):
        if certificate["claim"] == "refuted":
            return _refutation_faults(certificate, model)
        if certificate["claim"] == "infeasible":
            return _infeasibility_faults(certificate, model)
        return _stability_faults(certificate, model)


def _N(model: Model, g: int) -> Array:
    row, members = model.groups[g]
    N = np.zeros((1 + len(members), model.n + len(model.f)))
    N[0, : model.n] = row
    for j, (c, _) in enumerate(members, start=1):
        N[j, model.n + c] = 1
    return N


def _stability_faults(certificate: dict[str, Any], model: Model) -> list[str]:
    n, found = model.n, []
    point = certificate["operating_point"]
    x, B = model.x_ref, model.B
    if point is not None:
        x, inside = model.rest(point, _numbers(point["u"]))
        found += [] if inside else ["no equilibrium in the ball"]
    elif model.b.any():
        B = np.column_stack([B, model.b])
    if "diagonal" in certificate["P"]:
        P = np.diag(_numbers(certificate["P"]["diagonal"]))
    else:
        rows = certificate["P"]["lower"]
        P = np.array([[_number(rows[max(i, j)][min(i, j)]) for j in range(n)] for i in range(n)])
    size = n + len(model.f)
    G = np.hstack([model.A0, model.A])
    Et, S, W, Pt = np.zeros((n, size)), np.zeros((size, size)), np.zeros((size, size)), P.copy()
    Et[:, :n] = P
    W[:n, :n] = P
    for g, proof in enumerate(certificate["groups"]):
        N, row = _N(model, g), model.groups[g][0]
        forms = [_numbers(form) for form in proof["forms"]]
        used = {k for k, mu in enumerate(proof["mu"]) if mu[0]} | {
            k for *pair, tau in proof["products"] if tau[0] for k in pair
        }
        found += _form_faults(certificate, model, g, [(k, forms[k]) for k in sorted(used)], x)
        for k, mu in enumerate(proof["mu"]):
            value = _number(mu)
            Et += value * np.outer(row, forms[k] @ N)
            if value and certificate["claim"] in ("E", "R"):
                c = _number(proof["integral"][k])
                W += value * c * (np.outer(N[0], forms[k] @ N) + np.outer(forms[k] @ N, N[0]))
            if value and certificate["claim"] == "R":
                Pt = Pt + value * _number(proof["quadratic"][k]) * np.outer(row, row)
            found += ["a negative mu"] if value < 0 else []
        for k, l, tau in proof["products"]:
            p, q = forms[k] @ N, forms[l] @ N
            S += _number(tau) * (np.outer(p, q) + np.outer(q, p))
            found += ["a negative tau"] if tau[0] < 0 else []
    Q = Et.T @ G + G.T @ Et + S
    kappa = _number(certificate["kappa"]) if "kappa" in certificate else 0.0
    kept = [i for i in range(size) if i not in certificate["dropped"]]
    loss, side = (-Q - kappa * W)[np.ix_(kept, kept)], -(Et.T @ B)[kept]
    Gamma = _Gamma(certificate["gamma"], B.shape[1])
    gamma = max(np.linalg.eigvalsh(Gamma), default=1.0)
    found += _indefinite("the inequality", np.block([[loss, side], [side.T, Gamma]]))
    states = [i for i in kept if i < n]
    p = _number(certificate["p"]) if "p" in certificate else 0.0
    found += _indefinite("P", Pt[np.ix_(states, states)] - p * np.eye(len(states)))
    rest = [i for i in range(size) if i not in kept]
    found += ["a dropped entry acts"] if G[:, rest].any() or Q[rest].any() or Et[:, rest].any() else []
    if certificate["claim"] == "M":
        rows_kept = [model.R[c] for c in range(len(model.f)) if n + c in kept]
        rank = np.linalg.matrix_rank(np.array([*np.eye(n)[states], *rows_kept]).reshape(-1, n))
        found += ["kept entries do not span"] if rank < n else []
    if certificate["claim"] == "R":
        found += _region_faults(certificate, x, Pt, gamma, kappa)
    return found


def _Gamma(stored: Any, width: int) -> Array:
    if isinstance(stored, list):
        return _number(stored) * np.eye(width)
    rows = stored["lower"]
    return np.array([[_number(rows[max(i, j)][min(i, j)]) for j in range(width)] for i in range(width)])


def _indefinite(what: str, M: Array) -> list[str]:
    if not len(M):
        return []
    scale = np.sqrt(np.maximum(np.abs(np.diag(M)), 1e-300))
    return [f"{what} is not positive definite"] if np.linalg.eigvalsh(M / np.outer(scale, scale))[0] < -1e-9 else []


def _domain(certificate: dict[str, Any], row: Array, x: Array) -> tuple[float, float]:
    if certificate["claim"] != "R":
        return -40.0, 40.0
    box = np.array([[_number(lo), _number(hi)] for lo, hi in certificate["box"]]) - x[:, None]
    ends = np.sort(row[:, None] * box, axis=1)
    return float(ends[:, 0].sum()), float(ends[:, 1].sum())


def _form_faults(
    certificate: dict[str, Any], model: Model, g: int, forms: list[tuple[int, Array]], x: Array
) -> list[str]:
    row, members = model.groups[g]
    lo, hi = _domain(certificate, row, x)
    y0, found = float(row @ (x - model.x_ref)), []
    proof = certificate["groups"][g]
    for end in (lo, hi):
        s = np.concatenate([[0.0], end * np.geomspace(1e-5, 1, 4001)])
        phi = np.array([s, *(model.f[c].value(a * (y0 + s)) - model.f[c].value(np.array(a * y0)) for c, a in members)])
        for k, form in forms:
            F, size = form @ phi, np.abs(form) @ np.abs(phi)
            if (np.sign(end) * F < -TOLERANCE * size - 1e-13).any():
                found.append(f"group {g}: form {k} has the wrong sign")
            area = cumulative_trapezoid(F, s, initial=0)
            slack = np.where(np.abs(s) < 1e-3 * abs(end), np.inf, 1e-4 * np.abs(area) + 1e-9 * (np.abs(s) * size))
            active = certificate["claim"] if proof["mu"][k][0] else ""
            if active in ("E", "R") and (area > _number(proof["integral"][k]) * s * F + slack).any():
                found.append(f"group {g}: the constant c of form {k} is too small")
            if active == "R" and (area + slack < _number(proof["quadratic"][k]) / 2 * s**2).any():
                found.append(f"group {g}: the constant d of form {k} is too large")
    return found


def _region_faults(certificate: dict[str, Any], x: Array, Pt: Array, gamma: float, kappa: float) -> list[str]:
    level, bound = _number(certificate["level"]), _number(certificate["input_bound"])
    half = [min(x[i] - _number(lo), _number(hi) - x[i]) for i, (lo, hi) in enumerate(certificate["box"])]
    found = ["the point is not in the box"] if min(half) <= 0 else []
    reach = level * np.diag(np.linalg.inv(Pt))
    found += ["the set meets a face"] if (reach > np.square(half) * (1 + 1e-9)).any() or level <= 0 else []
    return found + (["the input is too large"] if gamma * bound**2 > kappa * level * (1 + 1e-9) or bound < 0 else [])


def _infeasibility_faults(certificate: dict[str, Any], model: Model) -> list[str]:
    L = np.array(certificate["L"], dtype=float)
    X, G, n = L @ L.T, np.hstack([model.A0, model.A]), model.n
    GX = (G @ X)[:, :n]
    found = _indefinite("the product with P", GX + GX.T) if certificate["family"] == "full" else []
    found += ["a product with P"] if (np.diag(GX) < 0).any() else []
    for g, proof in enumerate(certificate["groups"]):
        N, row = _N(model, g), model.groups[g][0]
        rows = [N[0], *(_numbers(form) @ N for form in proof["forms"])]
        found += ["a product with mu"] if any(row @ G @ X @ p < 0 for p in rows[1:]) else []
        found += ["a product with tau"] if any(p @ X @ q < 0 for i, p in enumerate(rows) for q in rows[:i]) else []
    return found


def _refutation_faults(certificate: dict[str, Any], model: Model) -> list[str]:
    witness, u = certificate["witness"], _numbers(certificate["u"])
    kind = witness["kind"]
    points = witness.get("points") or ([witness["point"]] if "point" in witness else [])
    rests = [model.rest(point, u) for point in points]
    found = [] if all(inside for _, inside in rests) else ["no equilibrium in the ball"]
    far = np.array([1e3, -1e3])
    if kind == "two-equilibria":
        found += ["one equilibrium"] if np.abs(rests[0][0] - rests[1][0]).max() < 1e-9 else []
    elif kind in ("unstable-equilibrium", "unstable-linear-part"):
        J = model.J(rests[0][0]) if rests else model.A0
        found += ["stable"] if np.linalg.eigvals(J).real.max() <= 0 else []
    elif kind == "marginal-direction":
        w = _numbers(witness["direction"])
        found += ["not marginal"] if np.abs(w @ model.A0).max() > 0 or not (w @ model.B).any() else []
        for f, a in zip(model.f, w @ model.A, strict=True):
            found += (
                ["restoring"] if (a * f.value(1e3 * far) < 2 * np.minimum(a * f.value(far), 0) - 1e-9).any() else []
            )
    elif kind == "cooperative-growth":
        start = _numbers(witness["start"])
        found += ["F < 0 at the start"] if model.F(start, u).min() < 0 else []
        found += ["not above"] if (start < rests[0][0] - 1e-9).any() or (start <= rests[0][0]).all() else []
    else:
        v, s0 = _numbers(witness["direction"]), _number(witness["offset"])
        F = model.F(model.x_ref + s0 * v, u)
        found += (
            ["the line bends"]
            if not math.isclose(abs(F @ v), np.linalg.norm(F) * np.linalg.norm(v), rel_tol=1e-9)
            else []
        )
        found += ["it returns"] if s0 * (F @ v) < 0 else []
    return found
