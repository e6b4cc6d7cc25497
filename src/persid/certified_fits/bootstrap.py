"""certified_fits.bootstrap."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json
from persid.errors import DataError
from persid.identification.estimators import estimator
from persid.identification.gram import Gram, weighted
from persid.identification.identifier import PersidskiiIdentifier
from persid.identification.regressions import sparse_coefficients
from persid.measurements.engines import Progress
from persid.models.model import PersidskiiModel
from persid.verdicts.batches import Answer, certify_many, was_interrupted
from persid.verdicts.options import AskedAtRate
from persid.verdicts.summary import summarize
from persid.verdicts.verdict import Certified

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Refits to resampled data with their verdicts.

    `coefficients` are those of every refit, in the order of the fit's `coef_`; `rates` (1/s) and `gains` those of the
    certified refits that have them. Refits without a verdict, after Ctrl-C, are left out.
    """

    models: tuple[PersidskiiModel, ...]
    verdicts: tuple[Answer, ...]
    coefficients: Float[ndarray, "k n p"]
    rates: Float[ndarray, " r"]
    gains: Float[ndarray, " r"]

    @property
    def certified(self) -> int:
        """Number of certified refits."""
        return sum(verdict.is_certified for verdict in self.verdicts)

    @property
    def share(self) -> float:
        """Share of certified refits."""
        return self.certified / max(len(self.verdicts), 1)

    @property
    def deviation(self) -> Float[ndarray, "n p"]:
        """Standard deviation of every coefficient over the refits; 0 without any."""
        return self.coefficients.std(axis=0) if len(self.coefficients) else np.zeros(self.coefficients.shape[1:])

    def quantiles(self, what: str, levels: Sequence[float] = QUANTILES) -> Float[ndarray, " q"]:
        """Return quantiles of the "rates" or the "gains"; NaN where no refit has one."""
        values = {"rates": self.rates, "gains": self.gains}[what]
        return np.quantile(values, levels) if len(values) else np.full(len(levels), np.nan)

    def __str__(self) -> str:
        rows = [f"certified  {self.certified} of {len(self.verdicts)} refits ({100 * self.share:.0f} %)"]
        for what, unit in (("rates", " 1/s"), ("gains", "")):
            low, _, middle, _, high = self.quantiles(what)
            if np.isfinite(middle):
                rows.append(f"{what:<9}  median {middle:.4g}{unit}, 5 % to 95 %: {low:.4g} to {high:.4g}{unit}")
        return "\n".join(rows)


def bootstrap(
    fit: PersidskiiIdentifier,
    count: int = 200,
    *,
    seed: int = 0,
    engine: object = "processes",
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    **question: Unpack[AskedAtRate],
) -> Bootstrap:
    """Refit a model to resampled data and ask for the verdict on every refit.

    What is drawn, with replacement, are the blocks whose Gram matrices the fit has kept (at most 60 stretches of
    consecutive samples, or groups of whole runs), so that a refit costs no pass over the data (block bootstrap: Künsch,
    1989). The basis, the ridge and the structure stay those of the fit. The spread speaks of the sampling alone, not of
    functions that are missing; and blocks must be longer than the memory of the system, or else it looks too small.
    Ctrl-C keeps what is done. For the other arguments see `certify_many`.

    Args:
        fit: a fitted PersidskiiIdentifier of method "weak" or "derivative".
        count: number of refits.
        seed: of the draws.

    Raises:
        DataError: the fit cannot be repeated from its Gram matrices.

    Examples:
        >>> data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> fit = ps.PersidskiiIdentifier(["x"], ridge=1e-3).fit(data)
        >>> ps.bootstrap(fit, 3, engine=None).share
        1.0
    """
    grams = _blocks(fit)
    if count < 1:
        raise DataError(f"count = {count}; needed is at least one refit")
    rng = np.random.default_rng(seed)
    draws = rng.multinomial(len(grams), np.full(len(grams), 1 / len(grams)), size=count)
    thetas = [
        sparse_coefficients(weighted(grams, draw.tolist()), fit.ridge_, fit.threshold, monotone=fit.monotone)
        for draw in draws
    ]
    models = [fit.basis_.model(theta, domain=fit.model_.domain) for theta in thetas]
    answers = certify_many(models, engine=engine, jobs=jobs, scheduler=scheduler, progress=progress, **question)
    done = [k for k, answer in enumerate(answers) if not was_interrupted(answer)]
    briefs = [summarize(answer) for answer in answers if isinstance(answer, Certified)]
    rated = [(brief.rate, brief.gain) for brief in briefs if brief.rate is not None and brief.gain is not None]
    rates, gains = np.array(rated, float).reshape(-1, 2).T
    coefficients = np.stack([theta.T for theta in thetas])[done]
    return Bootstrap(tuple(models[k] for k in done), tuple(answers[k] for k in done), coefficients, rates, gains)


def _blocks(fit: PersidskiiIdentifier) -> tuple[Gram, ...]:
    grams = getattr(fit, "blocks_", ())
    if not grams:
        raise DataError("bootstrap needs a fitted PersidskiiIdentifier; call fit first")
    if not estimator(fit.method).additive:
        raise DataError('bootstrap needs method="weak" or "derivative": a Koopman matrix is not in the Gram matrices')
    if fit.refine or fit.gram_.root is not None:
        raise DataError(
            "bootstrap cannot repeat refine=True, nor a fit too ill-conditioned for its ridge; raise ridge="
        )
    if len(grams) < 2:
        raise DataError("bootstrap needs at least two blocks of data; give longer runs, or more of them")
    return tuple(grams)


def figures(found: Bootstrap, fit: PersidskiiIdentifier) -> Json:
    """Return what a bootstrap found as an object for JSON; `coefficients` are those of the fit, one row a state."""
    spread = {
        what: dict(zip(map(str, QUANTILES), found.quantiles(what).tolist(), strict=True)) if len(values) else None
        for what, values in (("rates", found.rates), ("gains", found.gains))
    }
    return {
        "format": "persid-bootstrap-1",
        "refits": len(found.verdicts),
        "certified": found.certified,
        "share": found.share,
        **spread,
        "terms": [str(name) for name in fit.get_feature_names_out()],
        "coefficients": fit.coef_.tolist(),
        "deviations": found.deviation.tolist(),
    }
