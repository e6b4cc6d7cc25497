"""Trajectory: one sampled run of a system, measured or simulated; and several of them as they come from tables."""

from dataclasses import dataclass

from jaxtyping import Float
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One run: times in s, states and inputs, row k of each belonging to time t[k].

    Under a zero-order hold u[k] acts from t[k] to t[k+1]; the last one is unused. `diverged_at` is the time in s at
    which a simulated run left the range of representable states, None when it did not; `stopped_at` the time at which
    its budget of computation was used up with the state still bounded (a model that is too fast or too stiff).

    Examples:
        >>> run = ps.Trajectory(np.array([0.0, 0.1]), np.array([[1.0], [0.9]]), np.zeros((2, 1)))
        >>> run.x.shape, run.diverged_at
        ((2, 1), None)
    """

    t: Float[ndarray, " N"]
    x: Float[ndarray, "N n"]
    u: Float[ndarray, "N m"]
    diverged_at: float | None = None
    stopped_at: float | None = None

    def __repr__(self) -> str:
        sizes = f"{len(self)} samples, {self.x.shape[1]} states, {self.u.shape[1]} inputs"
        return f"Trajectory({sizes}, t = {self.t[0]:g} ... {self.t[-1]:g} s)" if len(self) else f"Trajectory({sizes})"

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, rows: slice) -> "Trajectory":
        """Return the consecutive samples of a slice as a run of their own."""
        return Trajectory(self.t[rows], self.x[rows], self.u[rows])


@dataclass(frozen=True, eq=False)
class Runs:
    """What is read from tables: runs, the names of their states and inputs, and the repairs made while reading."""

    runs: tuple[Trajectory, ...]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    notes: tuple[str, ...]
