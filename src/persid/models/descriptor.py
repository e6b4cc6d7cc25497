"""DescriptorModel: states with derivatives and variables with equations, in one generalized Persidskii form."""

from collections.abc import Mapping, Sequence
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
from persid.models.arguments import distinct_names, finite_array, plain_model, sampled_input
from persid.models.channels import Channels
from persid.models.elimination import Equations, integrate
from persid.models.model import Input, PersidskiiModel
from persid_check.canonical import canonical_model
from persid_check.model import ALGEBRAIC, sha256_of


@dataclass(frozen=True, eq=False)
class DescriptorModel:
    """A model with algebraic variables, in the user's units; time in s.

        (x', 0) = A0 (z - z_ref) + sum A f(R (z - z_ref)) + B (u - u_ref) + b,     z = (x, w)

    The states x come first, then the algebraic variables w, whose rows are equations. Nothing is solved for w in the
    model's numbers. `rows` holds the right side as it stands, of all variables alike.

    Args:
        rows: the right side, a PersidskiiModel over all variables; or A0, and then what makes it one.
        algebraic: the names of the algebraic variables, or how many there are.
        states: the names of the states.
        more: terms, B, b, x_ref (of all variables), u_ref, inputs, domain and provenance, as of PersidskiiModel.

    Raises:
        ModelError: shapes do not fit, there is no algebraic variable or no state, or the rows are in discrete time.

    Examples:
        A saturation in a loop, w = tanh(x - 0.5 w), that drives x' = -x - w + u:

        >>> A0, loop = [[-1.0, -1.0], [0.0, -1.0]], ("tanh(x)", [[1.0, -0.5]], [[0.0], [1.0]])
        >>> model = ps.DescriptorModel(A0, [loop], [[1.0], [0.0]], algebraic=["w"])
        >>> ps.certify(model).is_certified
        True
    """

    rows: PersidskiiModel
    algebraic: tuple[str, ...]

    def __init__(
        self, rows: object = None, terms: Sequence[object] = (), B: object = None, *, algebraic: Sequence[str] | int,
        states: Sequence[str] | None = None, **more: Any,
    ) -> None:  # fmt: skip
        if not isinstance(rows, PersidskiiModel):
            rows = PersidskiiModel(rows, terms, B, **more)
        elif terms or B is not None or more:
            raise ModelError("rows is a whole model already; give nothing beside it but the names")
        if rows.is_discrete or rows.is_sparse:
            raise ModelError("a model with algebraic variables is in continuous time, and has no sparse matrices")
        k = algebraic if isinstance(algebraic, int) else len(algebraic)
        if not 0 < k < rows.n:
            raise ModelError(f"{k} of {rows.n} variables are algebraic; needed is at least one, and one state")
        names = rows.states[rows.n - k :] if isinstance(algebraic, int) else tuple(algebraic)
        if states is None and rows.states == tuple(f"x{i + 1}" for i in range(rows.n)) and isinstance(algebraic, int):
            names = tuple(f"w{i + 1}" for i in range(k))
        listed = distinct_names("states and algebraic", [*(states or rows.states[: rows.n - k]), *names], rows.n)
        object.__setattr__(self, "rows", renamed(rows, listed))
        object.__setattr__(self, "algebraic", listed[rows.n - k :])

    def __eq__(self, other: object) -> bool:
        """Whether both are the same model, number for number; provenance does not count."""
        return self.sha256 == other.sha256 if isinstance(other, DescriptorModel) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sha256)

    def __repr__(self) -> str:
        return f"DescriptorModel(states {self.states}, algebraic variables {self.algebraic}, inputs {self.inputs})"

    @property
    def n(self) -> int:
        """Number of states."""
        return self.rows.n - len(self.algebraic)

    @property
    def m(self) -> int:
        """Number of inputs."""
        return self.rows.m

    @property
    def states(self) -> tuple[str, ...]:
        """The names of the states."""
        return self.rows.states[: self.n]

    @property
    def variables(self) -> tuple[str, ...]:
        """The names of all variables, states first."""
        return self.rows.states

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the inputs."""
        return self.rows.inputs

    @property
    def x_ref(self) -> Float[ndarray, " n"]:
        """The reference of the states, in their units."""
        return np.asarray(self.rows.x_ref[: self.n])

    @property
    def u_ref(self) -> Float[ndarray, " m"]:
        """The reference of the inputs, in their units."""
        return np.asarray(self.rows.u_ref)

    @property
    def b(self) -> Float[ndarray, " N"]:
        """The constants of all rows."""
        return np.asarray(self.rows.b)

    @property
    def channels(self) -> Channels:
        """The scalar channels of all rows."""
        return self.rows.channels

    @property
    def is_discrete(self) -> bool:
        """False: time is continuous."""
        return False

    @property
    def dt(self) -> None:
        """None: there are no steps."""
        return

    @property
    def provenance(self) -> Json:
        """What the model was made from; never used in a proof."""
        return self.rows.provenance

    @cached_property
    def _equations(self) -> Equations:
        return Equations.of(self.rows.field, self.n)

    def solve(self, x: object, u: object = None, near: object = None) -> Float[ndarray, " k"]:
        """Return the algebraic variables at a state and an input (None: u_ref), by Newton's method.

        `near` is where it sets out, by default their reference.

        Raises:
            ModelError: no solution is found.
        """
        x = finite_array("x", x, (self.n,))
        u = self.u_ref if u is None else finite_array("u", u, (self.m,))
        near = self.rows.x_ref[self.n :] if near is None else finite_array("near", near, (len(self.algebraic),))
        w = self._equations.solved(x, np.asarray(u), near)
        if w is None:
            raise ModelError(f"no solution of the equations was found at x = {x.tolist()} and u = {u.tolist()}")
        return w

    def rhs(self, x: object, u: object = None) -> Float[ndarray, " n"]:
        """Return x' in state units per s, the algebraic variables solved for; u = None means u_ref.

        Raises:
            ModelError: no solution of the equations is found.
        """
        z = np.concatenate([np.asarray(x, float), self.solve(x, u)])
        return np.asarray(self.rows.rhs(z, None if u is None else np.asarray(u, float))[: self.n])

    def jacobian(self, z: Float[ndarray, " N"]) -> Float[ndarray, "n n"]:
        """Return the derivatives of x' by x in 1/s at variables that solve the equations: J_xx - J_xw J_ww^-1 J_wx.

        Entries are infinite where J_ww is singular.
        """
        J, n = np.asarray(self.rows.jacobian(z)), self.n
        following = self.following(z)
        return (
            np.asarray(J[:n, :n] + J[:n, n:] @ following) if np.isfinite(following).all() else np.full((n, n), np.inf)
        )

    def following(self, z: Float[ndarray, " N"]) -> Float[ndarray, "k n"]:
        """Return the derivatives of w by x at variables that solve the equations, infinite where J_ww is singular."""
        J, n = np.asarray(self.rows.jacobian(z)), self.n
        try:
            return np.asarray(-np.linalg.solve(J[n:, n:], J[n:, :n]))
        except np.linalg.LinAlgError:
            return np.full((len(self.algebraic), n), np.inf)

    def simulate(
        self, x0: object, t: Float[ndarray, " N"], u: Input = None, *, near: object = None, rtol: float = 1e-8,
        atol: float = 1e-10,
    ) -> Trajectories:  # fmt: skip
        """Integrate from x0 and return all variables at the times t (s), those of the equations behind the states.

        Newton's method solves the equations in each evaluation of x', from where it solved them last. A run ends early
        with `diverged_at` where the state does, and with `stopped_at` before a step in which no solution of the
        equations is found, or where the model is too fast to be followed.

        Args:
            x0: the state (n,).
            t: increasing times in s.
            u: (N, m), held from each sample to the next, or a function of t, or None for u_ref.
            near: algebraic variables near those at the start, by default their reference.
            rtol: relative tolerance of the integration.
            atol: absolute tolerance of the integration.

        Raises:
            ModelError: an argument has the wrong shape, or the equations have no solution at the start.
        """
        x0, t = finite_array("x0", x0, (self.n,)), np.array(t, float)
        given = sampled_input(t, u, self.m)
        first = self.rows.field.sampled(t[:1], given[:1] if isinstance(given, ndarray) else given)[0]
        start = np.concatenate([x0, self.solve(x0, first, near)])
        run = integrate(self._equations, start, t, given, (rtol, atol))
        return Trajectories((run,), self.variables, self.inputs)

    def to_dict(self) -> Json:
        """Return the model as the object of `model.json`."""
        data = {**self.rows.to_dict(), "states": list(self.states)}
        return {**{k: data[k] for k in ("format", "states")}, ALGEBRAIC: list(self.algebraic), **data}

    @classmethod
    def from_dict(cls, data: object, folder: Path | None = None) -> "DescriptorModel":
        """Return the model of an object such as `model.json` holds; unknown fields are refused."""
        if not isinstance(data, Mapping) or ALGEBRAIC not in data:
            raise ModelError('a model with algebraic variables has a list of their names, "algebraic"')
        names = data[ALGEBRAIC]
        if not isinstance(names, list) or not isinstance(data.get("states"), list):
            raise ModelError("states and algebraic are lists of names")
        if not names:
            raise ModelError("algebraic needs at least one name; a model without equations leaves the field out")
        whole = {name: value for name, value in data.items() if name != ALGEBRAIC}
        rows = PersidskiiModel.from_dict({**whole, "states": [*data["states"], *names]}, folder)
        return cls(rows, algebraic=names)

    @classmethod
    def from_canonical(cls, form: Mapping[str, object]) -> "DescriptorModel":
        """Return the model of a canonical form."""
        return cls.from_dict(plain_model(dict(form)))

    @cached_property
    def canonical(self) -> Json:
        """The form that proofs hold and that is hashed: numbers as hexadecimal floats."""
        return canonical_model(self.to_dict())

    @cached_property
    def sha256(self) -> str:
        """SHA-256 over the canonical JSON of the model (hexadecimal floats, without provenance)."""
        return sha256_of(self.canonical)

    def save(self, path: str | Path) -> None:
        """Write `model.json`: reading it gives the same binary64 numbers back. Written beside, then renamed."""
        write_atomically(path, readable(self.to_dict()) + "\n")


def renamed(model: PersidskiiModel, states: Sequence[str]) -> PersidskiiModel:
    """Return a model with other names of its variables."""
    return PersidskiiModel.from_dict({**model.to_dict(), "states": list(states)})
