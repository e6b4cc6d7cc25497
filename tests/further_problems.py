"""A second part of the published stability problems: other authors, discrete time, loops of layers, balls, cycles.

As in `published_problems`, with two more kinds: balls that every run comes into, and rates between any two solutions.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from math import factorial, prod
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.signal import tf2ss

import persid as ps
from descriptors import equilibrium_network
from published_problems import (
    KHALIL,
    ZAMES_FALB,
    Question,
    Region,
    Slope,
    Stable,
    _of_plant,
    _plane,
    _spring,
)

DISCRETE = "Carrasco et al., IEEE Trans. Autom. Control 65 (2020)"


@dataclass(frozen=True)
class Ball(Question):
    """A ball about x_ref that every run comes into: 1 over its radius, 0 where none is proved."""

    unit: str = "1 / radius of a ball"

    def largest(self, question: dict[str, Any]) -> float:
        """Return 1 over the radius that is certified, 0 where none is."""
        verdict = ps.certify(self.model, claim="practical", **question)
        spread = verdict.certificate.spread if isinstance(verdict, ps.Certified) else None
        return 1 / spread if spread else 0.0


@dataclass(frozen=True)
class Between(Question):
    """The rate at which any two solutions come together."""

    unit: str = "rate between runs, 1/s"

    def largest(self, question: dict[str, Any]) -> float:
        """Return the best proved rate, 0 where none is."""
        verdict = ps.certify(self.model, claim="incremental", **question)
        return (verdict.best_rate or 0.0) if isinstance(verdict, ps.Certified) else 0.0


def polynomial(
    A0: Any, monomials: Mapping[tuple[int, tuple[int, ...]], float], B: Any = None, **more: Any
) -> ps.PersidskiiModel:
    """x' = A0 x + sum of monomials: (equation, states multiplied): coefficient, by powers of sums of states."""
    A0 = np.array(A0, float)
    return ps.PersidskiiModel(A0, _terms(len(A0), monomials), np.eye(len(A0)) if B is None else B, **more)


def _terms(n: int, monomials: Mapping[tuple[int, tuple[int, ...]], float]) -> list[tuple[str, ndarray, ndarray]]:
    """Return monomials as powers of sums of states."""
    terms: dict[tuple[int, tuple[float, ...]], ndarray] = {}
    for (i, states), value in monomials.items():
        d = len(states)
        alone = len(set(states)) == 1
        for signs in () if alone else product((1, -1), repeat=d - 1):
            row = sum(sign * np.eye(n)[s] for s, sign in zip(states, (1, *signs), strict=True))
            if row.any():
                terms.setdefault((d, tuple(row)), np.zeros(n))[i] += value * prod(signs) / (2 ** (d - 1) * factorial(d))
        if alone:
            terms.setdefault((d, tuple(np.eye(n)[states[0]])), np.zeros(n))[i] += value
    found = []
    for degree in sorted({d for d, _ in terms}):
        mine = {row: column for (d, row), column in terms.items() if d == degree and column.any()}
        found.append((f"x**{degree}", np.array(list(mine)), np.array(list(mine.values())).T))
    return found


def _discrete(numerator: Any, denominator: Any) -> Callable[[float], ps.PersidskiiModel]:
    """The plant in z with the slope-restricted function tanh(k y) fed back, in steps."""
    A, B, C, _ = tf2ss(numerator, denominator)
    return lambda k: ps.PersidskiiModel(A, [("tanh(x)", k * C, -B)], B, dt=1.0, time="discrete")


def _cycle(n: int, every: bool) -> Callable[[float], ps.PersidskiiModel]:
    """x_1' = -x_1 - k f(x_n), x_i' = -x_i + f(x_(i-1)): f = tanh in every stage, or in the feedback alone."""

    def family(k: float) -> ps.PersidskiiModel:
        back, on = np.zeros((n, n)), np.eye(n, k=-1)
        back[0, -1] = -k
        if every:
            return ps.PersidskiiModel(-np.eye(n), [("tanh(x)", None, on + back)], np.eye(n)[:, :1])
        last = np.eye(n)[-1:]
        return ps.PersidskiiModel(on - np.eye(n), [("tanh(x)", last, back @ last.T)], np.eye(n)[:, :1])

    return family


