"""Advice: what is wrong where a model foretells little, found by trying the usual remedies on the held-out part.

Every remedy is a fit of its own, made without the held-out part and scored on it like the fit in question, by the same
horizon and for the states that were measured. The work is bounded: beginnings of the runs, and one fit a remedy.
"""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from sklearn.base import clone

from persid.errors import PersidError
from persid.identification import suspicions
from persid.identification.derivatives import embedded, velocity_names
from persid.identification.identifier import PersidskiiIdentifier
from persid.identification.increments import best_product, dead_times
from persid.identification.koopman import sample_step
from persid.identification.options import HOLDS
from persid.identification.outputs.answer import answered
from persid.identification.outputs.selection import Question
from persid.identification.scores import Ahead, HeldOut, Record, Scores, held_out_scores, hold_out
from persid.identification.windows import choose_window
from persid.measurements.recordings import Measurements, beginnings, without_still_inputs
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory

GOOD = 0.1  # error over the record's deviation, R2 of .99: better fits are not questioned
NOISE = 2.0  # times the noise of the record: nor are fits as good as that
DOUBTFUL = 0.2  # a larger error is questioned in any case: what looks like noise may be faster than the samples
HELPS = 0.7  # of the error is left, at most, where a remedy is named
LONGEST, MOST_RUNS = 4000, 20  # samples and runs that are tried on
AS_WELL = 1.1  # times the error of a good fit: fewer functions that foretell so well are named
MOST_TRIED = 40  # functions of all states: more are not tried with fewer
MOST_STATES = 20  # with what a remedy appends
MOST_COLUMNS = 200  # a larger basis is not fitted again and again
HIDDEN_SAMPLES, MOST_HIDDEN = 2000, 6  # of a run, of at most so many, and so many hidden states, for a trial of them
PAST = 3  # delayed copies that tell whether the past helps
FEEDBACK = 0.05  # share of an input that the states leave free
DELAYED = re.compile(r".*\(t-\d+\)")


@dataclass(frozen=True)
class Advice:
    """One thing to do or to know: its `kind`, and `what` it is in words.

    `options` are those of the command line, `call` is the same in Python; both are empty where there is none. `r2` and
    `error` (over the deviation of the record) were measured on the held-out part; None where nothing was to be tried.

    Examples:
        >>> print(ps.Advice("velocity", "smoothed velocities among the states", r2=0.999))
        R2 0.9990: smoothed velocities among the states
    """

    kind: str
    what: str
    options: tuple[tuple[str, str], ...] = ()
    call: str = ""
    r2: float | None = None
    error: float | None = None

    def __str__(self) -> str:
        return said(self, self.call)


def said(advice: Advice, how: str) -> str:
    """Return an advice as one line, with the words to type."""
    score = "" if advice.r2 is None else f"R2 {advice.r2:.4f}: "
    return f"{score}{advice.what}" + (f": {how}" if how else "")


@dataclass(frozen=True)
class Diagnosis:
    """What the usual remedies give on held-out data, the best first, and what the measurements themselves tell.

    `r2` and `error` are those of the fit in question over the horizon `ahead`; None where it was not questioned.
    `tried` counts the remedies that were fitted.

    Examples:
        >>> print(ps.Diagnosis())
        nothing to mend: the fit foretells what was held out
    """

    r2: float | None = None
    error: float | None = None
    ahead: str = ""
    tried: int = 0
    remedies: tuple[Advice, ...] = ()
    findings: tuple[Advice, ...] = ()

    def __str__(self) -> str:
        if self.r2 is None:
            return "nothing to mend: the fit foretells what was held out" if not self.findings else _lines(self)
        return f"R2 {self.r2:.4f} over {self.ahead}; remedies tried: {self.tried}\n{_lines(self)}".rstrip()


def _lines(diagnosis: Diagnosis) -> str:
    return "\n".join(f"  {advice}" for advice in (*diagnosis.remedies, *diagnosis.findings))


