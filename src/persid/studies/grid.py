"""A grid of classical machines: from tables of buses, lines and machines to power flow, reduction, swings and faults.

    (2 H_i / 60) f_i' = P_i - E_i^2 G_ii - sum_j E_i E_j (B_ij sin d_ij + G_ij cos d_ij) - damping (2 H_i / 60) f_i
    d_ij' = 360 (f_i - f_j)                      d in degrees, f the deviation from 60 Hz in Hz, powers in 100 MVA

E_i stand behind transient reactances, loads are constant admittances, and all between the machines is Kron reduced to
Y = G + jB. States of K machines are the angles d21, ..., dK1 to the first one, the frequencies f21, ..., fK1 beyond
that of the first one, and f0, that of the centre of inertia.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from numpy import ndarray
from scipy.integrate import solve_ivp
from scipy.optimize import root

import persid as ps

HERTZ, MVA = 60.0, 100.0
DAMPING = 0.5  # 1/s: swings have 2 to 3 % of critical damping, as little as operators accept
DEGREES = 360.0  # a cycle
RADIANS = np.pi / 180
OUT_OF_STEP = 180.0  # degrees between two machines


@dataclass(frozen=True)
class Line:
    """A line or transformer between two buses, per unit; the tap, if there is one, is at the first of them."""

    ends: tuple[int, int]
    impedance: complex
    charging: float = 0.0
    ratio: float = 1.0


@dataclass(frozen=True)
class Machine:
    """A machine at a bus: the voltage it holds there and what it is scheduled to give, per unit; None: it balances.

    Its inertia constant H in s and its transient reactance are on 100 MVA.
    """

    bus: int
    voltage: float
    scheduled: float | None
    H: float
    transient: float


@dataclass(frozen=True, eq=False)
class Case:
    """A grid as books print it: buses are numbered from 1; loads by name, bus and power per unit."""

    buses: int
    lines: Sequence[Line]
    machines: Sequence[Machine]
    loads: Mapping[str, tuple[int, complex]]

    @cached_property
    def nominal(self) -> Float[ndarray, " L"]:
        """What each load takes, in MW."""
        return np.array([power.real * MVA for _, power in self.loads.values()])

    @cached_property
    def H(self) -> Float[ndarray, " K"]:
        """The inertia constants of the machines, in s."""
        return np.array([machine.H for machine in self.machines])

    @cached_property
    def ports(self) -> list[int]:
        """The buses of the machines, counted from 0."""
        return [machine.bus - 1 for machine in self.machines]

    @cached_property
    def drawn(self) -> Complex[ndarray, " N"]:
        """What all loads together draw from each bus."""
        drawn = np.zeros(self.buses, complex)
        for bus, power in self.loads.values():
            drawn[bus - 1] += power
        return drawn

    def admittances(self, off: tuple[int, int] | None = None) -> Complex[ndarray, "N N"]:
        """Return the admittance matrix of lines and transformers, one of them perhaps switched off."""
        Y = np.zeros((self.buses, self.buses), complex)
        for line in self.lines:
            if line.ends != off:
                a, b, series = line.ends[0] - 1, line.ends[1] - 1, 1 / line.impedance
                own = series + 0.5j * line.charging
                Y[[a, b], [a, b]] += own / line.ratio**2, own
                Y[[a, b], [b, a]] -= series / line.ratio
        return Y

    @cached_property
    def voltages(self) -> Complex[ndarray, " N"]:
        """The power flow: bus voltages at which every bus injects what is scheduled; the balancing one is at angle 0.

        Unknown are the angles of all buses but that one, and the sizes at all buses without a machine.
        """
        demand, sizes = -self.drawn, np.ones(self.buses)
        for machine in self.machines:
            demand[machine.bus - 1] += machine.scheduled or 0.0
            sizes[machine.bus - 1] = machine.voltage
        slack = next(machine.bus - 1 for machine in self.machines if machine.scheduled is None)
        turned = [bus for bus in range(self.buses) if bus != slack]
        free = [bus for bus in range(self.buses) if bus not in self.ports]
        Y, angles = self.admittances(), np.zeros(self.buses)

        def voltages(unknown: ndarray) -> ndarray:
            angles[turned], sizes[free] = unknown[: len(turned)], unknown[len(turned) :]
            return np.asarray(sizes * np.exp(1j * angles))

        def mismatch(unknown: ndarray) -> ndarray:
            V = voltages(unknown)
            missing = V * (Y @ V).conj() - demand
            return np.concatenate([missing.real[turned], missing.imag[free]])

        start = np.concatenate([np.zeros(len(turned)), np.ones(len(free))])
        return voltages(root(mismatch, start, tol=1e-13).x)

    @cached_property
    def generated(self) -> Complex[ndarray, " K"]:
        """What each machine gives at the power flow, per unit."""
        V = self.voltages
        return np.asarray((V * (self.admittances() @ V).conj() + self.drawn)[self.ports])


@dataclass(frozen=True)
class Condition:
    """What the network is like: loads as shares of their nominal size, a bus short-circuited, a line switched off."""

    loads: tuple[float, ...] | None = None  # None: all are nominal
    fault: int | None = None
    off: tuple[int, int] | None = None


NORMAL = Condition()


@dataclass(frozen=True)
class Grid:
    """The machines of a case about its power flow; every one is damped in proportion to its inertia, in 1/s."""

    case: Case
    damping: float = DAMPING

    @property
    def machines(self) -> int:
        """How many machines there are."""
        return len(self.case.machines)

    @property
    def between(self) -> int:
        """How many states there are between machines: all but the frequency of the whole grid."""
        return 2 * self.machines - 2

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """The pairs of machines, counted from 0: those with the first one, then all others."""
        others = range(1, self.machines)
        return (*((k, 0) for k in others), *((i, j) for i in others for j in others if i < j))

    @cached_property
    def angles(self) -> tuple[str, ...]:
        """The names of the angles of all pairs."""
        mark = "" if self.machines < 10 else "_"
        return tuple(f"d{i + 1}{mark}{j + 1}" for i, j in self.pairs)

    @cached_property
    def states(self) -> tuple[str, ...]:
        """The names of the states."""
        few = self.angles[: self.machines - 1]
        return (*few, *(f"f{name[1:]}" for name in few), "f0")

    @cached_property
    def to_pairs(self) -> Float[ndarray, "p k"]:
        """From the angles to the first machine to those of all pairs."""
        to_first = np.eye(self.machines)[:, 1:]
        return np.array([to_first[i] - to_first[j] for i, j in self.pairs])

    @cached_property
    def kinematics(self) -> Float[ndarray, "k K"]:
        """From the frequencies, f0 last, to the rates of the angles."""
        return np.asarray(DEGREES * np.eye(self.machines)[:-1])

    @cached_property
    def to_machines(self) -> Float[ndarray, "K K"]:
        """From the frequencies, f0 last, to those of the machines: f1 = f0 - sum of H_k f_k1 over the sum of H."""
        H, above = self.case.H, np.hstack([np.eye(self.machines)[:, 1:], np.ones((self.machines, 1))])
        return np.asarray(above - np.outer(np.ones(self.machines), [*H[1:], 0.0]) / H.sum())

    @cached_property
    def accelerations(self) -> Float[ndarray, "K K"]:
        """From powers at the machines to the rates of the frequencies."""
        H = self.case.H
        others = np.hstack([np.full((self.machines - 1, 1), -1 / H[0]), np.diag(1 / H[1:])])
        return np.asarray(HERTZ / 2 * np.vstack([others, np.full(self.machines, 1 / H.sum())]))

    @cached_property
    def transient(self) -> Complex[ndarray, " K"]:
        """The admittances between the machines' internal voltages and their buses."""
        return np.array([1 / (1j * machine.transient) for machine in self.case.machines])

    @cached_property
    def E(self) -> Complex[ndarray, " K"]:
        """The voltages behind the transient reactances."""
        V = self.case.voltages[self.case.ports]
        return np.asarray(V + (self.case.generated / V).conj() / self.transient)

    @cached_property
    def rest(self) -> Float[ndarray, " n"]:
        """The state before anything happens."""
        angles = np.angle(self.E) / RADIANS
        return np.concatenate([angles[1:] - angles[0], np.zeros(self.machines)])

    @cached_property
    def mechanical(self) -> Float[ndarray, " K"]:
        """The powers of the turbines, which stay what they are."""
        return np.asarray((self.E * (self.reduced() @ self.E).conj()).real)

    def reduced(self, condition: Condition = NORMAL) -> Complex[ndarray, "K K"]:
        """Return the admittances between the machines alone (Kron reduction)."""
        case, machines = self.case, range(self.machines)
        Y, to_buses = case.admittances(condition.off), np.zeros((case.buses, self.machines), complex)
        shares = condition.loads or (1.0,) * len(case.loads)
        for (bus, power), share in zip(case.loads.values(), shares, strict=True):
            Y[bus - 1, bus - 1] += share * power.conjugate() / abs(case.voltages[bus - 1]) ** 2
        Y[case.ports, case.ports] += self.transient
        to_buses[case.ports, machines] = self.transient
        kept = [k for k in range(case.buses) if k + 1 != condition.fault]
        seen = np.linalg.solve(Y[np.ix_(kept, kept)], to_buses[kept])
        return np.asarray(np.diag(self.transient) - to_buses[kept].T @ seen)

    def coefficients(self, condition: Condition) -> tuple[ndarray, ndarray, ndarray]:
        """Return what sines and cosines of the pairs' angles add to the frequencies' rates, and the rest of them."""
        Y, E = self.reduced(condition), np.abs(self.E)
        sines, cosines = np.zeros((self.machines, len(self.pairs))), np.zeros((self.machines, len(self.pairs)))
        for k, (i, j) in enumerate(self.pairs):
            size = E[i] * E[j] * Y[i, j]
            sines[[i, j], k], cosines[[i, j], k] = (-size.imag, size.imag), -size.real
        given = self.mechanical - E**2 * Y.diagonal().real
        return self.accelerations @ sines, self.accelerations @ cosines, self.accelerations @ given

    def model(self, condition: Condition = NORMAL) -> ps.PersidskiiModel:
        """Return the swing equations as a model; its inputs are load steps in MW, to first order.

        A step changes the admittances between the machines. The model takes what that changes at the angles at rest for
        a power that the step adds, and leaves the admittances as they are.
        """
        sines, cosines, given = self.coefficients(condition)
        K, k = self.machines, self.machines - 1
        rows = RADIANS * np.hstack([self.to_pairs, np.zeros((len(self.pairs), K))])
        A0 = np.block([[np.zeros((k, k)), self.kinematics], [np.zeros((K, k)), -self.damping * np.eye(K)]])
        terms = [("sin(x)", rows, self.below(sines)), ("cos(x)", rows, self.below(cosines))]
        B, b = self.below(self.load_effects(condition)), np.concatenate([np.zeros(k), given])
        return ps.PersidskiiModel(A0, terms, B, b, states=self.states, inputs=tuple(self.case.loads))

    def below(self, rows: Float[ndarray, "K c"]) -> Float[ndarray, "n c"]:
        """Return rows of the frequencies below those of the angles, which are zero."""
        return np.vstack([np.zeros((self.machines - 1, rows.shape[1])), rows])

    def load_effects(self, condition: Condition = NORMAL) -> Float[ndarray, "K L"]:
        """Return what 1 MW more of each load adds to the rates of the frequencies at the angles at rest, in Hz/s."""
        small, columns, nominal = 1e-4, [], self.case.nominal
        now = np.array(condition.loads or np.ones(len(nominal)))
        for k, power in enumerate(nominal):
            low, high = (
                self.rate(replace(condition, loads=tuple(now + by * np.eye(len(now))[k])))(self.rest)
                for by in (-small, small)
            )
            columns.append((high - low)[self.machines - 1 :] / (2 * small * power))
        return np.array(columns).T

    def rate(self, condition: Condition) -> Callable[[ndarray], ndarray]:
        """Return x' as a function of x in one condition of the network."""
        sines, cosines, given = self.coefficients(condition)
        k, to_pairs = self.machines - 1, RADIANS * self.to_pairs

        def of(x: ndarray) -> ndarray:
            angles = to_pairs @ x[:k]
            swing = given + sines @ np.sin(angles) + cosines @ np.cos(angles) - self.damping * x[k:]
            return np.concatenate([self.kinematics @ x[k:], swing])

        return of

    def apart(self, x: Float[ndarray, "N n"]) -> Float[ndarray, " N"]:
        """Return the largest angle between two machines, in degrees."""
        return np.asarray(np.abs(x[:, : self.machines - 1] @ self.to_pairs.T).max(axis=1))

    def simulate(
        self, x0: Float[ndarray, " n"], t: Float[ndarray, " N"], condition: Condition = NORMAL
    ) -> Float[ndarray, "k n"]:
        """Return the states at times t (s) from x0 at t[0], up to where two machines have fallen out of step."""

        def left(_: float, x: ndarray) -> float:
            return OUT_OF_STEP - float(self.apart(x[None])[0])

        left.terminal = True  # type: ignore[attr-defined]
        rate, span = self.rate(condition), (t[0], t[-1])
        found = solve_ivp(lambda _, x: rate(x), span, x0, "LSODA", t, events=left, rtol=1e-9, atol=1e-9)
        return np.asarray(found.y.T)

    def keeps_step(self, x0: Float[ndarray, " n"], condition: Condition = NORMAL, seconds: float = 5.0) -> bool:
        """Whether no two machines are out of step at x0 or fall out of it in the seconds that follow."""
        t = np.linspace(0, seconds, 3)
        return bool(self.apart(x0[None])[0] < OUT_OF_STEP) and len(self.simulate(x0, t, condition)) == len(t)

    def critical_clearing(self, fault: int, after: Condition = NORMAL, longest: float = 1.0) -> float:
        """Return the longest time (s, to 1 ms) after which clearing a short circuit keeps the machines in step."""
        t = np.arange(0, longest + 5e-4, 1e-3)
        x = self.simulate(self.rest, t, Condition(fault=fault))
        low, high = 0, len(x)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.keeps_step(x[middle], after) else (low, middle)
        return float(t[low])