def _repressilator(a: float) -> ps.PersidskiiModel:
    """x_i' = -x_i + a / (1 + |x_(i-1)|^3), rest loses stability at a = 3 * 2^(1/3)."""
    return ps.PersidskiiModel(
        -np.eye(3), [("1/(1+abs(x)**3)", np.roll(np.eye(3), 1, 0), a * np.eye(3))], np.eye(3)[:, :1]
    )


def _controlled(
    A: ndarray, B: ndarray, K: ndarray, widths: tuple[int, ...], terms: Any = (), seed: int = 0
) -> ps.DescriptorModel:
    """A plant with a tanh network for a controller, whose linearisation is u = K x: layers are algebraic variables."""
    rng, n, (m, _) = np.random.default_rng(seed), len(A), K.shape
    hidden = sum(widths)
    W = [rng.normal(size=(out, into)) / np.sqrt(into) for into, out in zip((n, *widths), widths, strict=False)]
    whole = np.eye(n)
    for each in W:
        whole = each @ whole
    last = K @ np.linalg.pinv(whole)
    A0, R, F = np.zeros((n + hidden, n + hidden)), np.zeros((hidden, n + hidden)), np.zeros((n + hidden, hidden))
    A0[:n, :n], at = A, n
    A0[n:, n:] = -np.eye(hidden)
    for each in W:
        before = slice(0, n) if at == n else slice(at - each.shape[1], at)
        R[at - n : at - n + len(each), before] = each
        at += len(each)
    A0[:n, -widths[-1] :] = B @ last
    F[n:] = np.eye(hidden)
    more = [
        (
            f,
            np.hstack([np.array(r, float), np.zeros((len(r), hidden))]),
            np.vstack([np.array(c, float), np.zeros((hidden, len(r)))]),
        )
        for f, r, c in terms
    ]
    return ps.DescriptorModel(
        A0,
        [("tanh(x)", R, F), *more],
        np.vstack([B, np.zeros((hidden, m))]),
        algebraic=[f"w{k}" for k in range(hidden)],
    )


def _lorenz(r: float) -> ps.PersidskiiModel:
    return polynomial(
        [[-10, 10, 0], [-10, -1, 0], [0, 0, -8 / 3]],
        {(1, (0, 2)): -1.0, (2, (0, 1)): 1.0},
        x_ref=[0, 0, 10 + r],
        b=[0, 0, -(10 + r) * 8 / 3],
    )


def _thomas(b: float) -> ps.PersidskiiModel:
    return ps.PersidskiiModel(-b * np.eye(3), [("sin(x)", np.roll(np.eye(3), 1, 1), np.eye(3))], np.eye(3)[:, :1])


def _joint() -> ps.PersidskiiModel:
    """A link with a flexible joint under state feedback: link angle and speed, motor angle and speed."""
    A0 = np.array([[0.0, 1, 0, 0], [-5, -1, 5, 0], [0, 0, 0, 1], [5, 0, -5, -1]])
    A0[3] += np.array([-2.0, -1, -8, -4])
    return ps.PersidskiiModel(A0, [("sin(x)", [[1.0, 0, 0, 0]], [[0.0], [-0.8], [0], [0]])], np.eye(4)[:, 3:])


_FOUR = ([1, -1.95, 0.9, 0.05], [1, -2.8, 3.5, -2.412, 0.7209])
_MASSES = np.kron(np.eye(3), [[0.0, 1.0], [-1.0, -0.5]]) + np.kron(np.eye(3, k=1) + np.eye(3, k=-1), [[0, 0], [0.2, 0]])
_FORCES = np.kron(np.eye(3), [[0.0], [1.0]])
_ARCAK = "Arcak & Sontag, Automatica 42 (2006)"
_CHESI = "Chesi, Tesi & Vicino, IEEE Conf. Decis. Control (2002)"
_GOMES = "Gomes da Silva & Tarbouriech, IEEE Trans. Autom. Control 50 (2005)"
_NETS = "as Revay, Wang & Manchester, IEEE Trans. Autom. Control 69 (2024)"
_YIN = "as Yin, Seiler & Arcak, IEEE Trans. Autom. Control 67 (2022)"
_PARRILO = "Parrilo, Thesis, Caltech (2000)"


