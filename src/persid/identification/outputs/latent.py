"""A batch of latent models of one size, in standard units, with one sample as the unit of time."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.models.learned_curves import slope, value, way
from persid.models.lookup_tables import WORD


@dataclass(frozen=True, eq=False)
class Latent:
    """Hold K models x' = W (x, f(V (x, 1)), u, 1), y = h(O (x, u, 1)), W = [A A1 B b], V = [R beta], O = [C D d].

    The first `hardening` neurons are s - f(s) in place of f(s): their slopes lie in [0, 1] as well, and grow from rest.
    x0 is the state at the first sample of every record. F are the slopes of every neuron's function in its pieces where
    they are learnt (activation "pwl"), else k = 0.
    """

    W: Float[ndarray, "K n w"]
    V: Float[ndarray, "K q r"]
    O: Float[ndarray, "K l o"]  # noqa: E741 the outputs' matrix
    x0: Float[ndarray, "K records n"]
    F: Float[ndarray, "K q k"]
    activation: str = "tanh"
    output_map: str | None = None
    hardening: int = 0

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.W.shape[1])

    @property
    def q(self) -> int:
        """Number of neurons."""
        return int(self.V.shape[1])

    @property
    def m(self) -> int:
        """Number of inputs."""
        return int(self.W.shape[2] - self.n - self.q - 1)

    @property
    def A(self) -> Float[ndarray, "K n n"]:
        """The linear parts."""
        return self.W[:, :, : self.n]

    @property
    def A1(self) -> Float[ndarray, "K n q"]:
        """The columns of the neurons."""
        return self.W[:, :, self.n : self.n + self.q]

    @property
    def B(self) -> Float[ndarray, "K n m"]:
        """The columns of the inputs."""
        return self.W[:, :, self.n + self.q : -1]

    @property
    def b(self) -> Float[ndarray, "K n"]:
        """The offsets."""
        return self.W[:, :, -1]

    @property
    def R(self) -> Float[ndarray, "K q n"]:
        """The rows of the neurons."""
        return self.V[:, :, :-1]

    @property
    def C(self) -> Float[ndarray, "K l n"]:
        """The outputs' rows."""
        return self.O[:, :, : self.n]

    def __getitem__(self, chosen: ndarray | slice) -> "Latent":
        W, V, O, x0, F = (part[chosen] for part in (self.W, self.V, self.O, self.x0, self.F))  # noqa: E741
        return Latent(W, V, O, x0, F, *self.kind)

    def mapped(self, T: Float[ndarray, "n n"], centre: Float[ndarray, " n"]) -> "Latent":
        """Return the same models with the state T (x - centre)."""
        back, n = np.linalg.inv(T), self.n
        W, V, O = T @ self.W, self.V.copy(), self.O.copy()  # noqa: E741
        W[:, :, :n] = W[:, :, :n] @ back
        V[:, :, :n], O[:, :, :n] = V[:, :, :n] @ back, O[:, :, :n] @ back
        W[:, :, -1] += (self.A @ centre) @ T.T
        V[:, :, -1] += self.R @ centre
        O[:, :, -1] += self.C @ centre
        return Latent(W, V, O, (self.x0 - centre) @ T.T, self.F, *self.kind)

    @property
    def kind(self) -> tuple[str, str | None, int]:
        """The activation, the output map, and how many neurons harden."""
        return self.activation, self.output_map, self.hardening

    def in_activations(self) -> "Latent":
        """Return the same models without hardening neurons: A1 (s - f(s)) = A1 R x + A1 beta - A1 f(s)."""
        return replace(self.hardened(self.hardening), hardening=0)

    def hardened(self, count: int) -> "Latent":
        """Return the models whose first neurons are turned: s - f(s) becomes f(s), and f(s) becomes s - f(s)."""
        W, V, turned = self.W.copy(), self.V[:, :count], slice(self.n, self.n + count)
        W[:, :, : self.n] += W[:, :, turned] @ V[:, :, :-1]
        W[:, :, -1:] += W[:, :, turned] @ V[:, :, -1:]
        W[:, :, turned] *= -1
        return replace(self, W=W, hardening=count)

    def activated(self, s: Float[ndarray, "*_ q S"]) -> Float[ndarray, "*_ q S"]:
        """Return what the neurons make of s."""
        return _turned(activated(self.activation, s, self.F), s, self.hardening)

    def slopes(self, s: Float[ndarray, "*_ q S"], f: Float[ndarray, "*_ q S"]) -> Float[ndarray, "*_ q S"]:
        """Return the neurons' slopes at s, given their values f."""
        k = self.hardening
        slopes = slope_of(self.activation, s, _turned(f.copy(), s, k) if k else f, self.F)
        return _turned(slopes, np.ones(s.shape[-2:]), k)

    def by_slopes(self, s: Float[ndarray, "t K q S"]) -> Float[ndarray, "t K q k S"]:
        """Return the derivatives of the neurons by the slopes of their functions: the ways of s in the pieces."""
        ways = np.moveaxis(way(s, self.F.shape[2]), -1, -2)
        ways[:, :, : self.hardening] *= -1
        return ways


def _turned(f: ndarray, s: ndarray, count: int) -> ndarray:
    """Return f, whose first rows become s - f in place."""
    if count:
        first = f[..., :count, :]
        np.subtract(s[..., :count, :], first, out=first)
    return f


def activated(name: str, s: Float[ndarray, "*_ q S"], F: Float[ndarray, "*_ q k"]) -> Float[ndarray, "*_ q S"]:
    """Return f(s) of an activation by name; of learned functions with slopes F."""
    if name == WORD:
        return value(s, F)
    if name == "softsign":
        return np.asarray(s / (1 + np.abs(s)))
    found: ndarray = getattr(np, name)(s)
    return found


def slope_of(
    name: str, s: Float[ndarray, "*_ q S"], f: Float[ndarray, "*_ q S"], F: Float[ndarray, "*_ q k"]
) -> Float[ndarray, "*_ q S"]:
    """Return f'(s), given f = f(s)."""
    if name == WORD:
        return slope(s, F)
    if name == "tanh":
        return np.asarray(1 - f * f)
    return np.asarray((1 + np.abs(s)) ** -2.0 if name == "softsign" else 1 / (1 + s * s))
