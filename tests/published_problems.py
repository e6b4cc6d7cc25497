"""Published stability problems with their published answers: facts and sources; the models are built here.

Each problem has a figure that `certify` is measured by, the larger the better: a slope or a coupling up to which models
are certified for all states, the size of a certified region, or a rate. `reached` is the figure of today, rounded
down, that tests insist on; `before` is that of the products of single functions in a box, `published` and `truth` are
numbers that others have given, or that simulation gives.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.signal import tf2ss
from scipy.special import gamma

import flows
import persid as ps

BISECTIONS = 9
DIRECTIONS = 4000
ZAMES_FALB = "Carrasco, Turner & Heath, Eur. J. Control 28 (2016)"
PARK = "Park, IEEE Trans. Autom. Control 47 (2002)"
KHALIL = "Khalil, Nonlinear Systems (2002)"
Family = Callable[[float], ps.PersidskiiModel]


@dataclass(frozen=True)
class Slope:
    """How large may k be? Models are certified up to `reached`, and those beyond `truth` are not stable."""

    name: str
    family: Family = field(repr=False)
    reached: float
    published: float | None
    truth: float | None
    source: str
    unit: str = "largest k"
    before: float | None = None

    def largest(self, question: dict[str, Any]) -> float:
        """Return the largest k that is certified, to 1 %, by bisection; 0 where none is."""
        low, high = 0.0, self.truth or 4 * self.reached
        k = 0.99 * high
        for _ in range(BISECTIONS):
            low, high = (k, high) if ps.certify(self.family(k), **question).is_certified else (low, k)
            if high < 1.01 * low + 1e-12:
                break
            k = 0.5 * (low + high)
        return low


@dataclass(frozen=True)
class Question:
    """A model that is asked about, with the figure that is reached at least, and those published, true, and before."""

    name: str
    model: ps.PersidskiiModel = field(repr=False)
    reached: float
    published: float | None
    truth: float | None
    source: str
    unit: str = ""
    before: float | None = None


@dataclass(frozen=True)
class Region(Question):
    """How large a region is certified, with nothing said about its bounds?"""

    unit: str = "area"
    near: tuple[float, ...] | None = None

    def largest(self, question: dict[str, Any]) -> float:
        """Return the volume of the certified region, infinite for all states; 0 where none is."""
        point: Any = "auto" if self.near is None else list(self.near)
        verdict = ps.certify(self.model, domain="auto", operating_point=point, **question)
        if not isinstance(verdict, ps.Certified):
            return 0.0
        return volume(verdict.certificate) if verdict.certificate.scope == "regional" else np.inf


@dataclass(frozen=True)
class Stable(Question):
    """Is it certified for all states, and at which rate? Or refuted, where `reached` is 0 and `truth` is 0."""

    unit: str = "rate, 1/s"

    def largest(self, question: dict[str, Any]) -> float:
        """Return the best proved rate, 0 where none is proved."""
        verdict = ps.certify(self.model, **question)
        return (verdict.best_rate or 0.0) if isinstance(verdict, ps.Certified) else 0.0


Published = Slope | Region | Stable


def volume(certificate: ps.Certificate) -> float:
    """Return the volume of a certified region, along some thousand directions: to a percent in the plane."""
    stated, x, n = certificate.stated, certificate.operating_point, certificate.model.n
    d = np.random.default_rng(0).normal(size=(DIRECTIONS, n))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    low, high = np.zeros(len(d)), np.full(len(d), 1e4)
    for _ in range(60):
        middle = (low + high) / 2
        with np.errstate(over="ignore", invalid="ignore"):  # far out, where exp has no number
            inside = certificate.V(x + d * middle[:, None]) <= float(stated.level)
        for row, lo, hi in stated.strips:
            y = (d * middle[:, None])[:, list(row)] @ np.array([float(r) for r in row.values()])
            inside &= (y >= float(lo)) & (y <= float(hi))
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return float(np.mean(low**n) * np.pi ** (n / 2) / gamma(n / 2 + 1))


def _plane(A0: Any, *terms: Any, B: Any = ((0.0,), (1.0,)), **more: Any) -> ps.PersidskiiModel:
    return ps.PersidskiiModel(A0, list(terms), B, **more)


def _spring(A0: Any, f: str, c: float, **more: Any) -> ps.PersidskiiModel:
    """x1' = x2 and a force c f(x1)."""
    return _plane(A0, (f, [[1.0, 0.0]], [[0.0], [c]]), **more)