@dataclass(frozen=True, eq=False)
class _Trial:
    """A remedy that can be tried: what is said of it, the estimator and the data."""

    advice: Advice
    fit: PersidskiiIdentifier
    data: Trajectories


def advise(
    fit: PersidskiiIdentifier,
    data: Measurements,
    scores: Scores | None = None,
    progress: Callable[[str], None] | None = None,
    test: Trajectories | None = None,
) -> Diagnosis:
    """Try the usual remedies where a fitted PersidskiiIdentifier foretells little; say what each gives.

    Of a fit that foretells what was held out it says whether fewer functions do so, too. One of more than 200 columns
    is left alone.

    Args:
        fit: the fitted estimator.
        data: the measurements that it was fitted to.
        scores: its scores on held-out data, where they are known.
        progress: is called with a line of text.
        test: measurements that were kept from the fit; remedies then are fitted to all of `data` and judged by these.

    Examples:
        >>> data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> print(ps.advise(ps.PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-4).fit(data), data))
        nothing to mend: the fit foretells what was held out
    """
    if fit.time == "discrete":
        steps = Advice("steps", "in discrete time no remedies are tried; a fit in continuous time would be")
        return Diagnosis() if _is_good(fit, scores) else Diagnosis(findings=(steps,))
    looked_at = without_still_inputs(beginnings(data, LONGEST, MOST_RUNS))
    kept = () if test is None else beginnings(test.with_inputs(looked_at.inputs), LONGEST, MOST_RUNS).runs
    both = Trajectories((*looked_at, *kept), looked_at.states, looked_at.inputs)
    work = embedded(both, fit.derivatives, fit.delays)
    base = fit.on_appended()
    codes = list(suspicions.missing_codes(looked_at))
    if not codes and _is_good(fit, scores):
        return Diagnosis(findings=tuple(_fewer(base, work, len(kept), None)))
    if fit.basis_.size > MOST_COLUMNS:
        return Diagnosis(findings=tuple(_coded(codes)))
    before = _foretold(base, work, None, len(kept))
    if before is None:
        return Diagnosis(findings=tuple(_coded(codes)))
    record, ahead = before
    here = _measured(work)
    r2, error = _figures(ahead, here)
    if not codes and error <= _enough(record.floor):
        return Diagnosis(findings=tuple(_fewer(base, work, len(kept), before)))
    # where the fit was scored on more than is looked at here, a remedy has to do better than that, too
    known = scores.headline.error if scores is not None and scores.unseen else np.inf
    trials = _codes(base, work, codes) if codes else _trials(base, work, fit)
    found: list[Advice] = []
    count = 0
    for trial in trials:
        if kept and len(trial.data) != len(work):  # it cuts runs, and which of them were kept is lost
            continue
        count += 1
        if progress is not None:
            progress(f"trying remedies: {trial.advice.what}")
        like = None if codes or trial.advice.kind in suspicions.THIN else record
        outcome = _foretold(trial.fit, trial.data, like, len(kept))
        if outcome is not None:
            mine, left = _figures(outcome[1], _measured(trial.data))
            calmer = outcome[1].blow_ups <= ahead.blow_ups
            if codes or (calmer and left < HELPS * min(error, known)):
                found.append(replace(trial.advice, r2=mine, error=left))
    found.sort(key=lambda advice: advice.error if advice.error is not None else np.inf)
    findings = _coded(codes) if codes else list(_findings(base, work, fit, found))
    return Diagnosis(r2, error, ahead.length, count, tuple(found), tuple(findings))


def _is_good(fit: PersidskiiIdentifier, scores: Scores | None) -> bool:
    """Whether scores that are known already leave nothing to ask."""
    if scores is not None and scores.unseen:
        return scores.headline.error <= _enough(scores.floor) and not scores.doubts
    free = fit.report_.free_run
    return free is not None and not free.blow_ups and min(free.r2_states) >= 1 - GOOD**2


def _enough(floor: float) -> float:
    """Return the error that is not questioned, where the noise alone makes `floor`."""
    return max(GOOD, min(NOISE * floor, DOUBTFUL))


