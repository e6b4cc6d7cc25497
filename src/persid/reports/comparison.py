"""reports.comparison."""

from typing import Any

import numpy as np

from persid.verdicts.verdict import Certified, Verdict

UNDER = "under the certificate"  # the fit that is then delivered


def caution(verdict: Verdict, fit: Any, comparison: Any) -> str | None:
    """Return what must stand beside a certificate of a model that foretells measurements worse than their mean.

    `fit` is the report of the free fit, scored on the held-out tail; a model fitted under the certificate is scored by
    its free runs over the data (`comparison`).
    """
    if not isinstance(verdict, Certified):
        return None
    under = next((one for one in (comparison or {}).get("fits", ()) if one["name"] == UNDER), None)
    if under is not None:
        r2, where = float(np.mean(under["r2"])), "in free runs over the data"
    elif fit is not None and fit.free_run is not None:
        r2, where = fit.free_run.r2_mean, "on the held-out tail"
    else:
        return None
    worse = f"{where} the model is worse than the mean (R2 {r2:.2g}): the proof is about the model, not about the plant"
    return worse if r2 < 0 else None


def comparison_rows(comparison: Any) -> list[tuple[str, str]]:
    """Return the free fit and the one under the certificate side by side, as rows of a table; none without two fits."""
    rows = []
    for fit in comparison["fits"] if comparison else ():
        blown = f", {fit['blow_ups']} runs blow up" if fit["blow_ups"] else ""
        rows.append((f"fit {fit['name']}", f"{fit['verdict']}; free run RMSE {fit['rmse']:.4g}{blown}"))
    if comparison and comparison["price"] is not None:
        rows.append(("price", f"the certified model's RMSE is {comparison['price']:.3f} times the free one's"))
    return rows
