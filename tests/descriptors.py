"""Models with algebraic variables whose truth is known."""

import numpy as np

import persid as ps


def loop(gain: float, f: str = "tanh(x)") -> ps.DescriptorModel:
    """x' = -x - w + u with w = f(x + gain w): one solution w for every x if and only if gain < 1, for |f'| <= 1."""
    term = (f, [[1.0, gain]], [[0.0], [1.0]])
    return ps.DescriptorModel([[-1.0, -1.0], [0.0, -1.0]], [term], [[1.0], [0.0]], algebraic=["w"])


def diode(leak: float = 0.5) -> ps.DescriptorModel:
    """A capacitor behind a resistor, with a diode and a leak to ground: the node between them has no capacitor."""
    A0 = [[-1.0, 1.0], [1.0, -1.0 - leak]]
    term = ("expm1(x)", [[0.0, 1.0]], [[0.0], [-0.1]])
    names = {"states": ["v"], "algebraic": ["node"], "inputs": ["i"]}
    return ps.DescriptorModel(A0, [term], [[1.0], [0.0]], **names)


def circuit() -> ps.DescriptorModel:
    """The same circuit with the diode's current as a variable of its own: every equation says what one variable is."""
    A0 = [[-1.0, 1.0, 0.0], [2 / 3, -1.0, -2 / 3], [0.0, 0.0, -1.0]]
    term = ("expm1(x)", [[0.0, 1.0, 0.0]], [[0.0], [0.0], [0.1]])
    names = {"states": ["v"], "algebraic": ["node", "diode"], "inputs": ["i"]}
    return ps.DescriptorModel(A0, [term], [[1.0], [0.0], [0.0]], **names)


def network(n: int, k: int, seed: int, size: float = 0.9) -> ps.DescriptorModel:
    """x' = -x + A12 w + u, w = tanh(D w + C x), symmetric gains: |D| = size < 1 makes it solvable, 2-norms stable."""
    rng = np.random.default_rng(seed)

    def norm(shape: tuple[int, int], bound: float) -> np.ndarray:
        M = rng.normal(size=shape)
        return bound * M / np.linalg.norm(M, 2)

    A0 = np.block([[-np.eye(n), norm((n, k), 0.7)], [np.zeros((k, n)), -np.eye(k)]])
    R, A = np.hstack([norm((k, n), 1 - size), norm((k, k), size)]), np.vstack([np.zeros((n, k)), np.eye(k)])
    B = np.vstack([np.eye(n), np.zeros((k, n))])
    return ps.DescriptorModel(A0, [("tanh(x)", R, A)], B, algebraic=k)


def drawn(seed: int) -> ps.DescriptorModel:
    """A random model that may be anything: unstable, with several solutions, or neither."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 3)), int(rng.integers(1, 3))
    A0 = rng.normal(size=(n + k, n + k)) - np.diag([2.0] * n + [1.5] * k)
    f, count = str(rng.choice(["tanh(x)", "sat(x)", "x**3", "expm1(x)"])), int(rng.integers(1, 3))
    R, A = np.round(4 * rng.normal(size=(count, n + k))) / 4, 0.5 * rng.normal(size=(n + k, count))
    B = np.vstack([np.eye(n), np.zeros((k, n))])
    return ps.DescriptorModel(A0, [(f, R, A)], B, algebraic=k)


def fold() -> ps.DescriptorModel:
    """x' = -x + w + u, 0 = 0.3 x - w + w^3: the branch of w = 0 ends where w^2 = 1/3, at |x| = FOLD."""
    return ps.DescriptorModel(
        [[-1.0, 1.0], [0.3, -1.0]], [("x**3", [[0.0, 1.0]], [[0.0], [1.0]])], [[1.0], [0.0]], algebraic=["w"]
    )


FOLD = 2 / 3**1.5 / 0.3


def bus(seed: int) -> ps.DescriptorModel:
    """A first order angle behind a bus without inertia, x' = p - a sin(x - w), 0 = a sin(x - w) - b sin(w) - u."""
    a, b, p = np.random.default_rng(seed).uniform((0.5, 0.5, -0.3), (2.0, 2.0, 0.3))
    lines = ("sin(x)", [[1.0, -1.0], [0.0, 1.0]], [[-a, 0.0], [a, -b]])
    return ps.DescriptorModel([[0.0, 0.0]] * 2, [lines], [[0.0], [-1.0]], b=[p, 0.0], algebraic=["w"])


def equilibrium_network(n: int, q: int, seed: int, f: str = "tanh(x)") -> ps.DescriptorModel:
    """x' = A x + B1 f(w), 0 = -w + C x + D f(w): contracting with P and multipliers 1."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n + q, n + q))
    H = X @ X.T / (n + q) + 0.1 * np.eye(n + q)
    skew = [(S - S.T) / 2 for S in (rng.normal(size=(n, n)), rng.normal(size=(q, q)))]
    A, D = skew[0] - H[:n, :n] / 2, np.eye(q) + skew[1] - H[n:, n:] / 2
    B1 = rng.normal(size=(n, q)) / np.sqrt(q)
    C = -(B1 + H[:n, n:]).T
    A0 = np.block([[A, np.zeros((n, q))], [C, -np.eye(q)]])
    return ps.DescriptorModel(
        A0,
        [(f, np.eye(q, n + q, n), np.vstack([B1, D]))],
        np.eye(n + q, 1),
        algebraic=[f"w{k}" for k in range(q)],
    )