def _measured(data: Trajectories) -> list[int]:
    """Return the places of the states that were measured, not appended."""
    velocities = velocity_names(data.states).values()
    return [k for k, name in enumerate(data.states) if name not in velocities and not DELAYED.fullmatch(name)]


def _figures(ahead: Ahead, places: Sequence[int]) -> tuple[float, float]:
    """Return R2, and error over deviation, of some states together."""
    r2 = np.array([ahead.r2[k] for k in places])
    return float(r2.mean()), float(np.sqrt(np.maximum(1 - r2, 0).mean()))


def _parts(data: Trajectories, kept: int) -> HeldOut | None:
    """Hold out a part of the measurements: the last runs, so many as were kept from the fit, or else what is usual."""
    if not kept:
        return hold_out(data)
    first, last = (Trajectories(runs, data.states, data.inputs) for runs in (data.runs[:-kept], data.runs[-kept:]))
    return HeldOut(first, last, tuple(run[:0] for run in last), "what was kept from the fit")


def _foretold(
    fit: PersidskiiIdentifier, data: Trajectories, like: Record | None, kept: int = 0
) -> tuple[Record, Ahead] | None:
    """Fit without the held-out part and score on it, over the horizon of another record; None where it cannot be."""
    parts = _parts(data, kept)
    if parts is None:
        return None
    record = Record.of(data)
    record = record if like is None else replace(record, memory=like.memory)
    try:
        model = clone(fit).fit(parts.train).model_
        held = parts.held.with_inputs(model.inputs)
        scores = held_out_scores(model, held, record, hold=fit.hold, basis=parts.basis, before=parts.before)
        return record, scores.headline
    except (PersidError, ValueError, np.linalg.LinAlgError):  # no logarithm, uneven times, too little data
        return None


def _fewer(
    base: PersidskiiIdentifier, data: Trajectories, kept: int, before: tuple[Record, Ahead] | None
) -> Iterator[Advice]:
    """Yield the fewest functions that foretell as well as those of a good fit: x alone, or x and one more.

    `before` is how that fit foretells, where it is known.
    """
    given = base.functions
    if len(given) * len(data.states) > MOST_TRIED or not all(isinstance(f, str) for f in given) or "x" not in given:
        return
    others = [str(f) for f in given if f != "x"]
    sizes = [[["x"]], [["x", f] for f in others]][: len(given) - 1]
    before = before or (_foretold(base, data, None, kept) if sizes else None)
    if before is None:
        return
    record, here = before[0], _measured(data)
    enough = AS_WELL * _figures(before[1], here)[1]
    for size in sizes:
        tried = [(f, _foretold(clone(base).set_params(functions=f), data, record, kept)) for f in size]
        left = [(_figures(outcome[1], here), f) for f, outcome in tried if outcome is not None]
        (r2, error), functions = min(left, key=lambda one: one[0][1], default=((0.0, np.inf), size[0]))
        if error <= enough:
            what = f"{' and '.join(functions)} {'alone foretells' if len(functions) == 1 else 'foretell'} as well"
            options = (("--functions", ",".join(functions)),)
            yield Advice("fewer", what, options, _with(f"functions={json.dumps(functions)}"), r2, error)
            return


