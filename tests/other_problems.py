"""A third part of the published stability problems, by a reader of other books: one-sided regions, chemistry, neurons.

As in `further_problems`, with one more kind: gains.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

import persid as ps
from descriptors import equilibrium_network
from further_problems import _NETS, DISCRETE, Ball, Between, _discrete, _steps, polynomial
from published_problems import KHALIL, Question, Region, Slope, Stable, _of_plant, _plane, _product, _spring


@dataclass(frozen=True)
class Gain(Question):
    """How much do inputs change the state? 1 over the gain, 0 where none is proved."""

    unit: str = "1 / gain"

    def largest(self, question: dict[str, Any]) -> float:
        """Return 1 over the gain that is certified, 0 where none is."""
        verdict = ps.certify(self.model, **question)
        gain = verdict.certificate.gain if isinstance(verdict, ps.Certified) else None
        return 1 / gain if gain else 0.0


def _line(a: float, f: str, **more: Any) -> ps.PersidskiiModel:
    """x' = a x + f(x) + u."""
    return ps.PersidskiiModel([[a]], [(f, None, [[1.0]])], [[1.0]], **more)


def _loop(W: Any, f: str, size: float = 1.0) -> Callable[[float], ps.PersidskiiModel]:
    """x' = -x + k size W f(x) + u."""
    W = size * np.array(W, float)
    return lambda k: ps.PersidskiiModel(-np.eye(len(W)), [(f, None, k * W)], np.eye(len(W))[:, :1])


def _two_layers() -> np.ndarray:
    """Two layers of three neurons that excite each other by W and W': the limit is where the norm of W is 1."""
    W = np.random.default_rng(3).normal(size=(3, 3))
    return np.block([[np.zeros((3, 3)), W], [W.T, np.zeros((3, 3))]]) / np.linalg.norm(W, 2)


def _radial(*coefficients: float) -> ps.PersidskiiModel:
    """x' = -y + x g(r^2), y' = x + y g(r^2), g a polynomial: rings where g is 0."""
    monomials: dict[tuple[int, tuple[int, ...]], float] = {}
    for power, c in enumerate(coefficients[1:], 1):
        for k in range(power + 1):
            binomial = c * float(np.prod(range(k + 1, power + 1)) / max(1, np.prod(range(1, power - k + 1))))
            for i in (0, 1):
                key = (i, tuple(sorted((i,) + (0,) * (2 * k) + (1,) * (2 * (power - k)))))
                monomials[key] = monomials.get(key, 0.0) + binomial
    return polynomial([[coefficients[0], -1.0], [1.0, coefficients[0]]], monomials)


def _reactor() -> ps.PersidskiiModel:
    """A stirred tank with x' = -x + D (1 - x) e^y, y' = -(1 + b) y + B D (1 - x) e^y, z = -ln(1 - x) in place of x."""
    D, B, b = 0.072, 8.0, 1.0
    terms = [("exp(x)", [[1.0, 0], [0, 1], [-1, 1]], [[-1.0, D, 0], [0, 0, B * D]])]
    return ps.PersidskiiModel([[0, 0], [0, -1 - b]], terms, [[0.0], [1.0]], [1.0, 0.0])


def _threshold_cycle() -> ps.PersidskiiModel:
    """Three neurons x_i' = -x_i + relu(1 + sum w_ij x_j) on a directed cycle: they take turns for ever."""
    on = np.roll(np.eye(3), 1, 0)
    W = np.where(on > 0, -0.75, -1.5) * (1 - np.eye(3))
    terms = [("relu(x+1)", W, np.eye(3))]
    return ps.PersidskiiModel(-np.eye(3), terms, np.eye(3)[:, :1])


def _rates(rows: Any, excite: float, inhibit: float) -> ps.PersidskiiModel:
    """Wilson and Cowan's two populations with logistic rates of thresholds."""
    f = [f"1/(1+exp({excite}-x))", f"1/(1+exp({inhibit}-x))"]
    return ps.PersidskiiModel(-np.eye(2), [(f, rows, np.eye(2))], np.eye(2)[:, :1])


def _lorenz_96(n: int, F: float) -> ps.PersidskiiModel:
    """x_i' = (x_(i+1) - x_(i-2)) x_(i-1) - x_i + F, on a ring."""
    products: dict[tuple[int, tuple[int, ...]], float] = {}
    for i in range(n):
        for other, sign in ((i + 1, 1.0), (i - 2, -1.0)):
            products[i, tuple(sorted((other % n, (i - 1) % n)))] = sign
    return polynomial(-np.eye(n), products, b=[F] * n)