def _of_plant(numerator: Any, denominator: Any) -> Family:
    """The plant with the slope-restricted function tanh(k y) fed back: stable as a linear loop for all slopes to k."""
    A, B, C, _ = tf2ss(numerator, denominator)
    return lambda k: ps.PersidskiiModel(A, [("tanh(x)", k * C, -B)], B)


def _network(f: str, n: int, seed: int) -> Family:
    """x' = -x + g W f(x) + u; k is the share of the g at which the linearisation with slopes 1 loses its stability."""
    W = np.random.default_rng(seed).normal(size=(n, n))
    g = 1 / np.linalg.eigvals(W).real.max()
    return lambda k: ps.PersidskiiModel(-np.eye(n), [(f, None, k * g * W)], np.ones((n, 1)))


def _reversed_oscillator(mu: float) -> ps.PersidskiiModel:
    """The oscillator of van der Pol in reversed time, in Lienard's coordinates, which keep areas."""
    return _plane([[-mu, -1.0], [1.0, 0.0]], ("x**3", [[1.0, 0.0]], [[mu / 3], [0.0]]))


def _two_machines_and_a_bus() -> ps.PersidskiiModel:
    angle = [[1.0, 0, 0, 0], [1, 0, -1, 0], [0, 0, 1, 0]]
    force = [[0.0, 0, 0], [-1, -0.5, 0], [0, 0, 0], [0, 0.5, -0.5]]
    A0 = [[0.0, 1, 0, 0], [0, -0.4, 0, 0], [0, 0, 0, 1], [0, 0, 0, -0.5]]
    return ps.PersidskiiModel(A0, [("sin(x)", angle, force)], [[0.0, 0], [1, 0], [0, 0], [0, 1]], [0.0, 0, 0, 0.05])


def _saturated(A0: Float[ndarray, "n n"], B: Float[ndarray, "n m"], K: Float[ndarray, "m n"]) -> ps.PersidskiiModel:
    return ps.PersidskiiModel(A0, [("sat(x)", K, B)], B)


def _chain(masses: int, f: str) -> ps.PersidskiiModel:
    """Equal masses between equal springs with a linear part and f, and dampers of .5, from a wall."""
    R = np.eye(masses) - np.eye(masses, k=-1)
    A0 = np.block([[np.zeros_like(R), np.eye(masses)], [-R.T @ R, -0.5 * R.T @ R]])
    return ps.PersidskiiModel(A0, [(f, np.hstack([R, 0 * R]), np.vstack([0 * R, -R.T]))], np.eye(2 * masses)[:, -1:])


def _product(*factors: Any) -> Any:
    found = np.ones(1)
    for factor in factors:
        found = np.polymul(found, factor)
    return found


_SEVENTH = (
    9.432 * _product([1, 15.6, 147.8], [1, 2.356, 56.21], [1, -0.332, 26.15]),
    _product([1, 2.588, 90.9], [1, 11.79, 113.7], [1, 14.84, 84.05], [1, 8.83]),
)
_HALF_ROOT = float(np.sin(np.pi / 3))