def _trials(base: PersidskiiIdentifier, data: Trajectories, fit: PersidskiiIdentifier) -> Iterator[_Trial]:
    """Yield the usual remedies for a fit."""
    n, nested = len(data.states), not all(isinstance(f, str) for f in base.functions)
    if len(_measured(data)) == n and not nested:
        yield from _appending(base, data)
        yield from _leaving_out(base, data)
    if (rival := base._estimator.rival) is not None:
        for functions in dict.fromkeys([tuple(map(_hashable, base.functions)), ("x",)]):
            listed = [list(f) if isinstance(f, tuple) else f for f in functions]
            more = () if listed == list(base.functions) else (("--functions", "x"),)
            call = ", ".join([f'method="{rival}"', *(['functions=["x"]'] if more else [])])
            what = "a map from sample to sample, for what settles within one" + (", x alone" if more else "")
            other = clone(base).set_params(method=rival, functions=listed, window="auto", ridge="auto")
            yield _Trial(Advice(rival, what, (("--method", rival), *more), _with(call)), other, data)
    if data.inputs:
        hold = HOLDS[1 - HOLDS.index(base.hold)]
        what = "inputs that vary between samples" if hold == "paper" else "inputs held from sample to sample"
        other = clone(base).set_params(hold=hold)
        yield _Trial(Advice("hold", what, (("--hold", hold),), _with(f'hold="{hold}"')), other, data)
        yield from _late(base, data, fit)
    for one in suspicions.thin_stretches(data):
        every = int(one.number)
        runs = tuple(run[_first_new(run) :: every] for run in data)
        if min(map(len, runs)) > 2:
            thin = Trajectories(runs, data.states, data.inputs)
            yield _Trial(Advice(one.kind, f"{one.text}; keep every {suspicions.nth(every)} row alone"), base, thin)


def _hashable(function: str | Sequence[str]) -> str | tuple[str, ...]:
    return function if isinstance(function, str) else tuple(function)


def _with(call: str) -> str:
    return f"fit.set_params({call}).fit(data)"


def _appending(base: PersidskiiIdentifier, data: Trajectories) -> Iterator[_Trial]:
    """Yield states that are appended: velocities, the past."""
    n = len(data.states)
    if 2 * n <= MOST_STATES:
        advice = Advice(
            "velocity", "smoothed velocities among the states", (("--derivatives", "1"),), _with("derivatives=1")
        )
        smoothed = clone(base).set_params(velocities=velocity_names(data.states))
        yield from _prepared(advice, smoothed, data, lambda: embedded(data, 1, 0))
    if (1 + PAST) * n <= MOST_STATES:
        advice = Advice("past", "delayed copies among the states", (("--delays", str(PAST)),), _with(f"delays={PAST}"))
        yield from _prepared(advice, base, data, lambda: embedded(data, 0, PAST))


def _prepared(
    advice: Advice, fit: PersidskiiIdentifier, data: Trajectories, make: Callable[[], Trajectories]
) -> Iterator[_Trial]:
    try:
        yield _Trial(advice, fit, make())
    except PersidError:  # uneven times, runs too short
        return


def _leaving_out(base: PersidskiiIdentifier, data: Trajectories) -> Iterator[_Trial]:
    """Yield fits without a state that is made of others."""
    for one in suspicions.differences(data):
        rest = [name for name in data.states if name != one.column]
        kept = [data.states.index(name) for name in rest]
        runs = tuple(replace(run, x=run.x[:, kept]) for run in data)
        less = Trajectories(runs, tuple(rest), data.inputs)
        velocity = one.kind == "differenced"
        options = (("--states", ",".join(rest)), *((("--derivatives", "1"),) if velocity else ()))
        more = f"; leave {one.column} out" + (", and let velocities be smoothed" if velocity else "")
        call = f"states={rest!r} in the reader" + (", fit.set_params(derivatives=1)" if velocity else "")
        advice = Advice(one.kind, one.text + more, options, call)
        fit = clone(base).set_params(velocities=velocity_names(rest)) if velocity else base
        yield from _prepared(advice, fit, data, lambda d=less, v=velocity: embedded(d, int(v), 0))  # type: ignore[misc]


def _late(base: PersidskiiIdentifier, data: Trajectories, fit: PersidskiiIdentifier) -> Iterator[_Trial]:
    """Yield inputs that act later than they are recorded."""
    window = fit.report_.window or choose_window(data)
    if fit.basis_.states != data.states or fit.basis_.inputs != data.inputs or min(map(len, data)) < 4 * window:
        return
    late = dead_times(data, fit.basis_, window)
    if late:
        words = ",".join(f"{name}={seconds:.6g}" for name, seconds in late.items())
        what = f"dead time, {', '.join(f'{name} acts {s:.4g} s later' for name, s in late.items())}"
        rounded = {name: float(f"{seconds:.6g}") for name, seconds in late.items()}
        advice = Advice("dead-time", what, (("--delay", words),), f"fit.fit(data.delayed({rounded}))")
        yield from _prepared(advice, base, data, lambda: data.delayed(rounded))


