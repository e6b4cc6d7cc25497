"""Comparison: what stands beside a verdict, the scores of the very model and the fit that was not delivered."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray

from persid._dyadics import value
from persid._files import Json
from persid._text import below
from persid.certificates.certificate import Certificate
from persid.errors import DataError, UnderdeterminedError
from persid.identification.estimates import Dictionary
from persid.identification.scores import Ahead, Scores
from persid.lyapunov.operating_points import find_operating_point
from persid.measurements.recordings import Measurements
from persid.measurements.trajectories import Trajectories
from persid.models.model import PersidskiiModel
from persid.plants.margin import PlantMargin, Reading, margin_of
from persid.plants.residuals import doubt, inside, measured_residuals
from persid.verdicts.verdict import Certified, Refuted, Verdict

if TYPE_CHECKING:
    from persid.certified_fits.delivery import Delivery

FEW_COLUMNS = 12  # of a model of which the coefficients that data allow are looked at as one set
MOST_STATES = 20  # of an undecided model whose equilibrium is sought anew


def cautions(
    verdict: Verdict, scores: Scores | None, data: Measurements | None = None, model: object = None, hold: str = "zoh"
) -> tuple[str, ...]:
    """Return what must stand beside a verdict, in clauses; none where all is well.

    What is certified may not be shown to foretell, the measured residuals may not fit into its margin, and any verdict
    may be about a point that does not occur in the data; `model` tells that point where the verdict does not.
    """
    found = list(scores.doubts) if scores is not None and isinstance(verdict, Certified) else []
    if found:
        found[-1] += ": the proof is about the model, not about the plant"
    if data is not None and isinstance(verdict, Certified) and verdict.margin is not None:
        measured = measured_residuals(verdict.certificate.model, verdict.margin, data, hold)
        found += [said for said in [doubt(measured, verdict.margin)] if said]
    return (*found, *(_outside(*_nominal(verdict, model), data) if data is not None else ()))


def measured_margin(verdict: Verdict, data: Measurements, hold: str) -> tuple[float, str] | None:
    """Return the share of the measured residuals within the margin, and what to say of it; None without a margin."""
    if not isinstance(verdict, Certified) or verdict.margin is None:
        return None
    measured = measured_residuals(verdict.certificate.model, verdict.margin, data, hold)
    return measured.share(verdict.margin.delta), inside(measured, verdict.margin)


def of_plant(verdict: Verdict, data: Measurements | None, hold: str, time_limit: float | int) -> PlantMargin | None:
    """Return what measurements say of the plant of a model of few columns; None where they are too few, or not held.

    The set of all coefficients that data allow is sharp where these are few.
    """
    margin = verdict.margin if isinstance(verdict, Certified) else None
    if margin is None or not isinstance(data, Trajectories):
        return None
    if Dictionary(margin.certificate.model).size > FEW_COLUMNS:
        return None
    try:
        return margin_of(verdict, data, Reading(hold, time_limit=time_limit))
    except (DataError, UnderdeterminedError):
        return None


def without_margin(verdict: Verdict, asked: float | None) -> tuple[str, ...]:
    """Return that a residual margin (1/s) that was asked for is not shown, where that is so."""
    margin = verdict.margin if isinstance(verdict, Certified) else None
    if asked is None or (margin is not None and margin.delta >= asked):
        return ()
    shown = "none is shown" if margin is None else f"{below(margin.delta)} is shown"
    return (f"a residual margin of {asked:g} 1/s was asked for; {shown}",)


def _nominal(verdict: Verdict, model: object) -> tuple[ndarray | None, ndarray | None]:
    """Return the nominal state and input that a verdict is about, None where it names none."""
    if isinstance(verdict, Certified):
        proof = verdict.certificate
        if not isinstance(proof, Certificate) or proof.stated.x is None:
            return None, None
        return proof.operating_point, proof.input
    if isinstance(verdict, Refuted):
        content = verdict.witness.content
        proof = content["witness"]
        point = proof.get("point") or next(iter(proof.get("points", ())), None)
        return None if point is None else _numbers(point["x"]), _numbers(content["u"])
    if not isinstance(model, PersidskiiModel) or model.n > MOST_STATES:
        return None, None
    point = next(iter(find_operating_point(model)), None)
    return None if point is None else point.x, model.u_ref


def _numbers(pairs: Iterable[Sequence[int]]) -> ndarray:
    return np.array([value(pair) for pair in pairs])


def _outside(x: ndarray | None, u: ndarray | None, data: Measurements) -> Iterator[str]:
    """Say which of x* and u* lie outside the range of the data by more than a tenth of it: decays end beside it."""
    found, n = data.moments, len(data.states)
    slack = 0.1 * (found.high - found.low)
    low, high = found.low - slack, found.high + slack
    for name, point, part in (("state x*", x, slice(n)), ("input u*", u, slice(n, None))):
        if point is not None and not ((low[part] <= point) & (point <= high[part])).all():
            shown = ", ".join(f"{number:.3g}" for number in point)
            yield f"the nominal {name} = ({shown}) lies outside the range of the data"


def score_rows(made: "Delivery") -> list[tuple[str, str]]:
    """Return rows: how the delivered model foretells data that it has not seen, and the free fit beside it."""
    if made.scores is None:
        return []
    rows = [("foretells", f"{scored(made.scores)}, on {made.scores.basis}")]
    if made.scores.headline is not made.scores.whole:
        rows.append(("free run", f"{_figures(made.scores.whole)} over all of it"))
    if made.free_scores is not None and made.free_scores is not made.scores:
        rows.append(("free fit", f"{scored(made.free_scores)}, on the same"))
    return rows


def scored(scores: Scores) -> str:
    """Return the headline figures of scores, with their horizon; where R2 is negative, that of the mean beside it.

    R2 is against the spread of the whole record, and what is scored may lie further from its mean than that.
    """
    mean = float(np.mean(scores.mean_r2)) if scores.mean_r2 else 0.0
    beside = f" (the mean has R2 {mean:.4f})" if scores.headline.r2_mean < 0 and mean < 0 else ""
    return f"{_figures(scores.headline)} over {scores.headline.length}{beside}"


def _figures(row: Ahead) -> str:
    blown = f", {row.blow_ups} of {row.runs} runs blow up" if row.blow_ups else ""
    return f"R2 {row.r2_mean:.4f}, error {max(row.percent):.2g} % of the range{blown}"


def score_facts(made: "Delivery") -> Json:
    """Return the scores of the delivered model and of the free fit, and the price, for programs."""
    price = (made.comparison or {}).get("price")
    return {"scores": facts(made.scores), "free_scores": facts(made.free_scores), "price": price}


def facts(scores: Scores | None) -> Json | None:
    """Return scores in plain numbers: what they are on, every horizon, and which row is the headline."""
    if scores is None:
        return None
    rows = [
        {"steps": r.steps, "seconds": r.seconds, "r2": r.r2_mean, "rmse": list(r.rmse), "percent": list(r.percent)}
        | {"r2_states": list(r.r2), "runs": r.runs, "blow_ups": r.blow_ups, "free_run": r.whole}
        for r in scores.rows
    ]
    return {"on": scores.basis, "unseen": scores.unseen, "headline": scores.place, "rows": rows}


def alternative_rows(made: "Delivery") -> list[tuple[str, str]]:
    """Return the row of a certified model that was not delivered, with its price."""
    if made.alternative is None:
        return []
    price = made.alternative.price
    why = "no such fit without the held-out data" if price is None else f"error on held-out data times {price:.3g}"
    return [("beside it", f"a certified model, {why}: alternative/model.json, certificate.json")]


def comparison_rows(comparison: Json | None) -> list[tuple[str, str]]:
    """Return the free fit and the one under the certificate side by side, as rows of a table; none without two fits."""
    if not comparison:
        return []
    rows = [("free runs", both_fits(comparison))]
    if comparison.get("free_model") and comparison["price"] is not None:
        rows.append(("price", f"the certified fit's error is {comparison['price']:.3g} times the free one's"))
    return rows


def both_fits(comparison: Json) -> str:
    """Return in one clause how free runs of the certified model and of the other one miss the data."""
    free, *certified = comparison["fits"]
    if not certified:
        return f"no certified model; uncertified: free-run error {_error(free)}"
    other = {"certified": "certified in a region", "refuted": "uncertified, proved not stable,"}
    name = other.get(free["verdict"], "uncertified")
    return f"certified model: free-run error {_error(certified[0])}; {name} {_error(free)}"


def _error(fit: Json) -> str:
    blown = f" ({fit['blow_ups']} runs blow up)" if fit["blow_ups"] else ""
    return f"{fit['rmse']:.4g}{blown}"
