"""What a fit says about itself: figures, and warnings that a person can act on."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.free_runs import Score
from persid.identification.gram import Gram, condition_number
from persid.identification.koopman import ALIASING
from persid.identification.scores import Scores
from persid.identification.validation import Curve
from persid.measurements.recordings import Measurements

COLLINEAR = 0.99  # a correlation of two columns beyond that: the data determine their sum only
LARGE = 20.0
LAGS = 20


@dataclass(frozen=True)
class Excitation:
    """How an input moves: its deviation, number of changes, and the share that the other columns leave free."""

    name: str
    deviation: float
    changes: int
    free_share: float


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues of a Koopman matrix as pairs (real, imaginary), and the sampling step `dt` in s.

    An eigenvalue that turns more than `limit` (radians) a sample is refused: a faster and a slower turn look alike.
    """

    values: tuple[tuple[float, float], ...]
    dt: float
    limit: float = ALIASING * np.pi


@dataclass(frozen=True, repr=False)
class FitReport:
    """Figures of a fit. Scores are of a model fitted without the held-out tails; the delivered model uses all data.

    `condition_raw` and `condition_scaled` are condition numbers of the columns; `largest_coefficient` is in units of
    scaled columns (a column's contribution over that of the left side); `whiteness` holds for each state the largest
    autocorrelation of the one-step residual over 20 lags, and the 99 % bound of white noise; `coverage` is the box of
    the data; `spectrum` is that of the Koopman matrix, where the method has one.
    """

    method: str
    hold: str
    window: int | None
    rows: int
    columns: int
    rank: int
    ridge: float
    curve: Curve | None
    condition_raw: float
    condition_scaled: float
    largest_coefficient: float
    largest_name: str
    collinear: tuple[tuple[str, str, float], ...]
    constant_columns: tuple[str, ...]
    coverage: tuple[tuple[float, float], ...]
    whiteness: tuple[tuple[float, float], ...]
    excitation: tuple[Excitation, ...]
    free_run: Score | None
    one_step: Score | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    spectrum: Spectrum | None = None

    def __repr__(self) -> str:
        score = "not scored" if self.free_run is None else f"free run R2 {self.free_run.r2_mean:.4f}"
        said = f"{len(self.notes)} notes, {len(self.warnings)} warnings"
        return f"FitReport({self.method}, {self.rows} rows, {self.columns} columns, {score}, {said})"

    def __str__(self) -> str:
        rows = [
            ("estimator", f"{self.method}" + (f", windows of {self.window} samples" if self.window else "")),
            ("rows, columns, rank", f"{self.rows}, {self.columns}, {self.rank}"),
            ("ridge", f"{self.ridge:.3g}"),
            ("condition number", f"{self.condition_raw:.3g}, scaled {self.condition_scaled:.3g}"),
            ("largest coefficient", f"{self.largest_coefficient:.3g} (scaled), at {self.largest_name}"),
            ("free run, held out", _score_text(self.free_run)),
            ("one step, held out", _score_text(self.one_step)),
            *(("note", text) for text in self.notes),
            *(("warning", text) for text in self.warnings),
        ]
        return "\n".join(f"{name:<20} {value}" for name, value in rows)


def _score_text(score: Score | None) -> str:
    if score is None:
        return "none (the runs are too short)"
    blown = f", {score.blow_ups} of {len(score.diverged_at)} runs blow up" if score.blow_ups else ""
    return f"RMSE {score.rmse:.4g}, R2 pooled {score.r2:.4f}, mean over states {score.r2_mean:.4f}{blown}"


@dataclass(frozen=True, eq=False)
class Conditioning:
    """What the Gram matrix and the coefficients alone tell."""

    rank: int
    raw: float
    scaled: float
    collinear: tuple[tuple[str, str, float], ...]
    constant: tuple[str, ...]
    largest: float
    largest_name: str


def conditioning(gram: Gram, theta: Float[ndarray, "p n"]) -> Conditioning:
    """Return rank, condition numbers, collinear pairs, columns that do not vary and the largest scaled coefficient."""
    columns, scaled = gram.basis.columns, gram.scaled
    e = np.linalg.eigvalsh(scaled)
    rank = int((e > np.finfo(float).eps * len(e) * e[-1]).sum())
    constant = tuple(c.name for c, w in zip(columns[:-1], gram.weights[:-1], strict=True) if w == 0)
    sizes = np.sqrt(np.maximum(gram.yy, np.finfo(float).tiny) / max(gram.rows, 1))
    share = np.abs(theta) * gram.weights[:, None] / sizes
    j, i = np.unravel_index(int(share.argmax()), share.shape)
    state = gram.basis.states[i]
    name = f"{columns[j].name} in " + (f"d({state})/dt" if gram.basis.dt is None else f"{state}[k+1]")
    return Conditioning(
        rank=rank,
        raw=condition_number(gram.G),
        scaled=condition_number(scaled),
        collinear=_collinear(gram),
        constant=constant,
        largest=float(share[j, i]),
        largest_name=name,
    )


