"""Inputs that try to break a bound: constants, square waves, and greedy ones that look at the state."""

from collections.abc import Callable

import numpy as np
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.models.model import PersidskiiModel

Policy = Callable[[float, ndarray], ndarray]  # v = u - u*, (N, m), of the time in s and of states (N, n)


def policies(certificate: Certificate, model: PersidskiiModel, u_sup: float | ndarray) -> dict[str, Policy]:
    """Return the adversaries with |u - u*| = u_sup, or |u_l - u_l*| = u_sup[l] each, for many states at once."""
    m, rate = model.m, float(np.abs(np.linalg.eigvals(model.jacobian(certificate.operating_point))).max())
    all_alike = u_sup / np.sqrt(m) * np.ones(m) if np.ndim(u_sup) == 0 else np.asarray(u_sup)
    found: dict[str, Policy] = {}
    for sign in (1.0, -1.0):
        found[f"constant {sign:+.0f}"] = lambda t, x, unit=sign * all_alike: np.tile(unit, (len(x), 1))
    for k, period in enumerate((1.0, 4.0, 16.0)):
        found[f"square {k}"] = lambda t, x, w=np.pi * rate / period: np.tile(
            all_alike * (1.0 if np.sin(w * t) >= 0 else -1.0), (len(x), 1)
        )
    found["greedy V"] = lambda t, x: _towards(gradient(certificate, x) @ model.B, u_sup)
    found["greedy x"] = lambda t, x: _towards((x - certificate.operating_point) @ model.B, u_sup)
    return found


def gradient(certificate: Certificate, x: ndarray) -> ndarray:
    """Return grad V at states (N, n) by central differences."""
    columns = []
    for i in range(x.shape[1]):
        step = np.zeros(x.shape[1])
        step[i] = 1e-5
        columns.append((certificate.V(x + step) - certificate.V(x - step)) / 2e-5)
    return np.stack(columns, axis=1)


def runs(
    model: PersidskiiModel, u_star: ndarray, x0: ndarray, policy: Policy, T: float, steps: int
) -> tuple[ndarray, ndarray]:
    """Return times (K,) and states (K, N, n) of classical Runge-Kutta steps, the input held over each."""
    h, x = T / steps, np.array(x0, float)
    states = [x]
    for k in range(steps):
        u = u_star + policy(k * h, x)
        a = model.rhs(x, u)
        b = model.rhs(x + h / 2 * a, u)
        c = model.rhs(x + h / 2 * b, u)
        x = x + h / 6 * (a + 2 * b + 2 * c + model.rhs(x + h * c, u))
        states.append(x)
    return h * np.arange(steps + 1), np.array(states)


def _towards(direction: ndarray, u_sup: float | ndarray) -> ndarray:
    if np.ndim(u_sup):
        return u_sup * np.where(direction >= 0, 1.0, -1.0)
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    return u_sup * np.divide(direction, size, out=np.ones_like(direction) / np.sqrt(direction.shape[1]), where=size > 0)


def worst_ratio(
    certificate: Certificate, x0: ndarray, u_sup: float | ndarray, T: float, steps: int
) -> tuple[float, float]:
    """Return the largest |x(t) - x*| / bound(t), and bound / worst |x(t) - x*| over the last half of the time.

    The first must stay below 1; the second says how sharp the steady part of the bound is.
    """
    model, point = certificate.model, certificate.content["operating_point"]
    u_star = model.u_ref if point is None else np.array([m * 2.0**e for m, e in point["u"]])
    largest, late, bounds = 0.0, 0.0, None
    for policy in policies(certificate, model, u_sup).values():
        t, x = runs(model, u_star, x0, policy, T, steps)
        size = np.linalg.norm(x - certificate.operating_point, axis=2)
        if bounds is None:
            bounds = np.stack([certificate.bound(start, u_sup, t) for start in x0], axis=1)
        largest = max(largest, float((size / bounds).max()))
        late = max(late, float(size[steps // 2 :].max()))
    steady = certificate.bound(certificate.operating_point, u_sup, [1e3 / (certificate.rate or np.nan)])[0]
    return largest, steady / late if late > 0 else np.nan