def _network_of_tanh() -> ps.PersidskiiModel:
    """x+ = tanh(.9 Q x) + u, Q orthogonal: an echo state network."""
    Q = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    return _steps(np.zeros((4, 4)), [("tanh(x)", 0.9 * Q, np.eye(4))], np.eye(4)[:, :1])


def _steps(A0: Any, terms: Any, B: Any, **more: Any) -> ps.PersidskiiModel:
    return ps.PersidskiiModel(A0, terms, B, dt=1.0, time="discrete", **more)


def _excitable() -> ps.PersidskiiModel:
    """x' = x - x^3/3 - y + .5, y' = .08 (x + .7 - .8 y): a neuron that fires for ever."""
    return _plane([[1.0, -1.0], [0.08, -0.064]], ("x**3", [[1.0, 0.0]], [[-1 / 3], [0.0]]), b=[0.5, 0.056])


def _power_load() -> ps.PersidskiiModel:
    """i' = 1 - i/2 - v, v' = i - v/5 - .2/v: a filter that feeds a load of constant power."""
    return ps.PersidskiiModel(
        [[-0.5, -1.0], [1.0, -0.2]],
        [("1/(x+0.7)", [[0.0, 1.0]], [[0.0], [-0.2]])],
        [[1.0], [0.0]],
        [0.05, 0.36],
        x_ref=[0.5, 0.7],
    )