def _collinear(gram: Gram) -> tuple[tuple[str, str, float], ...]:
    """Pairs of columns whose correlation about the constant exceeds 0.99, the worst first; at most ten."""
    keep = np.flatnonzero(gram.weights > 0)
    g = gram.G[:, -1] / max(gram.G[-1, -1], np.finfo(float).tiny)
    C = (gram.G - np.outer(g, gram.G[-1]))[np.ix_(keep, keep)]
    d = np.sqrt(np.maximum(np.diag(C), np.finfo(float).tiny))
    R = np.triu(C / np.outer(d, d), 1)
    pairs = np.argwhere(np.abs(R) > COLLINEAR)
    pairs = pairs[np.argsort(-np.abs(R[tuple(pairs.T)]))][:10]
    names = [column.name for column in gram.basis.columns]
    return tuple((names[keep[a]], names[keep[b]], float(R[a, b])) for a, b in pairs)


def excitation(data: Measurements, gram: Gram) -> tuple[Excitation, ...]:
    """Return for each input how it moves and how much of it is no function of the other columns."""
    names = [column.name for column in gram.basis.columns]
    free = _free_share(gram)
    u = data.moments.of(slice(len(data.states), None))
    p = gram.basis.state_columns
    return tuple(
        Excitation(names[p + k], float(u.deviation[k]), int(u.changes[k]), float(free[p + k]))
        for k in range(len(data.inputs))
    )


def _free_share(gram: Gram) -> ndarray:
    """1/VIF of every column: the share of its variance that a regression on all others leaves; 0 if constant."""
    keep = np.flatnonzero(gram.weights > 0)
    share = np.zeros(len(gram.weights))
    g = gram.G[:, -1] / max(gram.G[-1, -1], np.finfo(float).tiny)
    C = (gram.G - np.outer(g, gram.G[-1]))[np.ix_(keep, keep)]
    d = np.sqrt(np.maximum(np.diag(C), np.finfo(float).tiny))
    # Not the pseudoinverse: it would call a column that is a combination of others free.
    inverse = np.linalg.inv(C / np.outer(d, d) + 1e-12 * np.eye(len(d)))
    share[keep] = np.clip(1 / np.maximum(np.diag(inverse), 1.0), 0, 1)
    return share


def koopman_spectrum(K: Float[ndarray, "l l"], dt: float) -> Spectrum:
    """Return the eigenvalues of a Koopman matrix, the largest first; dt is the sampling step in s."""
    values = np.linalg.eigvals(K)
    values = values[np.argsort(-np.abs(values), kind="stable")]
    return Spectrum(tuple((float(k.real), float(k.imag)) for k in values), dt)


def whiteness(residual: Float[ndarray, "N n"]) -> tuple[tuple[float, float], ...]:
    """Return, per state, the largest autocorrelation over 20 lags and the 99 % bound of white noise."""
    r = residual - residual.mean(axis=0)
    power = np.maximum((r**2).sum(axis=0), np.finfo(float).tiny)
    lags = range(1, min(LAGS, len(r) - 1) + 1)
    largest = np.max([np.abs((r[k:] * r[:-k]).sum(axis=0)) / power for k in lags], axis=0)
    bound = 3.5 / np.sqrt(len(r))  # the 99 % quantile of the largest of 20 standard normals in absolute value
    return tuple((float(value), float(bound)) for value in largest)


def remarks(
    facts: Conditioning, columns: int, moved: tuple[Excitation, ...], foretold: Scores | None, curve: Curve | None
) -> tuple[str, ...]:
    """Return warnings, each with what to try; `foretold` are scores on held-out data where they may be poor."""
    found = []
    if facts.rank < columns - len(facts.constant):
        found.append(
            f"rank {facts.rank} of {columns} columns: the data do not determine the model; use fewer functions"
        )
    if facts.constant:
        found.append(f"{', '.join(facts.constant)} never varies in the data; its coefficient is set to 0")
    if facts.largest > LARGE:
        found.append(
            f"the coefficient of {facts.largest_name} is {facts.largest:.0f} times what it adds up to: "
            "terms cancel; raise ridge= or use fewer functions"
        )
    if facts.collinear:
        a, b, r = facts.collinear[0]
        found.append(f"{a} and {b} are nearly the same on these data (correlation {r:.5f}); their split is arbitrary")
    for item in moved:
        if item.deviation > 0 and item.free_share < 1e-3:
            found.append(
                f"input {item.name} is almost a function of the states (feedback?); its effect is not identifiable"
            )
    ahead = None if foretold is None else foretold.headline
    if ahead is not None and ahead.blow_ups:
        found.append(
            f"{ahead.blow_ups} of {ahead.runs} free runs over {ahead.length} on held-out data blow up; a larger ridge="
            ", other functions or a fit under the certificate may hold them"
        )
    elif ahead is not None and ahead.r2_mean < 0:
        inputs = "" if moved else "; what acts from outside and was measured belongs among the inputs"
        found.append(
            f"over {ahead.length} free runs on held-out data are worse than the mean; see the functions, x_ref and the "
            f"window{inputs}"
        )
    if curve is not None and curve.best == curve.strengths[-1]:
        found.append("the largest ridge is best: the functions explain little; try others")
    return tuple(found)