PUBLISHED: tuple[Published, ...] = (
    # slopes of functions in a loop with a linear plant
    Slope("plant (s^2 - .2s - .1)/(s^3 + 2s^2 + s + 1)", _of_plant([1, -0.2, -0.1], [1, 2, 1, 1]), 4.53, 4.58, 4.5894,
          ZAMES_FALB),
    Slope("the same plant, its sign changed", _of_plant([-1, 0.2, 0.1], [1, 2, 1, 1]), 1.08, 1.089, 1.0894,
          ZAMES_FALB),
    Slope("plant s^2/(s^4 + .2s^3 + 6s^2 + .1s + 1)", _of_plant([1, 0, 0], [1, 0.2, 6, 0.1, 1]), 0.78, 0.787, None,
          PARK),
    Slope("plant of seven states", _of_plant(*_SEVENTH), 60.0, 61.0, 87.38, ZAMES_FALB),
    # networks
    *(Slope(f"tanh network, n = {n}, {seed}", _network("tanh(x)", n, seed), reached, None, 1.0,
            "linearisation at 0", "share of the linear limit", before)
      for n, seed, reached, before in ((4, 0, 0.98, None), (4, 1, 0.98, None), (8, 0, 0.95, 0.52), (8, 1, 0.95, 0.78),
                                       (8, 2, 0.98, 0.66))),
    *(Slope(f"relu network, n = 8, {seed}", _network("relu(x)", 8, seed), reached, None, None,
            "drawn at random", "share of the linear limit", before)
      for seed, reached, before in ((0, 0.55, 0.51), (1, 1.7, 0.77), (2, 1.08, 0.65))),
    Slope("Lorenz, sigma = 10, b = 8/3: r", flows.lorenz, 0.98, 1.0, 1.0,
          "Lorenz, J. Atmos. Sci. 20 (1963)", unit="largest r", before=0.0),
    Slope("five modes of a forced flow", flows.five_modes, 6.0, None, 6.124,
          "Boldrighini & Franceschini, Commun. Math. Phys. 64 (1979)", unit="largest R", before=0.0),
    Slope("Rabinovich's waves, dampings 4, 1, 1", flows.rabinovich, 1.97, None, 2.0,
          "Pikovskii, Rabinovich & Trakhtengerts, Sov. Phys. JETP 47 (1978)", unit="largest h", before=0.0),
    # regions
    Region("x' = -x + x^3", ps.PersidskiiModel([[-1.0]], [("x**3", None, [[1.0]])], [[1.0]]), 1.998, 2.0, 2.0, KHALIL,
           unit="length"),
    Region("van der Pol reversed, mu = 1", _reversed_oscillator(1.0), 9.65, None, 13.722, KHALIL, before=9.06),
    Region("van der Pol reversed, mu = 3", _reversed_oscillator(3.0), 12.1, None, 20.491, KHALIL, before=9.22),
    Region("x1' = x2, x2' = -x1 - x2 + x1^3/3", _spring([[0.0, 1.0], [-1.0, -1.0]], "x**3", 1 / 3), 8.7, None, None,
           "Prajna & Jadbabaie, HSCC (2004)"),
    Region("machine at an infinite bus, sin 60 degrees",
           _spring([[0.0, 1.0], [0.0, -0.5]], "sin(x)", -1.0, b=[0.0, _HALF_ROOT]), 1.27, None, None,
           "Genesio et al., IEEE Trans. Autom. Control 30 (1985)", near=(np.pi / 3, 0.0)),
    Region("machine at a bus, two harmonics",
           _spring([[0.0, 1.0], [0.0, -0.279]], "sin(x+0.4136)-0.138*sin(2*x+0.8272)", -1.0, b=[0.0, 0.301]), 10.3,
           None, None, "Chiang et al., IEEE Trans. Autom. Control 33 (1988)"),
    Region("two machines at an infinite bus", _two_machines_and_a_bus(), 105.0, None, None,
           "Anghel et al., IEEE Trans. Circuits Syst. I 60 (2013)", unit="volume", before=20.7),
    Region("saturated feedback, unstable spiral",
           _saturated(np.array([[0.6, -0.8], [0.8, 0.6]]), np.array([[2.0], [4.0]]), np.array([[1.2231, -2.2486]])),
           24.0, None, 44.874, "Hu & Lin, Systems with Actuator Saturation (2001)", before=1.2),
    Region("pendulum, damping .5", _spring([[0.0, 1.0], [0.0, -0.5]], "sin(x)", -1.0), 20.1, None, None, KHALIL),
    Region("whirling pendulum", _spring([[0.0, 1.0], [0.0, -0.2]], "0.405*sin(2*x)-sin(x)", 1.0), 10.2, None, None,
           "Chesi, Automatica 45 (2009)"),
    Region("compressor surge", _plane([[0.0, -1.0], [3.0, -1.0]],
                                      ("-1.5*x**2-0.5*x**3", [[1.0, 0.0]], [[1.0], [0.0]]), B=((1.0,), (0.0,))),
           4.0, None, None, "Krstic et al., Nonlinear and Adaptive Control (1995)"),
    Region("tunnel diode",
           _plane([[0.0, 0.5], [-0.2, -0.3]],
                  ("17.76*x-103.79*x**2+229.62*x**3-226.31*x**4+83.72*x**5", [[1.0, 0.0]], [[-0.5], [0.0]]),
                  B=((0.0,), (0.2,)), b=[0.0, 0.24]),
           0.105, None, None, KHALIL),
    Region("predators and prey that fills its room", flows.prey(), 1.3, None, None,
           "Goh, Amer. Nat. 111 (1977)", before=0.369),
    Region("toggle switch", _plane(-np.eye(2), ("3/(1+x**2)", [[0.0, 1.0], [1.0, 0.0]], np.eye(2)),
                                   B=((1.0,), (0.0,))), 3.2, None, None,
           "Gardner, Cantor & Collins, Nature 403 (2000)"),
    Region("double well", _spring([[0.0, 1.0], [1.0, -0.5]], "x**3", -1.0), 1.57, None, None,
           "Guckenheimer & Holmes (1983)"),
    # stable for all states
    Stable("x' = -x - x^3 + u", ps.PersidskiiModel([[-1.0]], [("x**3", None, [[-1.0]])], [[1.0]]), 0.97, 1.0, 1.0,
           KHALIL),
    Stable("spring that hardens, damping .5", _spring([[0.0, 1.0], [-1.0, -0.5]], "x**3", -1.0), 0.22, None, 0.25,
           "Duffing's equation"),
    Stable("spring that hardens, damping .02", _spring([[0.0, 1.0], [-1.0, -0.02]], "x**3", -1.0), 0.009, None, 0.01,
           "Duffing's equation"),
    Stable("three masses, cubic springs", _chain(3, "x**3"), 0.044, None, None, "a chain from a wall"),
    Stable("five masses, sinh springs", _chain(5, "sinh(x)"), 0.018, None, None, "a chain from a wall"),
    Stable("Euler's rotating body, damped", flows.body((1.0, 2.0, 3.0), np.diag([0.1, 0.2, 0.3])), 0.09, None, 0.1,
           KHALIL, before=0.0),
    Stable("Hopfield's network, two neurons",
           ps.PersidskiiModel(-np.eye(2), [("tanh(x)", None, [[0.5, 2.0], [-2.0, 0.5]])], np.eye(2)), 0.23, None, 0.5,
           "Hopfield, Proc. Natl. Acad. Sci. 81 (1984)"),
    Stable("Goodwin's oscillator below its threshold",
           ps.PersidskiiModel([[-1.0, 0, 0], [1, -1, 0], [0, 1, -1]],
                              [("1/(1+x**2)", [[0.0, 0, 1]], [[1.0], [0], [0]])],
                              [[1.0], [0], [0]]), 0.37, None, None, "Goodwin, Adv. Enzyme Regul. 3 (1965)"),
    Stable("x' = -sat(x) + u", ps.PersidskiiModel([[0.0]], [("sat(x)", None, [[-1.0]])], [[1.0]]), 0.0, None, 0.0,
           "Sontag, IEEE Trans. Autom. Control 34 (1989)"),
    Stable("van der Pol's oscillator", _plane([[1.0, -1.0], [1.0, 0.0]], ("x**3", [[1.0, 0.0]], [[-1 / 3], [0.0]])),
           0.0, None, 0.0, "its equilibrium is unstable"),
    Stable("Chua's circuit",
           ps.PersidskiiModel([[-9.0, 9, 0], [1, -1, 1], [0, -14.286, 0]],
                              [("-5/7*x-3/14*(abs(x+1)-abs(x-1))", [[1.0, 0, 0]], [[-9.0], [0], [0]])],
                              [[1.0], [0], [0]]), 0.0, None, 0.0, "Matsumoto, IEEE Trans. Circuits Syst. 31 (1984)"),
)  # fmt: skip
BY_NAME = {problem.name: problem for problem in PUBLISHED}