def _lorenz_84() -> ps.PersidskiiModel:
    """The westerly wind x and two waves, a = 1/4, b = 4, F = 8, G = 1."""
    products = {(0, (1, 1)): -1.0, (0, (2, 2)): -1.0, (1, (0, 1)): 1.0, (1, (0, 2)): -4.0, (2, (0, 1)): 4.0,
                (2, (0, 2)): 1.0}  # fmt: skip
    return polynomial(np.diag([-0.25, -1, -1]), products, b=[2.0, 1.0, 0.0])


def _chua_hidden() -> ps.PersidskiiModel:
    """Chua's circuit whose rest attracts, beside a chaotic attractor that its neighbourhoods do not reach."""
    a, b, c, m0, m1 = 8.4562, 12.0732, 0.0052, -0.1768, -1.1468
    return ps.PersidskiiModel(
        [[-a * (m1 + 1), a, 0], [1, -1, 1], [0, -b, -c]],
        [("sat(x)", [[1.0, 0, 0]], [[-a * (m0 - m1)], [0], [0]])],
        [[1.0], [0], [0]],
    )


def _hidden_oscillation() -> ps.PersidskiiModel:
    """The loop of Leonov and Bragin: stable for all linear gains in (0, 9.9), with a periodic run for steep tanh."""
    A0 = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, -1]])
    return ps.PersidskiiModel(
        A0, [("tanh(x)", [[1.0, 0, -10.1, -0.1]], [[-10.0], [-10.1], [0], [1]])], np.eye(4)[:, :1]
    )


def _regulated(A: Any, B: Any, discrete: bool = False) -> ps.PersidskiiModel:
    """x' (or x+) = A x + B sat(K x), K the linear-quadratic gain of unit weights."""
    A, B = np.array(A, float), np.array(B, float)
    n, m = B.shape
    S = (solve_discrete_are if discrete else solve_continuous_are)(A, B, np.eye(n), np.eye(m))
    K = -np.linalg.solve(np.eye(m) + B.T @ S @ B, B.T @ S @ A) if discrete else -B.T @ S
    return (_steps if discrete else ps.PersidskiiModel)(A, [("sat(x)", K, B)], B)


def _cubic_of_three() -> ps.PersidskiiModel:
    return polynomial(-np.eye(3), {(0, (1, 2, 2)): 1.0, (1, (0, 1)): 1.0})


def _goh() -> ps.PersidskiiModel:
    """Two species that compete, in logarithms of their numbers: attracting all, at no rate far below."""
    return ps.PersidskiiModel(np.zeros((2, 2)), [("exp(x)", None, [[-1.0, -0.5], [-0.5, -1]])], np.eye(2), [1.5, 1.5])


def _volterra() -> ps.PersidskiiModel:
    """Volterra's predators and prey in logarithms: runs are closed."""
    return ps.PersidskiiModel(np.zeros((2, 2)), [("exp(x)", None, [[0.0, -1], [1, 0]])], np.eye(2), [1.0, -1.0])


def _oscillators() -> ps.PersidskiiModel:
    """Angles of two of three coupled oscillators against the third."""
    rows = [[1.0, 0], [0, 1], [1, -1]]
    return ps.PersidskiiModel(np.zeros((2, 2)), [("sin(x)", rows, [[-2.0, -1, -1], [-1, -2, 1]])], np.eye(2),
                              [0.4, 0.1])  # fmt: skip


_FITTS = ([10, 0, 0], _product([1, 0.02, 0.8101], [1, 0.02, 1.2101]))
_FOUR = ([-1, 1.95, -0.9, -0.05], [1, -2.8, 3.5, -2.412, 0.7209])
_FIVE = ([1, -1.5, 0.5, -0.5, 0.5], [4.4, -8.957, 9.893, -5.671, 2.207, -0.5])
_GENESIO = "Genesio, Tartaglia & Vicino, IEEE Trans. Autom. Control 30 (1985)"
_TOPCU = "Topcu, Packard & Seiler, Automatica 44 (2008)"
_ZUBOV = "Zubov, Methods of Lyapunov (1964)"
_HU = "as Hu & Lin, Systems with Actuator Saturation (2001)"
_WILSON = "Wilson & Cowan, Biophys. J. 12 (1972)"
_LEONOV = "Leonov & Kuznetsov, Int. J. Bifurc. Chaos 23 (2013)"

