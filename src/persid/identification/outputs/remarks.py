"""What has to be said of a fit beside its verdict: outputs that integrate, and models that foretell nothing."""

from collections.abc import Iterator, Sequence

import numpy as np

from persid.identification.outputs.latent import activated, slope_of
from persid.models.stable_fit import StableFit

LEAKS = 0.1  # a mode that decays by less than this share over the longest record cannot be told from an integrator
SEEN = 0.3  # of an output's spread, that such a mode has to make


def remarks_on(fit: StableFit, held_out: float, samples: int, names: Sequence[str]) -> tuple[str, ...]:
    """Return sentences on a fit whose longest record has so many samples; held_out is in units of the spread."""
    return tuple([*_integrating(fit, samples, names), *_poor(held_out)])


def _integrating(fit: StableFit, samples: int, names: Sequence[str]) -> Iterator[str]:
    """Name the outputs that the slowest mode of the linearisation about the mean state carries."""
    s = fit.R @ fit.x_mean + fit.beta
    F = np.zeros((len(s), 0)) if fit.F is None else fit.F
    slope = slope_of(fit.activation, s[:, None], activated(fit.activation, s[:, None], F), F)[:, 0]
    poles, V = np.linalg.eig(fit.A + (fit.A1 * slope) @ fit.R)
    slow = int(np.argmax(poles.real))
    length = samples * fit.dt
    if abs(poles[slow]) * length >= LEAKS:
        return
    row = np.linalg.inv(V)[slow]
    made = np.abs(fit.C @ V[:, slow]) * np.sqrt((row @ fit.x_cov @ row.conj()).real)
    spread = np.sqrt(np.einsum("li,ij,lj->l", fit.C, fit.x_cov, fit.C))
    seen = [name for name, a, b in zip(names, made, spread, strict=True) if a > SEEN * b]
    if seen:
        verb = "integrates" if len(seen) == 1 else "integrate"
        yield (
            f"{', '.join(seen)} {verb}: the slowest mode (pole {poles[slow].real:+.2g} 1/s) hardly changes in the "
            f"{length:.3g} s of the longest record, which cannot tell it from an integrator, and that is not "
            "input-to-state stable; a certified rate and gain speak of this leak alone. Fit the rate of change in "
            "place of the output and integrate outside"
        )


def _poor(held_out: float) -> Iterator[str]:
    if held_out >= 1:
        yield (
            f"free runs miss the held-out part by {held_out:.3g} times the spread of the outputs, more than their mean "
            "would: the model foretells nothing. An input may be missing, or the plant is unstable under feedback"
        )
