"""One tool, one data set: fit in this process, measure, predict the held-out runs. Run by the benchmarks, not by hand.

    python peers.py TOOL FUNCTIONS data.npz out.npz

data.npz: x (runs, N, n), u (runs, N, m), dt, held; starts (K, n), forces (K, M, m). FUNCTIONS: "same" (functions of
single states that everyone is given beside x itself, such as "x**3;tanh(x)") or "own" (what the tool takes by default).
out.npz: predicted (K, M, n), NaN from a blow-up on; A, the coefficients (n, features), where there are any.
"""

import json
import sys
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from children import measured, versions

CAP = 1e3  # a state beyond this many times the largest one of the data has blown up


WORDS: dict[str, Callable[[Any], Any]] = {
    "x**3": lambda x: x**3,
    "tanh(x)": lambda x: np.tanh(x),
    "sin(x)": lambda x: np.sin(x),
    "cos(x)": lambda x: np.cos(x),
    "sqrt(abs(x))": lambda x: np.sqrt(np.abs(x)),
}


def same(x: Any, functions: str) -> Any:
    """Return the columns x, f(x), ... of the shared library."""
    return np.concatenate([x, *(WORDS[name](x) for name in functions.split(";"))], axis=-1)


class Persid:
    """persid; `own`: its default functions."""

    method = "weak"

    def __init__(self, functions: str) -> None:
        from persid import PersidskiiIdentifier

        self.functions = functions.split(";")
        plain = {"functions": ["x", *self.functions], "x_ref": 0.0, "scale": 1.0} if functions != "own" else {}
        self.identifier = PersidskiiIdentifier(method=self.method, **plain)

    def prepare(self, data: Any) -> Any:
        """Return the data as the tool takes them."""
        from persid import Trajectories

        return Trajectories.from_arrays(list(data["x"]), list(data["u"]), dt=float(data["dt"]))

    def fit(self, prepared: Any) -> None:
        """Fit; this is what is measured."""
        self.model = self.identifier.fit(prepared).model_

    def rate(self, x: Any, u: Any) -> Any:
        """Return x' for continuous-time models."""
        return self.model.rhs(x, u)

    def coefficients(self) -> Any:
        """Return [A0, A_f, …, B, b] (n, features), where the functions are the same for all."""
        by_name = {term.f[0].text: term.A for term in self.model.terms}
        A = [by_name[name] for name in self.functions]
        return np.hstack([self.model.A0, *A, self.model.B, self.model.b[:, None]])


class PersidEdmd(Persid):
    """persid by EDMD and the logarithm."""

    method = "edmd"


class PersidCertified(Persid):
    """persid fitted under the certificate: global, else in the box of the data; there is no other model."""

    def fit(self, prepared: Any) -> None:
        """Fit; this is what is measured."""
        from persid import CertifiedIdentifier

        self.model = CertifiedIdentifier(self.identifier, time_limit=30.0).fit(prepared).model_


class Numpy:
    """Central differences, one call of numpy.linalg.lstsq. `own` is the cubic without cross terms."""

    def __init__(self, functions: str) -> None:
        own = functions == "own"
        self.library = lambda x: np.concatenate([x, x**2, x**3], axis=-1) if own else same(x, functions)

    def prepare(self, data: Any) -> Any:
        """Return the data as the tool takes them."""
        return data["x"], data["u"], float(data["dt"])

    def columns(self, x: Any, u: Any) -> Any:
        """Return the regressors."""
        return np.concatenate([self.library(x), u, np.ones((*x.shape[:-1], 1))], axis=-1)

    def fit(self, prepared: Any) -> None:
        """Fit; this is what is measured."""
        x, u, dt = prepared
        dot = np.gradient(x, dt, axis=1)
        phi = self.columns(x, u)
        self.A = np.linalg.lstsq(phi.reshape(-1, phi.shape[-1]), dot.reshape(-1, x.shape[-1]), rcond=None)[0].T

    def rate(self, x: Any, u: Any) -> Any:
        """Return x' for continuous-time models."""
        return self.columns(x, u) @ self.A.T

    def coefficients(self) -> Any:
        """Return the coefficients (n, features)."""
        return self.A