OTHER: tuple[Any, ...] = (
    # slopes of functions in a loop
    Slope("plant 1/((s + 1)(s + 2)(s + 3))", _of_plant([1], _product([1, 1], [1, 2], [1, 3])), 59.0, 60.0, 60.0,
           KHALIL),
    Slope("a delay by Pade, (1 - s/2)/((1 + s/2)(s + 1))", _of_plant([-0.5, 1], _product([0.5, 1], [1, 1])), 2.95,
          None, 3.0, "Astrom & Hagglund, Advanced PID Control (2006)"),
    Slope("O'Shea's plant s^2/(s^2 + s/2 + 1)^2", _of_plant([1, 0, 0], _product([1, 0.5, 1], [1, 0.5, 1])), 1.9,
          None, None, "O'Shea, IEEE Trans. Autom. Control 11 (1966)"),
    Slope("Fitts's plant", _of_plant(*_FITTS), 0.0016, None, None, "Fitts, IEEE Trans. Autom. Control 11 (1966)"),
    Slope("steps: the plant of four states, its sign changed", _discrete(*_FOUR), 0.3, 0.305, 0.3126, DISCRETE),
    Slope("steps: plant of five states", _discrete(*_FIVE), 2.7, 3.824, 7.907, DISCRETE),
    # networks
    Slope("two layers of three tanh", _loop(_two_layers(), "tanh(x)"), 0.98, 1.0, 1.0,
          "Kosko, IEEE Trans. Syst. Man Cybern. 18 (1988)", "share of the linear limit"),
    Slope("cells in a ring, sat", _loop(np.roll(np.eye(6), 1, 0) - np.roll(np.eye(6), -1, 0) + np.eye(6), "sat(x)"),
           0.98, None, 1.0, "Chua & Yang, IEEE Trans. Circuits Syst. 35 (1988)"),
    Slope("relu that inhibit, W + W' < 0", _loop([[-1, 2, 0], [-2, -1, 3], [0, -3, -1]], "relu(x)"), 10.0, None, None,
           "Hahnloser et al., Nature 405 (2000)"),
    Slope("softplus that inhibit, W + W' < 0", _loop([[-1, 2, 0], [-2, -1, 3], [0, -3, -1]], "softplus(x)"), 10.0,
           None, None, "Hahnloser et al., Nature 405 (2000)"),
    Stable("neurons that settle, Wilson and Cowan", _rates([[6.0, -12], [13, -11]], 4.0, 3.7), 0.14, None, None,
           _WILSON),
    Stable("equilibrium network, 4 states, 10 relu", equilibrium_network(4, 10, 2, "relu(x)"), 0.45, None, None, _NETS),
    # regions
    Region("x' = -2x + xy, y' = -y + xy", polynomial(np.diag([-2.0, -1]), {(0, (0, 1)): 1.0, (1, (0, 1)): 1.0}), 5.3,
           None, None, _GENESIO),
    Region("x1' = -50x1 - 16x2 + 13.8x1x2, x2' = 13x1 - 9x2 + 5.5x1x2", polynomial([[-50, -16], [13, -9]], {(0, (0,
           1)): 13.8, (1, (0, 1)): 5.5}), 13.0, None, None, "Hachicho & Tibken, IEEE Conf. Decis. Control (2002)"),
    Region("disc, r' = -r(1 - r^2)", _radial(-1.0, 1.0), 2.3, None, np.pi, _ZUBOV),
    Region("disc within a cycle, r' = -r(1 - r^2)(1 - r^2/4)", _radial(-1.0, 1.25, -0.25), 0.0, None, np.pi,
           "Andronov, Vitt & Khaikin, Theory of Oscillators (1966)"),
    Region("x1' = -.42x1 - 1.05x2 - 2.3x1^2 - .5x1x2 - x1^3, x2' = 1.98x1 + x1x2", polynomial([[-0.42, -1.05], [1.98,
           0]], {(0, (0, 0)): -2.3, (0, (0, 1)): -0.5, (0, (0, 0, 0)): -1.0, (1, (0, 1)): 1.0}), 0.55, None, None,
           _TOPCU),
    Region("x1' = -x1 + x2 x3^2, x2' = -x2 + x1 x2, x3' = -x3", _cubic_of_three(), 8.5, None, None, _TOPCU,
           unit="volume"),
    Region("escape, x'' + x' + x = x^2", _spring([[0.0, 1.0], [-1.0, -1.0]], "x**2", 1.0), 2.0, None, None,
           "Thompson, Proc. R. Soc. Lond. A 421 (1989)"),
    Region("plate that is pulled, x'' + x'/2 + x = .1/(1 - x)^2", _spring([[0.0, 1.0], [-1.0, -0.5]], "0.1/(1-x)**2",
           1.0), 0.41, None, None, "Nathanson et al., IEEE Trans. Electron Devices 14 (1967)"),
    Region("heat that runs away, x' = .2 e^x - x", _line(-1.0, "0.2*exp(x)"), 4.5, None, None,
           "Semenov, Z. Phys. 48 (1928)", unit="length"),
    Region("stirred tank in logarithms", _reactor(), 4.9, None, None, "Uppal, Ray & Poore, Chem. Eng. Sci. 29 (1974)"),
    Region("gene that feeds itself", _line(-0.45, "0.02+x**2/(1+x**2)"), 0.94, None, None,
           "Griffith, J. Theor. Biol. 20 (1968)", unit="length", near=(0.06,)),
    Region("species that compete, in logarithms", _goh(), 2500.0, None, None, "Goh, Amer. Nat. 111 (1977)"),
    Region("excitable neuron at rest", _plane([[1.0, -1.0], [0.08, -0.064]], ("x**3", [[1.0, 0.0]], [[-1 / 3], [0.0]]),
           b=[0.0, 0.056], x_ref=[-1.2, -0.62]), 0.19, None, None, "FitzHugh, Biophys. J. 1 (1961)", near=(-1.1994,
           -0.6243)),
    Region("three coupled oscillators", _oscillators(), 22.0, None, 4 * np.pi**2,
           "Kuramoto, Int. Symp. Math. Probl. Theor. Phys. (1975)"),
    Region("jerk x''' + 2x'' + 3x' + x = x^2", ps.PersidskiiModel([[0, 1.0, 0], [0, 0, 1], [-1, -3, -2]], [("x**2",
           [[1.0, 0, 0]], [[0.0], [0], [1]])], np.eye(3)[:, 2:]), 9.5, None, None,
           "Genesio & Tesi, Automatica 28 (1992)", unit="volume"),
    Region("double integrator, saturated feedback", _plane([[0.0, 1.0], [0, 0]], ("sat(x)", [[1.0, 1.0]], [[0.0],
           [-1.0]])), 2000.0, None, None, "Teel, Syst. Control Lett. 18 (1992)"),
    Region("unstable node, saturated feedback", _regulated([[0, -0.5], [1, 1.5]], [[0.0], [-1]]), 0.94, None, 1.8,
           _HU),
    Region("Chua's circuit with a hidden attractor", _chua_hidden(), 5.4, None, None, _LEONOV, unit="volume"),
    Region("steps: Ricker's salmon in logarithms", _steps([[1.0]], [("exp(x)", None, [[-1.0]])], [[1.0]], b=[1.5],
           x_ref=[np.log(1.5)]), 1.09, None, None, "Ricker, J. Fish. Res. Board Can. 11 (1954)", unit="length"),
    Region("steps: unstable spiral, saturated feedback", _regulated([[1.0, -0.4], [0.4, 1.0]], [[0.0], [1]], True),
           74.0, None, 174.0, _HU),
    # all states
    Stable("x' = -x + sin(x)/2 + u", _line(-1.0, "0.5*sin(x)"), 0.48, None, 0.5, "slopes at 0"),
    Stable("x' = -tanh(x) + u", _line(0.0, "-tanh(x)"), 0.0, None, 0.0, "Sontag, IEEE Trans. Autom. Control 34 (1989)"),
    Stable("x' = -x/(1 + x^2) + u", _line(0.0, "-x/(1+x**2)"), 0.0, None, 0.0,
           "Sontag, IEEE Trans. Autom. Control 34 (1989)"),
    Stable("one eigenvalue 0", ps.PersidskiiModel([[-1.0, 1], [1, -1]], [("x**3", [[1.0, -1]], [[-1.0], [1]])], [[1.0],
           [0]]), 0.0, None, 0.0, "x1 + x2 stays"),
    Stable("one eigenvalue 0, damped by a cube", ps.PersidskiiModel([[-1.0, 1], [1, -1]], [("x**3", [[1.0, 1]],
           [[-1.0], [-1]])], np.zeros((2, 0))), 0.0, None, None, "slower than any rate"),
    Stable("mass with steep friction", _plane([[0.0, 1], [-1, -1]], ("tanh(10*x)", [[0.0, 1]], [[0.0], [-1.0]])),
           0.087, None, None, "Olsson et al., Eur. J. Control 4 (1998)"),
    Stable("genes that repress each other once", ps.PersidskiiModel(-np.eye(3), [("1/(1+abs(x))", np.roll(np.eye(3), 1,
           0), 2 * np.eye(3))], np.eye(3)[:, :1]), 0.2, None, None, "Smith, J. Math. Biol. 25 (1987)"),
    Gain("gain: x' = -2x + tanh(x) + u", _line(-2.0, "tanh(x)"), 0.97, None, 1.0, "2x - tanh(x) = u"),
    Gain("gain: spring and damper 1 against a force", _spring([[0.0, 1.0], [-1.0, -1.0]], "x**3", -1.0), 0.57, None,
           None, "Duffing's equation"),
    # refuted
    Stable("hidden oscillation", _hidden_oscillation(), 0.0, None, None, _LEONOV),
    Stable("neurons that take turns", _threshold_cycle(), 0.0, None, 0.0,
           "Curto, Geneson & Morrison, Neural Comput. 31 (2019)"),
    Stable("neurons that fire in turn, Wilson and Cowan", _rates([[20.8, -15.6], [30, -6]], 3.575, 7.4), 0.0, None,
           0.0, _WILSON),
    Stable("Rayleigh's string", _plane([[0.0, 1], [-1, 1]], ("x**3", [[0.0, 1]], [[0.0], [-1.0]])), 0.0, None, 0.0,
           "Rayleigh, The Theory of Sound (1877)"),
    Stable("Selkov's sugar", polynomial([[-1, 0.08], [0, -0.08]], {(0, (0, 0, 1)): 1.0, (1, (0, 0, 1)): -1.0}, b=[0,
           0.6], x_ref=[0.6, 0.6 / 0.44]), 0.0, None, 0.0, "Selkov, Eur. J. Biochem. 4 (1968)"),
    Stable("Volterra's closed runs", _volterra(), 0.0, None, 0.0, "Volterra, Nature 118 (1926)"),
    Stable("Sprott A, no rest", polynomial([[0, 1, 0], [-1, 0, 0], [0, 0, 0]], {(1, (1, 2)): 1.0, (2, (1, 1)): -1.0},
           b=[0, 0, 1]), 0.0, None, 0.0, "Sprott, Phys. Rev. E 50 (1994)"),
    Stable("steps: Lozi's map", _steps([[0, 1], [0.5, 0]], [("abs(x)", [[1.0, 0]], [[-1.7], [0]])], [[1.0], [0]], b=[1,
           0]), 0.0, None, 0.0, "Lozi, J. Phys. Colloq. 39 (1978)"),
    # balls, and between runs
    Ball("ball: five cells of Lorenz 1996, F = 8", _lorenz_96(5, 8.0), 0.0535, 1 / (8 * 5**0.5), None,
           "Lorenz, Semin. Predictability (1996)"),
    Ball("ball: Lorenz 1984", _lorenz_84(), 0.105, None, None, "Lorenz, Tellus 36 (1984)"),
    Ball("ball: cycle r' = r - r^3", _radial(1.0, -1.0), 0.6, 1.0, 1.0, "Stuart, J. Fluid Mech. 4 (1958)"),
    Ball("ball: chaotic tanh network", ps.PersidskiiModel(-np.eye(4), [("tanh(x)", None,
           3 * np.random.default_rng(7).normal(size=(4, 4)))], np.eye(4)[:, :1]), 0.107, None, None,
           "Sompolinsky, Crisanti & Sommers, Phys. Rev. Lett. 61 (1988)"),
    Ball("ball: Rossler's band", polynomial([[0, -1, -1], [1, 0.2, 0], [0, 0, -5.7]], {(2, (0, 2)): 1.0}, b=[0, 0,
           0.2]), 0.0, None, 0.0, "Rossler, Phys. Lett. A 57 (1976)"),
    Between("x' = -2x + sin(x) + u", _line(-2.0, "sin(x)"), 0.97, None, 1.0, "slopes of -2x + sin(x)"),
    Between("arm with gravity, between runs", _plane([[0.0, 1], [-12, -4]], ("sin(x)", [[1.0, 0]], [[0], [-9.81]])),
           0.25, None, 0.655, "Takegaki & Arimoto, J. Dyn. Syst. Meas. Control 103 (1981)"),
)  # fmt: skip