FURTHER: tuple[Any, ...] = (
    # slopes of functions in a loop, in continuous time and in steps
    Slope("plant -s^2/(s^4 + .2s^3 + 6s^2 + .1s + 1)", _of_plant([-1, 0, 0], [1, 0.2, 6, 0.1, 1]), 0.686, None, 3.5,
          ZAMES_FALB),
    Slope("plant s^2/(s^4 + 5.001s^3 + 7.005s^2 + 5.006s + 6)", _of_plant([1, 0, 0], [1, 5.001, 7.005, 5.006, 6]), 25.2,
          None, None, ZAMES_FALB),
    Slope("steps: .1z/(z^2 - 1.8z + .81)", _discrete([0.1, 0], [1, -1.8, 0.81]), 12.7, None, 36.1, DISCRETE,
          before=0.698),
    Slope("steps: plant of four states", _discrete(*_FOUR), 0.74, None, 2.746, DISCRETE, before=0.191),
    Slope("steps: (-.5z + .1)/(z^3 - .9z^2 + .79z + .089)", _discrete([-0.5, 0.1], [1, -0.9, 0.79, 0.089]), 2.41,
          None, 2.447, DISCRETE, before=1.02),
    Slope("steps: (2z + .92)/(z^2 - .5z)", _discrete([2, 0.92], [1, -0.5, 0]), 0.895, None, 1.087, DISCRETE,
          before=0.647),
    Slope("cycle of three, tanh in the feedback", _cycle(3, False), 7.76, 8.0, 8.0, _ARCAK),
    Slope("cycle of three, tanh in all stages", _cycle(3, True), 7.76, 8.0, 8.0, _ARCAK),
    Slope("cycle of five, tanh in all stages", _cycle(5, True), 2.79, 2.885, 2.885, _ARCAK),
    Slope("repressilator, Hill exponent 3", _repressilator, 1.7, None, 3.779, "Elowitz & Leibler, Nature 403 (2000)",
          unit="largest a"),
    # regions
    Region("x1' = -x1 + 2 x1^2 x2, x2' = -x2", polynomial(-np.eye(2), {(0, (0, 0, 1)): 2.0}), 5.2, None, None,
           "Hahn, Stability of Motion (1967)"),
    Region("x1' = -x1 + x2, x2' = .1x1 - 2x2 - x1^2 - .1x1^3",
           _plane([[-1.0, 1], [0.1, -2]], ("-x**2-0.1*x**3", [[1.0, 0]], [[0.0], [1.0]])), 31.3, None, None,
           "Chesi, Domain of Attraction (2011)"),
    Region("x'' + 3x' + 2x = x^2 + x x' - x'^2", polynomial([[0, 1], [-2, -3]], {
           (1, (0, 0)): 1.0, (1, (0, 1)): 1.0, (1, (1, 1)): -1.0}), 9.0, None, None, _CHESI),
    Region("Davison & Kurak's cubic of three states", polynomial([[0, -1, 0], [0, 0, -1], [-0.915, 1, -1]],
           {(2, (0, 0, 1)): -0.915}), 0.15, None, None, "Davison & Kurak, Automatica 7 (1971)", unit="volume"),
    Region("x3' = -3x1 - 3x2 - 2x3 + x1^3 + x2^3 + x3^3",
           ps.PersidskiiModel([[0.0, 1, 0], [0, 0, 1], [-3, -3, -2]],
                              [("x**3", np.eye(3), [[0.0] * 3, [0.0] * 3, [1.0] * 3])], np.eye(3)), 0.75, None, None,
           _CHESI, unit="volume"),
    Region("inverted pendulum, saturated feedback", _plane([[0.0, 1], [1, 0]], ("sat(x)", [[2.6, 1.4]],
           [[0.0], [-5.0]])), 95.8, None, None, _GOMES),
    Region("PI loop with saturation", _plane([[0.1, 0], [-0.2, 0]], ("sat(x)", [[-2.0, 1.0]], [[1.0], [0.0]])), 353.0,
           None, None, _GOMES),
    Region("steps: saturated feedback", _steps([[0.8, 0.5], [-0.4, 1.2]], [("sat(x)", [[0.2888, -0.8350]],
           [[0.0], [1.0]])], [[0.0], [1.0]]), 117.0, None, None, "as Hu, Lin & Chen, Syst. Control Lett. 45 (2002)",
           before=0.0),
    Region("steps: x+ = x/2 + x^3", _steps([[0.5]], [("x**3", None, [[1.0]])], [[1.0]]), 1.39, None, 2**0.5,
           "rests at x^2 = 1/2", unit="length", before=0.0),
    Region("filter with a load of constant power", _power_load(), 0.504, None, None,
           "Middlebrook, IEEE Ind. Appl. Soc. (1976)"),
    Region("two species that compete", polynomial([[-1, -0.5], [-0.5, -1]], {(0, (0, 0)): -1.0, (0, (0, 1)): -0.5,
           (1, (0, 1)): -0.5, (1, (1, 1)): -1.0}, x_ref=[1, 1]), 1.9, None, None, "Goh, Amer. Nat. 111 (1977)"),
    Region("epidemic with births", polynomial([[-0.4, -0.5], [0.2, 0.0]], {(0, (0, 1)): -1.0, (1, (0, 1)): 1.0},
           x_ref=[0.5, 0.2]), 0.102, None, None, "Korobeinikov, Math. Med. Biol. 21 (2004)"),
    Region("pendulum under two layers of four tanh", _controlled(np.array([[0.0, 1], [0, -0.5]]),
           np.array([[0.0], [1]]), np.array([[-4.0, -2.0]]), (4, 4), [("sin(x)", [[1.0, 0.0]], [[0.0], [1.0]])]), 9.0,
           None, None, _YIN, before=0.0),
    # all states
    Stable("x' = -x - 2y^2, y' = -y - xy - 2y^3", polynomial(-np.eye(2), {(0, (1, 1)): -2.0, (1, (0, 1)): -1.0,
           (1, (1, 1, 1)): -2.0}, np.zeros((2, 0))), 0.0, None, 1.0, _PARRILO),
    Stable("x' = -x + xy, y' = -y", polynomial(-np.eye(2), {(0, (0, 1)): 1.0}, np.zeros((2, 0))), 0.0, None, 1.0,
           "Ahmadi, Krstic & Parrilo, IEEE Conf. Decis. Control (2011)"),
    Stable("three states, -x^3 - xz^2 and others", ps.PersidskiiModel(np.diag([0.0, -1, -1]), [
           *_terms(3, {(0, (0, 0, 0)): -1.0, (0, (0, 2, 2)): -1.0, (1, (0, 0, 1)): -1.0, (2, (0, 0, 2)): 3.0}),
           ("-3*x/(x**2+1)", [[0.0, 0, 1]], [[0.0], [0], [1]])], np.zeros((3, 0))), 0.0, None, None,
           "Papachristodoulou & Prajna, IEEE Conf. Decis. Control (2002)"),
    Stable("arm with gravity under PD control", _plane([[0.0, 1], [-12, -4]], ("sin(x)", [[1.0, 0]], [[0], [-9.81]])),
           1.21, None, 2.0, "Takegaki & Arimoto, J. Dyn. Syst. Meas. Control 103 (1981)"),
    Stable("link with a flexible joint", _joint(), 0.958, None, None, "Spong, J. Dyn. Syst. Meas. Control 109 (1987)"),
    Stable("mass with a cubic damper", _plane([[0.0, 1], [-1, 0]], ("x**3", [[0.0, 1]], [[0.0], [-1.0]])), 0.0, None,
           None, KHALIL),
    Stable("equilibrium network, 6 states, 20 tanh", equilibrium_network(6, 20, 0), 0.3, None, None, _NETS,
           before=0.0),
    Stable("equilibrium network, 10 states, 20 tanh", equilibrium_network(10, 20, 1), 0.2, None, None, _NETS,
           before=0.0),
    Stable("three masses under two layers of six tanh", _controlled(_MASSES, _FORCES, -0.3 * np.kron(np.eye(3), [[1,
           1]]),
           (6, 6)), 0.00743, None, None, _YIN),
    # refuted
    Stable("Lorenz, r = 28", polynomial([[-10, 10, 0], [28, -1, 0], [0, 0, -8 / 3]], {(1, (0, 2)): -1.0,
           (2, (0, 1)): 1.0}), 0.0, None, 0.0, "Lorenz, J. Atmos. Sci. 20 (1963)"),
    Stable("Rossler's band", polynomial([[0, -1, -1], [1, 0.2, 0], [0, 0, -5.7]], {(2, (0, 2)): 1.0}, b=[0, 0, 0.2]),
           0.0, None, 0.0, "Rossler, Phys. Lett. A 57 (1976)"),
    Stable("Brusselator, A = 1, B = 3", polynomial([[-4, 0], [3, 0]], {(0, (0, 0, 1)): 1.0, (1, (0, 0, 1)): -1.0},
           b=[1, 0]), 0.0, None, 0.0, "Prigogine & Lefever, J. Chem. Phys. 48 (1968)"),
    Stable("steps: Henon's map", _steps([[0, 1], [0.3, 0]], [("x**2", [[1.0, 0]], [[-1.4], [0]])], [[1.0], [0]],
           b=[1, 0]), 0.0, None, 0.0, "Henon, Commun. Math. Phys. 50 (1976)"),
    Stable("steps: logistic map, 3.2", _steps([[3.2]], [("x**2", None, [[-3.2]])], [[1.0]]), 0.0, None, 0.0,
           "May, Nature 261 (1976)"),
    Stable("FitzHugh's neuron that fires", _excitable(), 0.0, None, 0.0, "FitzHugh, Biophys. J. 1 (1961)"),
    # balls
    Ball("ball: Lorenz, r = 28", _lorenz(28), 0.0214, 1 / 39.25, None,
         "Leonov, Bunin & Koksch, Z. Angew. Math. Mech. 67 (1987)"),
    Ball("ball: cyclic sines, b = .2", _thomas(0.2), 0.1, 0.2 / 3**0.5, None, "Thomas, Int. J. Bifurc. Chaos 9 (1999)"),
    Ball("ball: double well", _spring([[0.0, 1.0], [1.0, -0.5]], "x**3", -1.0), 0.578, None, 1.0,
         "Guckenheimer & Holmes (1983)"),
    Ball("ball: FitzHugh's neuron", _excitable(), 0.0362, None, None, "FitzHugh, Biophys. J. 1 (1961)"),
    Ball("ball: van der Pol's oscillator", _plane([[1.0, -1.0], [1.0, 0.0]], ("x**3", [[1.0, 0.0]], [[-1 / 3],
           [0.0]])), 0.0,
         None, None, KHALIL),
    # between any two solutions
    Between("loop with a saturating integral", ps.PersidskiiModel([[-2.0, 1], [-1, -1]], [("tanh(x)", [[1.0, 0.5]],
            [[-1.0], [-0.5]])], [[1.0], [0]]), 0.948, None, 1.5, "Pavlov et al., Uniform Output Regulation (2005)"),
    Between("steps: echo state network", _network_of_tanh(), 0.0998, None, 0.1054, "Jaeger (2001): -ln .9"),
)  # fmt: skip
