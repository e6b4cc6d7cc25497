"""Options of an identification: which values there are, and which go together."""

from typing import Any

import numpy as np

from persid.errors import DataError
from persid.identification.estimators import METHODS
from persid.identification.learned import learns

HOLDS = ("zoh", "paper")
TIMES = ("continuous", "discrete")


def _check_steps(estimator: Any) -> None:
    """Refuse what has no meaning in discrete time."""
    stride = estimator.stride
    if stride != "auto" and (isinstance(stride, bool) or not isinstance(stride, int | np.integer) or stride < 1):
        raise DataError(f'stride={stride!r}; needed is "auto" or a number of samples from 1 on')
    if estimator.time == "continuous":
        if stride not in ("auto", 1):
            raise DataError(f'stride={stride!r} is a step of a model in discrete time; add time="discrete"')
        return
    usual = {"method": "weak", "hold": "zoh", "refine": False, "window": "auto", "instruments": False}
    odd = [name for name, value in usual.items() if getattr(estimator, name) != value]
    odd += ["velocities"] if estimator.velocities not in ("auto", None, {}) else []
    if odd:
        given = getattr(estimator, odd[0])
        raise DataError(f'{odd[0]}={given!r} goes with continuous time; leave it out with time="discrete"')


def _check_learned(estimator: Any) -> None:
    """Refuse options of learned functions that cannot be kept."""
    knots = estimator.knots
    if knots != "auto" and (isinstance(knots, bool) or not isinstance(knots, int | np.integer) or not 1 <= knots <= 60):
        raise DataError(f'knots={knots!r}; needed is "auto" or a number from 1 to 60')
    if estimator.one_curve:
        _check_one_curve(estimator)
    if not estimator.monotone:
        return
    if not learns(estimator.functions):
        raise DataError('monotone=True is said of learned functions; add "pwl" to functions=')
    wrong = [name for name in ("shared", "refine", "threshold", "instruments") if getattr(estimator, name)]
    if wrong:
        raise DataError(f"{wrong[0]}= does not keep learned functions monotone; leave it or monotone= out")


def _check_one_curve(estimator: Any) -> None:
    if not learns(estimator.functions):
        raise DataError('one_curve=True is said of learned functions; add "pwl" to functions=')
    wrong = [name for name in ("shared", "monotone", "instruments") if getattr(estimator, name)]
    if wrong or not estimator._estimator.additive:
        name = wrong[0] if wrong else f"method={estimator.method!r}"
        raise DataError(f"{name} does not go with one_curve=True, a curve with a factor for each place; leave one out")


def check_options(estimator: Any) -> None:
    """Refuse options of a PersidskiiIdentifier that are none, or do not go together.

    Raises:
        DataError: one is; the message says what is needed.
    """
    literal = (("hold", HOLDS), ("gamma", ("coordinates", "literal")), ("time", TIMES))
    for name, allowed in (("method", METHODS), *literal):
        if getattr(estimator, name) not in allowed:
            raise DataError(f"{name}={getattr(estimator, name)!r}; choose one of {', '.join(allowed)}")
    _check_steps(estimator)
    ridge, window = estimator.ridge, estimator.window
    if ridge != "auto" and (isinstance(ridge, str) or not (np.isfinite(ridge) and ridge >= 0)):
        raise DataError(f'ridge={ridge!r}; needed is "auto" or a number >= 0')
    if window != "auto" and (isinstance(window, str) or window < 2 or int(window) % 2):
        raise DataError(f'window={window!r}; needed is "auto" or an even number of samples (Simpson\'s rule)')
    if estimator.instruments and not estimator._estimator.instruments:
        raise DataError(f'instruments=True goes with method="weak"; given {estimator.method!r}')
    _check_learned(estimator)
    if not 0 <= estimator.holdout <= 0.5:
        raise DataError(f"holdout={estimator.holdout!r}; needed is a share from 0 to 0.5")
    if estimator.threshold is not None and not 0 <= estimator.threshold < 1:
        raise DataError(f"threshold={estimator.threshold!r}; needed is None or a share in [0, 1)")
    if not estimator._estimator.lifts and (callable(estimator.lifting) or list(estimator.lifting)):
        raise DataError('lifting= is for method="edmd"; give functions= otherwise')


def refuse_in_memory_only(estimator: Any) -> None:
    """Raise DataError where an option needs all samples at once."""
    wrong = [name for name in ("derivatives", "delays", "refine") if getattr(estimator, name)]
    method = 'time="discrete"' if estimator.time == "discrete" else f'method="{estimator.method}"'
    wrong += [method] if estimator._estimator.in_memory else []
    if wrong:
        raise DataError(f'{", ".join(wrong)}: needs the data in memory; use method="weak" or "edmd" without it')