class Sindy:
    """PySINDy. `same`: least squares on the shared library; `own`: cubic polynomials, STLSQ with its threshold 0.1."""

    smooth = False

    def __init__(self, functions: str) -> None:
        import pysindy

        self.functions = functions
        self.pysindy = pysindy

    def prepare(self, data: Any) -> Any:
        """Return the data as the tool takes them."""
        n, m = data["x"].shape[-1], data["u"].shape[-1]
        library = self.pysindy.PolynomialLibrary(degree=3)
        optimizer = self.pysindy.STLSQ()
        if self.functions != "own":
            linear = self.pysindy.PolynomialLibrary(degree=1)
            custom = self.pysindy.CustomLibrary([WORDS[name] for name in self.functions.split(";")])
            seen = [list(range(n + m)), list(range(n))]
            library = self.pysindy.GeneralizedLibrary([linear, custom], inputs_per_library=seen)
            optimizer = self.pysindy.STLSQ(threshold=0.0, alpha=0.0)
        derivative = self.pysindy.SmoothedFiniteDifference() if self.smooth else self.pysindy.FiniteDifference()
        self.model = self.pysindy.SINDy(feature_library=library, optimizer=optimizer, differentiation_method=derivative)
        self.n, self.m = n, m
        u = list(data["u"]) if m else None
        return list(data["x"]), u, float(data["dt"])

    def fit(self, prepared: Any) -> None:
        """Fit; this is what is measured."""
        x, u, dt = prepared
        self.model.fit(x, t=dt, u=u)

    def rate(self, x: Any, u: Any) -> Any:
        """Return x' for continuous-time models."""
        if self.functions != "own":  # the same sum, without the cost of predict
            return np.concatenate([same(x, self.functions), u, [1.0]]) @ self.coefficients().T
        powers = self.model.feature_library.powers_
        return np.prod(np.concatenate([x, u]) ** powers, axis=1) @ self.model.coefficients().T

    def coefficients(self) -> Any:
        """Return the coefficients in the order of the shared library."""
        n, m, C = self.n, self.m, np.asarray(self.model.coefficients())
        return np.hstack([C[:, 1 : n + 1], C[:, n + m + 1 :], C[:, n + 1 : n + m + 1], C[:, :1]])


class SindySmoothed(Sindy):
    """PySINDy with SmoothedFiniteDifference, its means against noise."""

    smooth = True


class Koop:
    """pykoop: EDMD with inputs. `own`: polynomials up to order 3; `same`: a lifting function class of three lines."""

    def __init__(self, functions: str) -> None:
        import pykoop

        self.pykoop = pykoop
        own = functions == "own"
        lifting = pykoop.PolynomialLiftingFn(order=3) if own else pykoop_lifting(pykoop, functions, constant=True)()
        self.model = pykoop.KoopmanPipeline([("lift", lifting)], pykoop.Edmd(alpha=0))

    def prepare(self, data: Any) -> Any:
        """Return the data as the tool takes them: a column of episodes, states, inputs."""
        self.m = data["u"].shape[-1]
        episodes = [(float(i), np.hstack([x, u])) for i, (x, u) in enumerate(zip(data["x"], data["u"], strict=True))]
        return self.pykoop.combine_episodes(episodes, episode_feature=True)

    def fit(self, prepared: Any) -> None:
        """Fit; this is what is measured."""
        self.model.fit(prepared, n_inputs=self.m, episode_feature=True)

    def predict(self, start: Any, forces: Any) -> Any:
        """Return a free run, lifted anew at every step (pykoop's default)."""
        return self.model.predict_trajectory(start[None], forces, relift_state=True, episode_feature=False)


def pykoop_lifting(pykoop: Any, functions: str, constant: bool) -> type:
    """Return the class of the shared library for pykoop, with or without a constant."""
    extra, width = int(constant), 1 + len(functions.split(";"))

    class Same(pykoop.EpisodeIndependentLiftingFn):
        """States lifted, inputs kept."""

        def _fit_one_ep(self, X: Any) -> tuple[int, int]:
            return width * self.n_states_in_ + extra, self.n_inputs_in_

        def _transform_one_ep(self, X: Any) -> Any:
            return np.hstack(
                [same(X[:, : self.n_states_in_], functions), np.ones((len(X), extra)), X[:, self.n_states_in_ :]]
            )

        def _inverse_transform_one_ep(self, X: Any) -> Any:
            return np.hstack([X[:, : self.n_states_in_], X[:, width * self.n_states_in_ + extra :]])

        def _transform_feature_names(self, feature_names: Any = None, format: Any = None) -> Any:
            raise NotImplementedError

        def _validate_parameters(self) -> None:
            pass

    return Same


