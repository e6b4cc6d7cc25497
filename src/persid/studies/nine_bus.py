"""The nine-bus, three-machine grid of the textbooks, by the classical model: power flow, reduction, swings, faults.

    (2 H_i / 60) f_i' = P_i - E_i^2 G_ii - sum_j E_i E_j (B_ij sin d_ij + G_ij cos d_ij) - damping (2 H_i / 60) f_i
    d_ij' = 360 (f_i - f_j)                      d in degrees, f the deviation from 60 Hz in Hz, powers in 100 MVA

E_i stand behind transient reactances, loads are constant admittances, and all between the machines is Kron reduced to
Y = G + jB. States are d21, d31 and the frequencies f21 = f2 - f1, f31 = f3 - f1 and f0, that of the centre of inertia.
Data: P. M. Anderson and A. A. Fouad, Power System Control and Stability, Iowa State University Press 1977, figures
2.18 and 2.19 and tables 2.1 and 2.2; the damping is ours.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from jaxtyping import Complex, Float
from numpy import ndarray
from scipy.integrate import solve_ivp
from scipy.optimize import root

import persid as ps

HERTZ, MVA = 60.0, 100.0
LINES = {  # between buses: series impedance and charging, per unit
    (1, 4): (0.0576j, 0.0), (2, 7): (0.0625j, 0.0), (3, 9): (0.0586j, 0.0),
    (4, 5): (0.01 + 0.085j, 0.176), (4, 6): (0.017 + 0.092j, 0.158), (5, 7): (0.032 + 0.161j, 0.306),
    (6, 9): (0.039 + 0.17j, 0.358), (7, 8): (0.0085 + 0.072j, 0.149), (8, 9): (0.0119 + 0.1008j, 0.209),
}  # fmt: skip
LOADS = {"A": (5, 1.25 + 0.5j), "B": (6, 0.9 + 0.3j), "C": (8, 1.0 + 0.35j)}
VOLTAGES, SCHEDULE = np.array([1.04, 1.025, 1.025]), np.array([1.63, 0.85])  # of buses 1 to 3; of machines 2 and 3
H = np.array([23.64, 6.4, 3.01])  # s, on 100 MVA
TRANSIENT = np.array([0.0608, 0.1198, 0.1813])  # x'd, per unit
BUSES, MACHINES = 9, 3
DAMPING = 0.5  # 1/s: swings have 2 to 3 % of critical damping, as little as operators accept

STATES = ("d21", "d31", "f21", "f31", "f0")
PAIRS = ((1, 0), (2, 0), (1, 2))
TO_PAIRS = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]])  # from d21 and d31 to the angles of the pairs
KINEMATICS = np.array([[360.0, 0.0, 0.0], [0.0, 360.0, 0.0]])  # from f21, f31, f0 to d21', d31'
TO_MACHINES = np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1]]) - np.outer(np.ones(3), [*H[1:], 0.0]) / H.sum()
ACCELERATIONS = HERTZ / 2 * np.array([[-1 / H[0], 1 / H[1], 0], [-1 / H[0], 0, 1 / H[2]], [1 / H.sum()] * 3])
RADIANS = np.pi / 180
OUT_OF_STEP = 180.0  # degrees between two machines


@dataclass(frozen=True)
class Condition:
    """What the network is like: loads as shares of their nominal size, a bus short-circuited, a line switched off."""

    loads: tuple[float, ...] = (1.0, 1.0, 1.0)
    fault: int | None = None
    off: tuple[int, int] | None = None


NORMAL = Condition()


def lines(off: tuple[int, int] | None = None) -> Complex[ndarray, "9 9"]:
    """Return the admittance matrix of lines and transformers, one of them perhaps switched off."""
    Y = np.zeros((BUSES, BUSES), complex)
    for ends, (impedance, charging) in LINES.items():
        if ends != off:
            a, b = ends[0] - 1, ends[1] - 1
            Y[[a, b], [a, b]] += 1 / impedance + 0.5j * charging
            Y[[a, b], [b, a]] -= 1 / impedance
    return Y


@cache
def power_flow() -> Complex[ndarray, " 9"]:
    """Return the bus voltages at which every bus injects what is scheduled; bus 1 balances."""
    demand = np.zeros(BUSES, complex)
    for bus, power in LOADS.values():
        demand[bus - 1] -= power
    demand[1:MACHINES] += SCHEDULE
    Y = lines()

    def voltages(unknown: ndarray) -> ndarray:
        sizes = np.concatenate([VOLTAGES, unknown[BUSES - 1 :]])
        return np.asarray(sizes * np.exp(1j * np.concatenate([[0.0], unknown[: BUSES - 1]])))

    def mismatch(unknown: ndarray) -> ndarray:
        V = voltages(unknown)
        missing = V * (Y @ V).conj() - demand
        return np.concatenate([missing.real[1:], missing.imag[MACHINES:]])

    start = np.concatenate([np.zeros(BUSES - 1), np.ones(BUSES - MACHINES)])
    return voltages(root(mismatch, start, tol=1e-13).x)


@dataclass(frozen=True)
class Grid:
    """The machines of the grid about its power flow; every one is damped in proportion to its inertia, in 1/s."""

    damping: float = DAMPING

    @cached_property
    def E(self) -> Complex[ndarray, " 3"]:
        """The voltages behind the transient reactances."""
        V = power_flow()
        return np.asarray(V[:MACHINES] + 1j * TRANSIENT * (lines() @ V)[:MACHINES])

    @cached_property
    def rest(self) -> Float[ndarray, " 5"]:
        """The state before anything happens."""
        angles = np.angle(self.E) / RADIANS
        return np.array([*(angles[1:] - angles[0]), 0.0, 0.0, 0.0])

    @cached_property
    def mechanical(self) -> Float[ndarray, " 3"]:
        """The powers of the turbines, which stay what they are."""
        return np.asarray((self.E * (self.reduced() @ self.E).conj()).real)

    def reduced(self, condition: Condition = NORMAL) -> Complex[ndarray, "3 3"]:
        """Return the admittances between the machines alone (Kron reduction)."""
        Y, machines = lines(condition.off), 1 / (1j * TRANSIENT)
        for (bus, power), share in zip(LOADS.values(), condition.loads, strict=True):
            Y[bus - 1, bus - 1] += share * power.conjugate() / abs(power_flow()[bus - 1]) ** 2
        Y[range(MACHINES), range(MACHINES)] += machines
        kept = [k for k in range(BUSES) if k + 1 != condition.fault]
        seen = np.linalg.inv(Y[np.ix_(kept, kept)])[:MACHINES, :MACHINES]
        return np.asarray(np.diag(machines) - machines[:, None] * seen * machines)

    def coefficients(self, condition: Condition) -> tuple[ndarray, ndarray, ndarray]:
        """Return what sines and cosines of the pairs' angles add to f21', f31' and f0', and what is added anyway."""
        Y, E = self.reduced(condition), np.abs(self.E)
        sines, cosines = np.zeros((MACHINES, len(PAIRS))), np.zeros((MACHINES, len(PAIRS)))
        for k, (i, j) in enumerate(PAIRS):
            size = E[i] * E[j] * Y[i, j]
            sines[[i, j], k], cosines[[i, j], k] = (-size.imag, size.imag), -size.real
        given = self.mechanical - E**2 * Y.diagonal().real
        return ACCELERATIONS @ sines, ACCELERATIONS @ cosines, ACCELERATIONS @ given

    def model(self, condition: Condition = NORMAL) -> ps.PersidskiiModel:
        """Return the swing equations as a model; its inputs are load steps in MW, to first order.

        A step changes the admittances between the machines. The model takes what that changes at the angles at rest for
        a power that the step adds, and leaves the admittances as they are.
        """
        sines, cosines, given = self.coefficients(condition)
        still, rows = np.zeros((2, 3)), RADIANS * np.hstack([TO_PAIRS, np.zeros((3, 3))])
        A0 = np.block([[np.zeros((2, 2)), KINEMATICS], [np.zeros((3, 2)), -self.damping * np.eye(3)]])
        terms = [("sin(x)", rows, np.vstack([still, sines])), ("cos(x)", rows, np.vstack([still, cosines]))]
        B = np.vstack([still, self.load_effects(condition)])
        return ps.PersidskiiModel(A0, terms, B, [0.0, 0.0, *given], states=STATES, inputs=tuple(LOADS))

    def load_effects(self, condition: Condition = NORMAL) -> Float[ndarray, "3 3"]:
        """Return what 1 MW more of each load adds to f21', f31' and f0' at the angles at rest, in Hz/s."""
        small, columns = 1e-4, []
        for k, (_, power) in enumerate(LOADS.values()):
            low, high = (
                self.rate(replace(condition, loads=tuple(np.array(condition.loads) + by * np.eye(3)[k])))(self.rest)
                for by in (-small, small)
            )
            columns.append((high - low)[2:] / (2 * small * power.real * MVA))
        return np.array(columns).T

    def rate(self, condition: Condition) -> Callable[[ndarray], ndarray]:
        """Return x' as a function of x in one condition of the network."""
        sines, cosines, given = self.coefficients(condition)

        def of(x: ndarray) -> ndarray:
            angles = RADIANS * (TO_PAIRS @ x[:2])
            swing = given + sines @ np.sin(angles) + cosines @ np.cos(angles) - self.damping * x[2:]
            return np.concatenate([KINEMATICS @ x[2:], swing])

        return of

    def simulate(
        self, x0: Float[ndarray, " 5"], t: Float[ndarray, " N"], condition: Condition = NORMAL
    ) -> Float[ndarray, "K 5"]:
        """Return the states at times t (s) from x0 at t[0], up to where two machines have fallen out of step."""

        def apart(_: float, x: ndarray) -> float:
            return OUT_OF_STEP - float(np.abs(TO_PAIRS @ x[:2]).max())

        apart.terminal = True  # type: ignore[attr-defined]
        rate, span = self.rate(condition), (t[0], t[-1])
        found = solve_ivp(lambda _, x: rate(x), span, x0, "LSODA", t, events=apart, rtol=1e-9, atol=1e-9)
        return np.asarray(found.y.T)

    def keeps_step(self, x0: Float[ndarray, " 5"], condition: Condition = NORMAL, seconds: float = 5.0) -> bool:
        """Whether no two machines are out of step at x0 or fall out of it in the seconds that follow."""
        t = np.linspace(0, seconds, 3)
        apart = float(np.abs(TO_PAIRS @ x0[:2]).max()) >= OUT_OF_STEP
        return not apart and len(self.simulate(x0, t, condition)) == len(t)

    def critical_clearing(self, fault: int, after: Condition = NORMAL, longest: float = 1.0) -> float:
        """Return the longest time (s, to 1 ms) after which clearing a short circuit keeps the machines in step."""
        t = np.arange(0, longest + 5e-4, 1e-3)
        x = self.simulate(self.rest, t, Condition(fault=fault))
        low, high = 0, len(x)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.keeps_step(x[middle], after) else (low, middle)
        return float(t[low])
