"""Delivery: which model a run hands over, the free fit or the one under the certificate, judged by unseen data.

A certificate of a model that foretells less than another one is no reason to hand it over. Both fits are made anew
without the held-out part; the fit under the certificate takes the free one's place only where it foretells that part
about as well. Otherwise the free model is delivered with its own verdict, and the certified one is kept beside it.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from persid._files import Json
from persid.certified_fits.comparison import comparison
from persid.certified_fits.identifier import RATING, CertifiedIdentifier, rated
from persid.errors import DataError
from persid.identification.identifier import PersidskiiIdentifier
from persid.identification.scores import HeldOut, Record, Scores, held_out_scores, hold_out
from persid.measurements.trajectories import Trajectories
from persid.models.model import PersidskiiModel
from persid.verdicts.certify import certify
from persid.verdicts.verdict import Certified, Refuted, Verdict

PRICE = 2.0  # times the free fit's error on held-out data that a certified model may have to take its place
SEVERAL = "two-equilibria"
UNSEEN_NONE = "all of the data, which the fit has seen"


@dataclass(frozen=True, eq=False)
class Alternative:
    """The certified model that was not delivered, and its error on held-out data over that of the free fit."""

    model: PersidskiiModel
    verdict: Certified
    price: float | None


@dataclass(frozen=True, eq=False)
class Delivery:
    """What a run hands over: a model with its verdict and its scores, and what stands beside it.

    `scores` are those of the delivered kind of fit on data that it has not seen, `free_scores` the free fit's;
    `comparison` sets both fits side by side where there were two.
    """

    model: PersidskiiModel
    verdict: Verdict
    comparison: Json | None = None
    scores: Scores | None = None
    free_scores: Scores | None = None
    alternative: Alternative | None = None


@dataclass(frozen=True, eq=False)
class Trial:
    """How both fits, made of the same part of the data, foretell the other part."""

    free: Scores
    certified: Scores | None

    @property
    def price(self) -> float | None:
        """The certified fit's error over the free one's; None where there is no certified fit."""
        if self.certified is None:
            return None
        mine, other = self.certified.headline.error, self.free.headline.error
        return mine / other if other > 0 else float("inf") if mine > 0 else 1.0


def deliver(
    free: PersidskiiIdentifier,
    verdict: Verdict,
    data: Trajectories,
    *,
    time_limit: float | int = 60.0,
    progress: Callable[[str], None] | None = None,
    select: str | None = None,
    price: float | int = PRICE,
    rate: float | int | None = None,
    residual_margin: float | int | None = None,
) -> Delivery:
    """Keep a free fit that is certified globally; else compare it with a fit under the certificate on unseen data.

    The certified fit is delivered where its error on held-out data is at most `price` times the free fit's. With
    select="auto" its functions are selected under the certificate, and it is made in any case; with `residual_margin`
    (1/s), as for CertifiedIdentifier, where the free fit has no such margin. `rate` (1/s) is as for `certify`.
    """
    if select is None and isinstance(verdict, Certified) and _suffices(verdict, residual_margin):
        scores = trial(free, None, data).free
        return Delivery(free.model_, verdict, None, scores, scores)
    began = time.perf_counter()
    limit = max(time_limit, 1e-3)
    asked = CertifiedIdentifier(free, residual_margin=residual_margin, select=select, time_limit=limit)
    fit = asked.set_params(progress=progress).fit(data)
    compared = comparison(fit.report_, type(verdict).__name__.lower())
    if not isinstance(fit.verdict_, Certified):
        scores = trial(free, None, data).free
        own = about_named_point(free.model_, verdict, limit, progress, rate)
        return Delivery(free.model_, own, compared, scores, scores)
    judged = trial(free, fit, data, limit)
    left = max(time_limit - (time.perf_counter() - began), RATING)
    if judged.price is not None and judged.price <= price:
        compared |= {"free_model": free.model_.to_dict(), "price": judged.price}
        proved = rated(fit.model_, fit.verdict_, left, progress, rate)
        return Delivery(fit.model_, proved, compared, judged.certified, judged.free)
    beside = Alternative(fit.model_, fit.verdict_, judged.price)
    own = about_named_point(free.model_, verdict, left, progress, rate)
    return Delivery(free.model_, own, compared | {"price": judged.price}, judged.free, judged.free, beside)


def _suffices(verdict: Certified, residual_margin: float | int | None) -> bool:
    """Whether a verdict is one for all states, with the margin that is asked for."""
    shown = 0.0 if verdict.margin is None else verdict.margin.delta
    return verdict.certificate.scope == "global" and shown >= (residual_margin or 0.0)


def about_named_point(
    model: PersidskiiModel,
    verdict: Verdict,
    time_limit: float | int,
    progress: Callable[[str], None] | None = None,
    rate: float | int | None = None,
) -> Verdict:
    """Return the verdict, or that of the region about the named equilibrium where only global stability is out.

    A model with several equilibria is not stable from everywhere, and may well be in the region of one of them.
    """
    if isinstance(verdict, Certified) or (isinstance(verdict, Refuted) and verdict.witness.kind != SEVERAL):
        return verdict
    found = certify(model, domain="data", rate=rate, time_limit=time_limit, progress=progress)
    return found if isinstance(found, Certified) else verdict


def trial(
    free: PersidskiiIdentifier, fit: CertifiedIdentifier | None, data: Trajectories, time_limit: float | int = 60.0
) -> Trial:
    """Fit both anew without the held-out part and score them there; without such a part, score them on what they saw.

    The strength of the ridge and the functions are those of the fits to all data, chosen by their own validation.
    """
    data = free._known(data)
    parts, record = hold_out(data), Record.of(data)
    if parts is None:
        return _seen(free, fit, data, record)
    try:
        first = free.on_appended().set_params(ridge=free.ridge_).fit(parts.train)
    except DataError:  # too little is left for a fit
        return _seen(free, fit, data, record)
    foretold = _scores(first.model_, parts, record, free.hold)
    if fit is None:
        return Trial(foretold, None)
    functions = {} if fit.functions_ is None else {"functions": fit.functions_}
    ridge = free.ridge_ if fit.ridge_ is None else fit.ridge_
    alike = first.set_params(**functions, velocities=fit.velocities_)
    asked = fit.residual_margin
    again = CertifiedIdentifier(alike, ridge=ridge, residual_margin=asked, time_limit=time_limit).fit(parts.train)
    found = isinstance(again.verdict_, Certified)
    return Trial(foretold, _scores(again.model_, parts, record, free.hold) if found else None)


def _scores(model: PersidskiiModel, parts: HeldOut, record: Record, hold: str) -> Scores:
    held = parts.held.with_inputs(model.inputs)  # one that moves in the held-out part only is none of the model's
    return held_out_scores(model, held, record, hold=hold, basis=parts.basis, before=parts.before)


def _seen(free: PersidskiiIdentifier, fit: CertifiedIdentifier | None, data: Trajectories, record: Record) -> Trial:
    models = [free.model_] if fit is None else [free.model_, fit.model_]
    scores = [held_out_scores(m, data, record, hold=free.hold, basis=UNSEEN_NONE, unseen=False) for m in models]
    return Trial(scores[0], scores[1] if fit is not None else None)