def _first_new(run: Trajectory) -> int:
    """Return the first sample that differs from the one before it."""
    new = np.flatnonzero(np.any(np.diff(run.x, axis=0), axis=1))
    return int(new[0]) + 1 if len(new) else 0


def _coded(codes: Sequence[suspicions.Suspicion]) -> list[Advice]:
    return [Advice(one.kind, one.text) for one in codes]


def _codes(base: PersidskiiIdentifier, data: Trajectories, codes: Sequence[suspicions.Suspicion]) -> Iterator[_Trial]:
    """Yield the fit without samples that hold a code for missing."""
    values = sorted({one.number for one in codes})
    runs = []
    for run in data:
        good = ~np.isin(np.hstack([run.x, run.u]), values).any(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
        runs += [run[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= 2]
    words = ",".join(f"{value:g}" for value in values)
    what = f"{words} {'means' if len(values) == 1 else 'mean'} missing"
    options = (("--na", words), ("--missing", "split"))
    call = f'na=[{words}], missing="split" in the reader'
    if runs:
        yield _Trial(Advice("missing", what, options, call), base, Trajectories(tuple(runs), data.states, data.inputs))


def _findings(
    base: PersidskiiIdentifier, data: Trajectories, fit: PersidskiiIdentifier, found: Sequence[Advice]
) -> Iterator[Advice]:
    """Yield what no option mends, or what was not tried."""
    suspected = [*suspicions.sensor_limits(data), *suspicions.thin_stretches(data)]
    yield from (Advice(one.kind, one.text) for one in suspected if one.kind not in {a.kind for a in found})
    for moved in fit.report_.excitation:
        if moved.deviation > 0 and moved.free_share < FEEDBACK:
            share = 100 * (1 - moved.free_share)
            yield Advice(
                "feedback",
                f"{moved.name} is {share:.1f} % a function of the states (feedback): what it does can hardly be told "
                "from what they do; move it, or the set point, by a test signal of its own",
            )
    whole = fit.basis_.states == data.states and fit.basis_.inputs == data.inputs
    if found_product := whole and best_product(data, fit.basis_, fit.report_.window or choose_window(data)):
        product, left, without = found_product
        what = (
            f"the product {product} would explain much of what is left: of the squared moves over windows "
            f"{100 * left:.2g} % stay with it, {100 * without:.2g} % without it; a generalised Persidskii model has no "
            "products: other coordinates (logarithms, a ratio) may turn it into a sum"
        )
        yield Advice("product", what)
    elif found and found[0].kind == "past":
        names = ",".join(data.states)
        r2, error, tried = _hidden(data, base.hold)
        yield Advice(
            "outputs",
            "the past tells more than the present and the velocities: part of the state is hidden, and "
            f"OutputIdentifier finds it from what was measured{tried}",
            (("--outputs", names),),
            "ps.OutputIdentifier().fit(data)",
            r2,
            error,
        )


def _hidden(data: Trajectories, hold: str) -> tuple[float | None, float | None, str]:
    """Fit a linear model with hidden states; return R2 and error of its free run over unseen samples, and words."""
    order = min(PAST * len(data.states), MOST_HIDDEN)
    question = Question(order, 0, hold="zoh" if hold == "zoh" else "foh", seeds=(0,))
    records = [(run.u[:HIDDEN_SAMPLES], run.x[:HIDDEN_SAMPLES]) for run in data][:MOST_HIDDEN]
    try:
        error = answered(records, sample_step(data), question).candidate.held_out
    except (PersidError, ValueError, np.linalg.LinAlgError):  # uneven times, records too short
        return None, None, ""
    return 1 - error**2, error, f" (linear, of order {order}, run freely over the last quarter of every run)"
