"""Measurements that ail of one thing each, of small systems whose cure is known."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy import ndarray
from scipy.linalg import expm

import persid as ps
from persid.measurements.trajectories import Trajectories

STEP = 0.05  # s
COUNT = 1000


@dataclass(frozen=True)
class Ailment:
    """What ails the data, the kind that a diagnosis gives, and the option that is to be typed; None where none is."""

    make: Callable[[], Trajectories]
    kind: str
    option: tuple[str, str] | None = None
    functions: tuple[str, ...] = ("x",)


def steps(seed: int = 0, every: int = 12) -> ndarray:
    """Return an input of steps of random signs, (N, 1)."""
    return np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], COUNT), every)[:COUNT, None]


def held(A: ndarray, B: ndarray, u: ndarray, h: float = STEP) -> ndarray:
    """Return states of x' = A x + B u at steps h, inputs held."""
    n, m = B.shape
    M = expm(h * np.block([[A, B], [np.zeros((m, n + m))]]))
    x = np.zeros((len(u), n))
    for k in range(len(u) - 1):
        x[k + 1] = M[:n, :n] @ x[k] + M[:n, n:] @ u[k]
    return x


def first_order(u: ndarray, rate: float = 1.0, h: float = STEP) -> ndarray:
    """Return x of x' = rate (u - x)."""
    return held(np.array([[-rate]]), np.array([[rate]]), u, h)


def oscillator(u: ndarray) -> ndarray:
    """Return position and velocity of y'' = -4 y - 0.4 y' + u."""
    return held(np.array([[0.0, 1.0], [-4.0, -0.4]]), np.array([[0.0], [1.0]]), u)


def recorded(x: ndarray, u: ndarray | None = None, h: float = STEP) -> Trajectories:
    """Return one run with states a, b, ... and the input u."""
    x = x if x.ndim == 2 else x[:, None]
    return Trajectories.from_arrays(x, u, dt=h, states=list("abc"[: x.shape[1]]), inputs=None if u is None else ["u"])


def sound() -> Trajectories:
    """x' = u - x, all of it measured."""
    return recorded(first_order(steps()), steps())


def position_only() -> Trajectories:
    """An oscillator without its velocity."""
    return recorded(oscillator(steps())[:, :1], steps())


def third_order() -> Trajectories:
    """One output of three states."""
    A = np.array([[0.0, 1, 0], [0, 0, 1], [-8, -6, -3]])
    return recorded(held(A, np.array([[0.0], [0], [8]]), steps())[:, :1], steps())


def fast() -> Trajectories:
    """A state that settles within a sample, driven by white noise."""
    u = np.random.default_rng(0).normal(0, 1, (COUNT, 1))
    return recorded(first_order(u, 80.0), u)


def dead_time() -> Trajectories:
    """x' = u(t - 2) - x, with u as it was recorded."""
    late = np.concatenate([np.zeros((40, 1)), steps()[:-40]])
    return recorded(first_order(late), steps())


def smooth_input() -> Trajectories:
    """A fast input that varies between coarse samples."""
    fine = np.arange(20 * COUNT) * 0.01
    u = (np.sin(6 * fine) + np.sin(4.1 * fine))[:, None]
    return recorded(first_order(u, 1.0, 0.01)[::20], u[::20], 0.2)


def product() -> Trajectories:
    """Prey and hunters, a' = a - a b, b' = a b - b, by Runge and Kutta's method."""
    x = np.zeros((COUNT, 2))
    x[0] = 1.5, 0.6
    rate = lambda z: np.array([z[0] - z[0] * z[1], z[0] * z[1] - z[1]])  # noqa: E731
    for k in range(COUNT - 1):
        first = rate(x[k])
        second = rate(x[k] + STEP / 2 * first)
        third = rate(x[k] + STEP / 2 * second)
        x[k + 1] = x[k] + STEP / 6 * (first + 2 * second + 2 * third + rate(x[k] + STEP * third))
    return recorded(x)


def codes() -> Trajectories:
    """x' = u - x with -9999 for what is missing."""
    x = first_order(steps())
    x[np.random.default_rng(0).choice(COUNT, 12, replace=False)] = -9999
    return recorded(x, steps())


def saturated() -> Trajectories:
    """An oscillator whose position is cut off."""
    x = oscillator(steps())
    x[:, 0] = np.clip(x[:, 0], -0.12, 0.12)
    return recorded(x, steps())


def coarse() -> Trajectories:
    """An oscillator read on few levels."""
    return recorded(np.round(oscillator(steps()) / 0.6) * 0.6, steps())


def repeated() -> Trajectories:
    """A sensor that is twenty times slower than the file."""
    x = oscillator(steps())
    return recorded(x[np.arange(COUNT) // 20 * 20], steps())


def interpolated() -> Trajectories:
    """Samples on straight lines between measurements, twenty times denser than these."""
    x, k = oscillator(steps(every=20)), np.arange(COUNT)
    return recorded(np.column_stack([np.interp(k, k[::20], column[::20]) for column in x.T]), steps(every=20))


def differenced() -> Trajectories:
    """A noisy position and its difference quotient."""
    y = oscillator(steps())[:, 0] + np.random.default_rng(0).normal(0, 0.05, COUNT)
    return recorded(np.column_stack([y, np.concatenate([[0.0], np.diff(y) / STEP])]), steps())


def feedback() -> Trajectories:
    """An unstable plant whose input is -2 times its state and next to nothing else, with noise on the way."""
    rng, x, u = np.random.default_rng(0), [0.3], []
    for _ in range(COUNT):
        u.append(-2 * x[-1] + 3e-4 * rng.normal())
        x.append(np.exp(STEP) * x[-1] + (np.exp(STEP) - 1) * u[-1] + 0.1 * rng.normal())
    return recorded(np.array(x[:-1]), np.array(u)[:, None])


AILMENTS = {
    "position": Ailment(position_only, "velocity", ("--derivatives", "1")),
    "third order": Ailment(third_order, "past", ("--delays", "3")),
    "hidden": Ailment(third_order, "outputs", ("--outputs", "a")),
    "fast": Ailment(fast, "edmd", ("--method", "edmd")),
    "dead time": Ailment(dead_time, "dead-time", ("--delay", "u=2")),
    "smooth input": Ailment(smooth_input, "hold", ("--hold", "paper")),
    "product": Ailment(product, "product", None, ("x", "x**3")),
    "codes": Ailment(codes, "missing", ("--na", "-9999")),
    "saturated": Ailment(saturated, "saturated"),
    "coarse": Ailment(coarse, "quantised"),
    "repeated": Ailment(repeated, "repeated"),
    "interpolated": Ailment(interpolated, "interpolated"),
    "differenced": Ailment(differenced, "differenced", ("--states", "a")),
    "feedback": Ailment(feedback, "feedback"),
}


@cache
def diagnosed(name: str) -> ps.Diagnosis:
    """Return the diagnosis of an ailment's data, made once for all tests that look at it."""
    ailment = AILMENTS[name]
    data = ailment.make()
    return ps.advise(ps.PersidskiiIdentifier(list(ailment.functions)).fit(data), data)