class Koopman:
    """PyKoopman: EDMDc. `own`: polynomials up to degree 3; `same`: custom observables, and an input that is 1."""

    def __init__(self, functions: str) -> None:
        import pykoopman

        own = functions == "own"
        custom = [] if own else [WORDS[name] for name in functions.split(";")]
        self.forced = (lambda u: u) if own else (lambda u: np.concatenate([u, np.ones((*u.shape[:-1], 1))], axis=-1))
        observables = pykoopman.observables.Polynomial(3) if own else pykoopman.observables.CustomObservables(custom)
        self.regression = pykoopman.regression
        self.build = lambda regressor: pykoopman.Koopman(observables, regressor, quiet=True)

    def prepare(self, data: Any) -> Any:
        """Return the data as the tool takes them: pairs of consecutive samples, of all runs."""
        x, u = data["x"], self.forced(data["u"])
        self.m = u.shape[-1]
        self.model = self.build(self.regression.EDMDc() if self.m else self.regression.EDMD())
        self.dt = float(data["dt"])
        pairs = (x[:, :-1], x[:, 1:], u[:, :-1])
        return (x[0], None, u[0]) if len(x) == 1 else [part.reshape(-1, part.shape[-1]) for part in pairs]

    def fit(self, prepared: Any) -> None:
        """Fit; this is what is measured."""
        x, y, u = prepared
        self.model.fit(x, y=y, u=u if self.m else None, dt=self.dt)

    def predict(self, start: Any, forces: Any) -> Any:
        """Return a free run, lifted anew at every step."""
        x = [start]
        for u in self.forced(forces[:-1]):
            x.append(np.real(self.model.predict(x[-1][None], u[None] if self.m else None))[0])
            if not np.abs(x[-1]).max() < 1e12:
                break
        return np.array(x)


TOOLS: dict[str, Callable[[str], Any]] = {
    "persid": Persid,
    "persid EDMD": PersidEdmd,
    "persid certified": PersidCertified,
    "NumPy": Numpy,
    "PySINDy": Sindy,
    "PySINDy smoothed": SindySmoothed,
    "pykoop": Koop,
    "PyKoopman": Koopman,
}


def free_run(tool: Any, start: Any, t: Any, forces: Any, held: bool, cap: float) -> Any:
    """Return the predicted states at t, NaN from a blow-up on."""
    if hasattr(tool, "predict"):
        with np.errstate(all="ignore"):
            found = np.asarray(tool.predict(start, forces), float)
    else:
        found = _integrated(tool, start, t, forces, held, cap)
    fine = np.cumprod((np.abs(found) < cap).all(axis=1)).astype(bool)
    result = np.full((len(t), len(start)), np.nan)
    result[: len(found)][fine] = found[fine]
    return result


def _integrated(tool: Any, start: Any, t: Any, forces: Any, held: bool, cap: float) -> Any:
    """Integrate x' by LSODA, from jump to jump of a held input; other inputs are joined by lines."""
    from scipy.integrate import solve_ivp

    jumps = np.flatnonzero((np.diff(forces[:-1], axis=0) != 0).any(axis=1)) + 1 if held else np.array([], int)
    states = [start[None]]

    def force(s: float) -> Any:
        return np.array([np.interp(s, t, forces[:, k]) for k in range(forces.shape[1])])

    def escaped(s: float, x: Any, *_: Any) -> float:
        return cap - float(np.abs(x).max())

    escaped.terminal = True  # type: ignore[attr-defined]
    for a, b in pairwise([0, *jumps.tolist(), len(t) - 1]):
        u = forces[a]
        rate = (lambda s, x, u=u: tool.rate(x, u)) if held else (lambda s, x: tool.rate(x, force(s)))
        with np.errstate(all="ignore"):
            span = solve_ivp(
                rate, (t[a], t[b]), states[-1][-1], "LSODA", t[a : b + 1], events=escaped, rtol=1e-7, atol=1e-9
            )
        states.append(span.y.T[1:])
        if span.status != 0 or not np.isfinite(span.y).all():
            break
    return np.concatenate(states)


def main(name: str, functions: str, data_path: str, out_path: str) -> None:
    """Fit, predict, print the measurements as one JSON object."""
    data = dict(np.load(data_path))
    tool = TOOLS[name](functions)
    prepared = tool.prepare(data)
    _, seconds, memory = measured(lambda: tool.fit(prepared))
    t = np.arange(data["forces"].shape[1]) * float(data["dt"])
    cap = CAP * float(np.abs(data["x"]).max())
    runs = zip(data["starts"], data["forces"], strict=True)
    found = {"predicted": np.array([free_run(tool, x0, t, u, bool(data["held"]), cap) for x0, u in runs])}
    if functions != "own" and hasattr(tool, "coefficients"):
        found["A"] = tool.coefficients()
    np.savez(out_path, **found)
    print(json.dumps({"seconds": seconds, "memory_MB": memory, "versions": versions()}))


if __name__ == "__main__":
    main(*sys.argv[1:])
