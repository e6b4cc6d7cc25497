"""OutputModel: a model whose states nobody measured, and what is measured of it.

x' = A0 (x - x_ref) + sum A f(R (x - x_ref)) + B (u - u_ref) + b
y  = h(C (x - x_ref) + D (u - u_ref) + d)                        h one function of the grammar an output, or none
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json, readable, write_atomically
from persid.errors import ModelError
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.arguments import distinct_names, finite_array, unknown_fields
from persid.models.functions import ScalarFunction, scalar_function
from persid.models.model import Input, PersidskiiModel
from persid.models.output_equation import OutputEquation
from persid.models.stable_fit import StableFit

FORMAT = "persid-output-model-1"
_FIELDS = (
    "format",
    "dynamics",
    "outputs",
    "C",
    "D",
    "d",
    "output_map",
    "hold",
    "noise",
    "x_mean",
    "x_cov",
    "provenance",
)
_HOLDS = ("zoh", "foh")
_MULTIPLIERS = ("beta", "M", "T", "P", "F")  # arrays of a fit that its model does not hold
_KIND = ("activation", "dt", "kappa")


@dataclass(frozen=True, eq=False)
class OutputModel:
    """A generalized Persidskii model with outputs y = h(C (x - x_ref) + D (u - u_ref) + d), in the user's units.

    Two models are equal where all their numbers and names are, whatever their provenance. How inputs run between
    samples, the noise and the spread of the states are what a simulation goes by; no proof uses them.

    Args:
        dynamics: the model of the states.
        C: rows of the outputs, in units of the output per unit of the state.
        D: what inputs add at once, None for nothing.
        d: outputs at (x_ref, u_ref), before the map.
        output_map: an expression such as "abs(x)" for all outputs, one for each, or None for the identity.
        outputs: names, y1, y2, … by default.
        hold: "zoh" (inputs are held) or "foh" (straight lines between samples).
        noise: standard deviation of what is measured about the model's outputs, in their units, or None.
        x_mean: mean of the states when the model was identified, or None.  x_cov: their covariance, or None.
        provenance: where the model comes from.

    Raises:
        ModelError: shapes do not fit, a number is not finite, a function is not of the grammar, names repeat, or the
            dynamics are in discrete time.

    Examples:
        >>> dynamics = ps.PersidskiiModel(A0=[[0.0, 1.0], [-4.0, -1.0]], B=[[0.0], [1.0]])
        >>> ps.OutputModel(dynamics, C=[[1.0, 0.0]], outputs=["angle"]).outputs
        ('angle',)
    """

    dynamics: PersidskiiModel
    C: Float[ndarray, "l n"]
    D: Float[ndarray, "l m"]
    d: Float[ndarray, " l"]
    output_map: tuple[ScalarFunction, ...] | None
    outputs: tuple[str, ...]
    hold: str
    noise: Float[ndarray, " l"] | None
    x_mean: Float[ndarray, " n"] | None
    x_cov: Float[ndarray, "n n"] | None
    provenance: Json

    def __init__(
        self,
        dynamics: PersidskiiModel,
        C: object,
        D: object = None,
        d: object = None,
        *,
        output_map: str | Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        hold: str = "zoh",
        noise: object = None,
        x_mean: object = None,
        x_cov: object = None,
        provenance: Mapping[str, object] | None = None,
    ) -> None:
        if dynamics.is_discrete:
            raise ModelError("an output model has dynamics in continuous time; these go in steps")
        C = finite_array("C", C, (None, dynamics.n))
        count = len(C)
        if not count:
            raise ModelError("C has no rows; an output model needs at least one output")
        if hold not in _HOLDS:
            raise ModelError(f'hold is {hold!r}; it is "zoh" (inputs are held) or "foh" (straight lines)')
        named = distinct_names("outputs", outputs or [f"y{i + 1}" for i in range(count)], count)
        if shared := set(named) & {*dynamics.states, *dynamics.inputs}:
            raise ModelError(f"{sorted(shared)[0]!r} is the name of an output and of a state or input; rename one")
        values = {
            "dynamics": dynamics.dense(),
            "C": C,
            "D": finite_array("D", np.zeros((count, dynamics.m)) if D is None else D, (count, dynamics.m)),
            "d": finite_array("d", np.zeros(count) if d is None else d, (count,)),
            "output_map": _maps(output_map, count),
            "outputs": named,
            "hold": hold,
            "noise": None if noise is None else finite_array("noise", noise, (count,)),
            "x_mean": None if x_mean is None else finite_array("x_mean", x_mean, (dynamics.n,)),
            "x_cov": None if x_cov is None else finite_array("x_cov", x_cov, (dynamics.n, dynamics.n)),
            "provenance": dict(provenance or {}),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_fit(cls, fit: StableFit, provenance: Mapping[str, object] | None = None) -> "OutputModel":
        """Return the model of a fit to inputs and outputs: each neuron is a term, its shift inside its function.

        What the model does not say of the fit stands in its provenance, from which `to_fit` finds it.
        """
        kept = {name: _listed(getattr(fit, name)) for name in _MULTIPLIERS}
        source = {**(provenance or {}), "fit": {**kept, **{name: getattr(fit, name) for name in _KIND}}}
        terms = [(fit.function(c), fit.R[c : c + 1], fit.A1[:, c : c + 1]) for c in range(len(fit.beta))]
        names: Json = {"inputs": fit.inputs or None, "states": fit.states or None}
        latent = PersidskiiModel(fit.A, terms, fit.B, fit.b, x_ref=fit.x_ref, u_ref=fit.u_ref, **names)
        known: Json = {"noise": fit.noise, "x_mean": fit.x_mean, "x_cov": fit.x_cov, "hold": fit.hold}
        h = None if fit.output_map is None else f"{fit.output_map}(x)"
        seen = fit.outputs or None
        return cls(latent, fit.C, fit.D, fit.d, output_map=h, outputs=seen, provenance=source, **known)

    def to_fit(self) -> StableFit:
        """Return the fit that `from_fit` made this model of, with the multipliers of its proof and without its records.

        Raises:
            ModelError: the model was not made by a fit to inputs and outputs, or was changed since.
        """
        kept, field = self.provenance.get("fit"), self.dynamics.channels
        mean, cov, noise = self.x_mean, self.x_cov, self.noise
        whole = isinstance(kept, Mapping) and set(kept) == {*_MULTIPLIERS, *_KIND}
        if not whole or kept is None or mean is None or cov is None or noise is None:
            raise ModelError("the model was not made by a fit to inputs and outputs")
        h = None if self.output_map is None else self.output_map[0].text.removesuffix("(x)")
        try:
            known: Json = {name: _array(kept[name]) for name in _MULTIPLIERS}
            known |= {name: kept[name] for name in _KIND}
            fit = StableFit(
                A=self.dynamics.A0, R=field.rows, A1=field.columns, B=self.dynamics.B, b=self.dynamics.b, C=self.C,
                D=self.D, d=self.d, u_ref=self.dynamics.u_ref, x0=np.zeros((0, self.dynamics.n)), x_mean=mean,
                x_cov=cov, noise=noise, x_ref=self.dynamics.x_ref, output_map=h, hold=self.hold,
                inputs=self.dynamics.inputs, outputs=self.outputs, states=self.dynamics.states, **known,
            )  # fmt: skip
            same = OutputModel.from_fit(fit).dynamics == self.dynamics
        except (TypeError, ValueError, AttributeError):
            same = False
        if not same:
            raise ModelError("the model is no longer the one that was fitted: its numbers and its provenance differ")
        return fit

    @property
    def sha256(self) -> str:
        """SHA-256 of the dynamics, by which a certificate names its model."""
        return self.dynamics.sha256

    def __repr__(self) -> str:
        n, m, k = self.dynamics.n, self.dynamics.m, len(self.outputs)
        return f"OutputModel({k} outputs {self.outputs}, {m} inputs {self.dynamics.inputs}, {n} latent states)"

    def _repr_html_(self) -> str:
        from persid.models.tables import of_output_model

        return of_output_model(self)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, OutputModel):
            return NotImplemented
        mine, theirs = ({**model.to_dict(), "dynamics": None, "provenance": None} for model in (self, other))
        return self.dynamics == other.dynamics and mine == theirs

    def __hash__(self) -> int:
        return hash((self.dynamics.sha256, self.C.tobytes(), self.outputs))

    @cached_property
    def equation(self) -> OutputEquation:
        """The equation of the outputs alone, as one value."""
        return OutputEquation(self.dynamics.field, self.C, self.D, self.d, self.output_map, self.outputs)

    def output(self, x: Float[ndarray, "*N n"], u: Float[ndarray, "*N m"] | None = None) -> Float[ndarray, "*N l"]:
        """Return y for one state (n,) or many (N, n); u = None means u_ref."""
        return self.equation.values(x, u)

    def simulate(
        self, t: Float[ndarray, " N"], u: Input = None, *, x0: object = None, y_init: object = None
    ) -> Trajectories:
        """Return the outputs at the times t (s), from a state or from the first measured outputs.

        Args:
            t: increasing times in s.
            u: (N, m) samples, between which inputs run as `hold` says; or a function of t; or None for u_ref.
            x0: the latent state at t[0]; or instead
            y_init: (k, l) outputs measured at t[0], …, t[k - 1], of which the state is estimated (`estimate_state`).

        Returns:
            One run, with the outputs in place of states; `diverged_at` as for `PersidskiiModel.simulate`.

        Raises:
            ModelError: neither or both of x0 and y_init are given, or an argument has the wrong shape.
        """
        if (x0 is None) == (y_init is None):
            raise ModelError("give x0, the latent state at t[0], or y_init, the outputs measured at the first times")
        if x0 is None:
            x0 = self.estimate_state(t, u, y_init)
        run = self._states(np.asarray(x0, float), np.asarray(t, float), u)
        seen = Trajectory(run.t, self.output(run.x, run.u), run.u, run.diverged_at, run.stopped_at)
        return Trajectories((seen,), self.outputs, self.dynamics.inputs)

    def estimate_state(self, t: Float[ndarray, " N"], u: object, y: object) -> Float[ndarray, " n"]:
        """Return the latent state at t[0] from outputs y (k, l) measured at t[0], …, t[k - 1], k <= N.

        It is the most likely one, given `noise`, x_mean and x_cov; u is (N, m) or None for u_ref.

        Raises:
            ModelError: y or u has the wrong shape, or y tells too little of a state about which nothing is known.
        """
        from persid.models.initial_states import Known, estimate

        if callable(u):
            raise ModelError("y_init goes with sampled inputs, u (N, m)")
        t = np.asarray(t, float)
        return estimate(Known(self.equation, self.hold, self.noise, self.x_mean, self.x_cov), t, self._samples(t, u), y)

    def _states(self, x0: ndarray, t: ndarray, u: Input) -> Trajectory:
        """Return the run of the states; where fixed steps do not serve, that of an adaptive solver, with its end."""
        from persid.models.steps import run

        samples = None if callable(u) else self._samples(t, u)
        if x0.shape == (self.dynamics.n,) and t.ndim == 1 and len(t) > 1 and (np.diff(t) > 0).all() and not callable(u):
            found = run(self.dynamics.field, x0, t, samples, self.hold)
            if found is not None:
                held = np.tile(self.dynamics.u_ref, (len(t), 1)) if samples is None else samples
                return Trajectory(t, found, held)
        straight = samples is not None and self.hold == "foh"
        return self.dynamics.simulate(x0, t, _lines(t, samples) if straight else u)[0]

    def _samples(self, t: ndarray, u: object) -> Float[ndarray, "N m"] | None:
        if u is None:
            return None
        u = np.asarray(u, float)
        return finite_array("u", u[:, None] if u.ndim == 1 and self.dynamics.m == 1 else u, (len(t), self.dynamics.m))

    def to_callable(self, jit: bool = False) -> tuple[Callable[..., ndarray], Callable[..., ndarray]]:
        """Return rhs(t, x, u=None), as `PersidskiiModel.to_callable` does, and output(x, u=None), in plain NumPy.

        Raises:
            ImportError: `jit` without Numba; it comes with persid[interop].
        """
        return self.dynamics.to_callable(jit), self.output

    def to_control(self, name: str | None = None) -> Any:
        """Return a continuous-time control.NonlinearIOSystem with the model's inputs, states and outputs.

        Raises:
            ImportError: python-control is not installed; it comes with persid[interop].
        """
        from persid.models.exports.libraries import to_control

        return to_control(self.dynamics.field, name, self.equation)

    def to_sympy(self, exact: bool = False) -> tuple[Any, Any]:
        """Return x' (n, 1) and y (l, 1) as SymPy matrices in symbols named like states and inputs.

        Numbers are as for `PersidskiiModel.to_sympy`.

        Raises:
            ImportError: SymPy is not installed; it comes with persid[interop].
        """
        from persid.models.exports.libraries import outputs_to_sympy

        return self.dynamics.to_sympy(exact), outputs_to_sympy(self.equation, exact)

    def to_casadi(self, name: str = "model") -> Any:
        """Return a casadi.Function (x, u) -> (x_dot, y) of scalar expressions (SX).

        Raises:
            ImportError: CasADi is not installed; it comes with persid[interop].
        """
        from persid.models.exports.libraries import outputs_to_casadi

        return outputs_to_casadi(self.equation, name)

    def to_latex(self, digits: int = 4) -> str:
        """Return the equations as one `aligned` environment, numbers rounded to so many significant digits."""
        from persid.models.exports.libraries import to_latex

        return to_latex(self.dynamics.field, digits, self.equation)

    def to_dict(self) -> Json:
        """Return the model as the object of its file."""
        return {
            "format": FORMAT,
            "dynamics": self.dynamics.to_dict(),
            "outputs": list(self.outputs),
            "C": self.C.tolist(),
            "D": self.D.tolist(),
            "d": self.d.tolist(),
            "output_map": None if self.output_map is None else [h.text for h in self.output_map],
            "hold": self.hold,
            **{name: _listed(getattr(self, name)) for name in ("noise", "x_mean", "x_cov")},
            "provenance": self.provenance,
        }

    @classmethod
    def from_dict(cls, data: object, folder: Path | None = None) -> "OutputModel":
        """Return the model of an object such as its file holds; unknown fields are refused."""
        if not isinstance(data, Mapping) or data.get("format") != FORMAT:
            raise ModelError(f'an output model has "format": "{FORMAT}"')
        unknown_fields(data, _FIELDS, {"dynamics", "outputs", "C"})
        values: Json = {name: data.get(name) for name in _FIELDS if name not in ("format", "dynamics")}
        texts = [*_texts("outputs", values["outputs"]), *_texts("output_map", values["output_map"])]
        if not all(isinstance(text, str) for text in texts):
            raise ModelError("outputs is a list of names, output_map null or a list of expressions")
        if not isinstance(values["provenance"], Mapping | None):
            raise ModelError("provenance is no object")
        return cls(PersidskiiModel.from_dict(data["dynamics"], folder), **values | {"hold": values["hold"] or "zoh"})

    def save(self, path: str | Path) -> None:
        """Write the model: reading it gives the same binary64 numbers back. Written beside, then renamed."""
        write_atomically(path, readable(self.to_dict()) + "\n")


def _lines(t: ndarray, u: Any) -> Callable[[float], ndarray]:
    """Return the input that runs in straight lines through samples."""
    return lambda s: np.array([np.interp(s, t, column) for column in u.T])


def _maps(given: str | Sequence[str | ScalarFunction] | None, count: int) -> tuple[ScalarFunction, ...] | None:
    if given is None:
        return None
    texts = [given] * count if isinstance(given, str) else list(given)
    if len(texts) != count:
        raise ModelError(f"output_map has {len(texts)} functions; needed is one, or one for each of {count} outputs")
    return tuple(scalar_function(text) for text in texts)


def _listed(given: ndarray | None) -> object:
    return None if given is None else given.tolist()


def _array(given: object) -> ndarray | None:
    return None if given is None else np.asarray(given, float)


def _texts(name: str, given: object) -> list[object]:
    if given is None or isinstance(given, str):
        return [] if given is None else [given]
    if not isinstance(given, list):
        raise ModelError(f"{name} is {str(given)[:60]}; needed is a list of texts")
    return given
