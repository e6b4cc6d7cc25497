"""Options of an identification: which values there are, and which go together."""

from typing import Any

import numpy as np

from persid.errors import DataError
from persid.identification.estimators import METHODS

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
