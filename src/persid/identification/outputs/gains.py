"""Gains of outputs that a fit's own multipliers prove, kept below a limit while the fit goes on."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.outputs.least_squares import Batch, Free, Parameters, Stable, beside, slopes_of
from persid.identification.outputs.parametrisation import Proved

RATES = np.geomspace(1.0, 1e-4, 60)  # of the fastest pole, among which the rate of the smallest gains is sought


@dataclass(frozen=True, eq=False)
class Limit:
    """Keep gains of the outputs below `gains` by a logarithmic barrier of this weight, at rates of `least` and more.

    Gains are in standard units of the outputs per unit of the inputs; `u_scale` is the standard unit of each input. The
    rate is per sample.
    """

    gains: Float[ndarray, " l"]
    u_scale: Float[ndarray, " m"]
    least: float
    weight: float

    def cost(self, parameters: Parameters, batch: Batch) -> Float[ndarray, " K"]:
        """Return - weight sum log (1 - gain / limit), infinite where a gain is not below its limit."""
        if isinstance(parameters, Free):
            return np.zeros(len(batch.w))
        gains = self._gains(parameters, batch)[0]
        with np.errstate(all="ignore"):
            room = 1 - gains / self.gains
            return np.where((room > 0).all(1), -self.weight * np.log(room).sum(1), np.inf)

    def pull(self, parameters: Parameters, batch: Batch) -> tuple[Float[ndarray, "K p"], Float[ndarray, "K p p"]]:
        """Return the barrier's gradient and Gauss-Newton form, at the rates that are best, by differences."""
        K, p = batch.w.shape
        g, H = np.zeros((K, p)), np.zeros((K, p, p))
        if isinstance(parameters, Free):
            return g, H
        gains, rates = self._gains(parameters, batch)
        for k in range(K):
            moved, h = beside(batch, k)
            slopes = slopes_of(self._gains(parameters, moved, float(rates[k]))[0], h) / (self.gains - gains[k])
            g[k], H[k] = self.weight * slopes.sum(1), self.weight * slopes @ slopes.T
        return g, H

    def _gains(
        self, parameters: Stable, batch: Batch, rate: float | None = None
    ) -> tuple[Float[ndarray, "K l"], Float[ndarray, " K"]]:
        latent = parameters.latent(batch)[0]
        return proved_gains(parameters.proved(batch), latent.B, latent.O, self, rate)


@np.errstate(all="ignore")
def proved_gains(
    found: Proved,
    B: Float[ndarray, "K n m"],
    O: Float[ndarray, "K l o"],  # noqa: E741
    limit: Limit,
    rate: float | None = None,
) -> tuple[Float[ndarray, "K l"], Float[ndarray, " K"]]:
    """Return the gains sqrt(|C_i|^2 gamma / kappa) + |D_i| of each model and the rate kappa that makes them smallest.

    With N = (B, M R B) and Z of `StableFit` at kappa, -Z + 2 (z, w)' N v is at most gamma |v|^2, gamma = |N' Z^-1 N|;
    in the steady state V <= gamma / kappa sup|v|^2. Gains are infinite where no rate is proved.
    """
    n, m = B.shape[1:]
    B, D = B / limit.u_scale, O[:, :, n : n + m] / limit.u_scale
    N = np.concatenate([B, found.M[:, :, None] * (found.R @ B)], 1)
    fastest = -2 * np.linalg.eigvals(found.A).real.max(1)
    rates = fastest[:, None] * RATES if rate is None else np.full((len(B), 1), rate)
    ratios = np.stack([_gamma(_inequality(found, kappa), N) / kappa for kappa in rates.T], 1)
    ratios = np.where((rates >= limit.least) & (rates > 0), ratios, np.inf)
    best = ratios.argmin(1)
    ratio, size = ratios[np.arange(len(B)), best], np.linalg.norm(O[:, :, :n], axis=2)
    return np.sqrt(ratio)[:, None] * size + np.linalg.norm(D, axis=2), rates[np.arange(len(B)), best]


def _inequality(found: Proved, kappa: Float[ndarray, " K"]) -> Float[ndarray, "K r r"]:
    """Return Z of `StableFit` for P = 1."""
    A, A1, k = found.A, found.A1, kappa[:, None, None]
    RM, RT = (np.swapaxes(found.R, 1, 2) * part[:, None] for part in (found.M, found.T))
    corner = -(A + np.swapaxes(A, 1, 2)) - k * np.eye(A.shape[1])
    side = -(A1 + np.swapaxes(A, 1, 2) @ RM + RT + k * RM)
    cross = np.swapaxes(RM, 1, 2) @ A1
    last = 2 * found.T[:, :, None] * np.eye(found.T.shape[1]) - cross - np.swapaxes(cross, 1, 2)
    return np.block([[corner, side], [np.swapaxes(side, 1, 2), last]])


def _gamma(Z: Float[ndarray, "K r r"], N: Float[ndarray, "K r m"]) -> Float[ndarray, " K"]:
    """Return |N' Z^-1 N|, infinite where Z is not positive definite."""
    values, vectors = np.linalg.eigh(np.nan_to_num(Z))
    seen = np.swapaxes(vectors, 1, 2) @ N / np.sqrt(np.maximum(values, 1e-300))[..., None]
    return np.where(values[:, 0] > 0, np.linalg.norm(seen, 2, (1, 2)) ** 2 if N.shape[2] else 0.0, np.inf)
