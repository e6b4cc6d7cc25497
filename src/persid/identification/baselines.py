"""Baselines of the studies: one-step maps by ridge regression, run freely like a model. Paper: Sec. 5.2.

ARX(2,2) uses two past states and inputs, POLY polynomials of degree 2, RBF 50 radial functions; each is scikit-learn's.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from sklearn.base import BaseEstimator
from sklearn.cluster import MiniBatchKMeans
from sklearn.linear_model import Ridge
from sklearn.metrics.pairwise import rbf_kernel
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, StandardScaler
from sklearn.utils.validation import check_is_fitted

from persid.errors import DataError
from persid.identification.free_runs import Score, free_run_score
from persid.measurements.arrays import as_trajectories, refuse_target
from persid.measurements.boxes import box_of, reach
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory

LAGS = 2
CENTRES = 50


class OneStepRegressor(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """A map from past states and inputs to the next state, for samples at equal steps.

    kind: "arx" (2 past states and inputs, linear), "poly" (degree 2) or "rbf" (50 radial functions).
    ridge: penalty of scikit-learn's Ridge on standardised features.  seed: for the centres of "rbf".
    """

    def __init__(self, kind: str = "arx", ridge: float | int = 1.0, seed: int = 0) -> None:
        self.kind = kind
        self.ridge = ridge
        self.seed = seed

    @property
    def lags(self) -> int:
        """Number of past samples that a prediction uses."""
        return LAGS if self.kind == "arx" else 1

    def fit(
        self, X: object, y: object = None, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> "OneStepRegressor":
        """Fit the map to all pairs of consecutive samples; runs are never paired across their ends.

        Raises:
            DataError: an unknown kind, no run longer than the lags, or y is given.
        """
        refuse_target(y)
        if self.kind not in _FEATURES:
            raise DataError(f"kind={self.kind!r}; choose one of {', '.join(_FEATURES)}")
        data = as_trajectories(X, u, t, dt)
        runs = [run for run in data if len(run) > self.lags]
        if not runs:
            raise DataError(f"no run has more than {self.lags} samples")
        past = np.concatenate([_past(run.x[:-1], run.u[:-1], self.lags) for run in runs])
        after = np.concatenate([run.x[self.lags :] for run in runs])
        features = _FEATURES[self.kind](past, self.seed)
        self.map_ = make_pipeline(StandardScaler(), *features, Ridge(alpha=float(self.ridge)))
        self.map_.fit(past, after)
        self.n_features_in_ = len(data.states)
        self.states_, self.inputs_, self.box_ = data.states, data.inputs, box_of(data)
        return self

    def simulate(self, x0: object, t: object, u: object = None) -> Trajectories:
        """Run freely from x0 at t[0] (n,), its own past repeated, or from states at the first `lags` times (lags, n).

        A run that leaves the box of the data by ten of its widths ends there, with `diverged_at` set.
        """
        check_is_fitted(self, "map_")
        t = np.asarray(t, float)
        u = np.zeros((len(t), 0)) if u is None else np.asarray(u, float)
        start = np.atleast_2d(np.asarray(x0, float))
        states = [*np.repeat(start[:1], self.lags - len(start), axis=0), *start]
        inputs = np.vstack([np.repeat(u[:1], self.lags - len(start), axis=0), u])
        extra = self.lags - len(start)
        low, high = reach(self.box_)
        for k in range(len(start), len(t)):
            row = _past(np.array(states[-self.lags :]), inputs[k + extra - self.lags : k + extra], self.lags)
            following = np.atleast_1d(self.map_.predict(row)[0])
            if not ((following > low) & (following < high)).all():
                return self._trajectories(states[extra:], t, u, float(t[k]))
            states.append(following)
        return self._trajectories(states[extra:], t, u, None)

    def _trajectories(self, states: list[ndarray], t: ndarray, u: ndarray, diverged: float | None) -> Trajectories:
        count = len(states)
        return Trajectories((Trajectory(t[:count], np.array(states), u[:count], diverged),), self.states_, self.inputs_)

    def free_run(self, data: Trajectories) -> Score:
        """Score free runs that start from the first `lags` measured states, as `free_run_score` does."""
        return free_run_score(self, data, past=self.lags)

    def score(
        self, X: object, y: object = None, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> float:
        """Return the mean R2 of free runs; y is refused."""
        refuse_target(y)
        return self.free_run(as_trajectories(X, u, t, dt)).r2_mean


def _past(x: Float[ndarray, "N n"], u: Float[ndarray, "N m"], lags: int) -> Float[ndarray, "k f"]:
    """Return rows (x_k, x_{k-1}, ..., u_k, u_{k-1}, ...) for every k with a full past."""
    last = len(x)
    return np.hstack([a[lags - 1 - k : last - k] for a in (x, u) for k in range(lags)])


def _radial(past: ndarray, seed: int) -> list[object]:
    """Return features exp(-|p - c|^2 / (2 s^2)) with k-means centres and s the median distance of samples to them."""
    standard = StandardScaler().fit_transform(past)
    count = min(CENTRES, len(standard))
    centres = MiniBatchKMeans(count, random_state=seed, n_init=3).fit(standard).cluster_centers_
    sample = standard[:: max(1, len(standard) // 2000)]
    distance = np.sqrt(((sample[:, None] - centres[None]) ** 2).sum(axis=2))
    gamma = 0.5 / max(float(np.median(distance)), 1e-12) ** 2
    return [FunctionTransformer(rbf_kernel, kw_args={"Y": centres, "gamma": gamma})]


_FEATURES: dict[str, Callable[[ndarray, int], list[object]]] = {
    "arx": lambda past, seed: [],
    "poly": lambda past, seed: [PolynomialFeatures(2, include_bias=False)],
    "rbf": _radial,
}


def arx(ridge: float | int = 1.0) -> OneStepRegressor:
    """Return ARX(2,2): the next state is linear in two past states and inputs."""
    return OneStepRegressor("arx", ridge)


def polynomial(ridge: float | int = 1.0) -> OneStepRegressor:
    """Return POLY-2: the next state is a polynomial of degree 2 in state and input."""
    return OneStepRegressor("poly", ridge)


def radial(ridge: float | int = 1.0, seed: int = 0) -> OneStepRegressor:
    """Return RBF-50: the next state is a sum of 50 radial functions of state and input."""
    return OneStepRegressor("rbf", ridge, seed)
