"""The front of the report: a status, one sentence, and held-out measurements beside the delivered model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from persid import plots
from persid.errors import PersidError
from persid.identification.free_runs import input_signal
from persid.identification.scores import Scores
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.model import PersidskiiModel
from persid.plots.proofs import Proof
from persid.reports.comparison import cautions
from persid.reports.figures import SAMPLES, Drawing, curves_of, legend
from persid.reports.results import Results
from persid.verdicts.summary import in_the_long_run
from persid.verdicts.verdict import Certified, Refuted, Verdict

STATES = 3  # at most so many are drawn: the picture shall fit the first screen
WIDTH, LEAST = 6.0, 3.5  # inches, and rem an inch: whole on a telephone, too
UNSCORED = "how well it foretells was not measured"


@dataclass(frozen=True)
class Front:
    """The first screen in words; `kind` is what names its colour."""

    kind: str
    mark: str
    title: str
    sentence: str
    doubts: tuple[str, ...]


def front(results: Results) -> Front:
    """Return status and sentence: green only where the proof holds and the model foretells what it has not seen."""
    verdict, scores = results.verdict, _scores(results)
    unit = results.time_unit
    told = "" if scores is None else f"; {foretelling(scores, unit)}"
    found = cautions(verdict, scores, results.data, results.model, results.hold)
    doubts = tuple(map(capital, found))
    if not isinstance(verdict, Certified):
        if isinstance(verdict, Refuted):
            return refuted_front(verdict, told, doubts)
        sentence = f"{verdict.reason.value.rstrip('.')}{told}."
        return Front("undecided", "?", "Undecided: neither proved stable nor refuted", sentence, doubts)
    doubts = doubts or ((capital(UNSCORED),) if scores is None else ())
    sentence = f"{capital(in_the_long_run(verdict, unit))}, by proof{told}."
    proved = "Proved stable in a region" if verdict.certificate.scope == "regional" else "Proved stable"
    if doubts:
        return Front("certified doubtful", "!", f"{proved}, but doubtful", sentence, doubts)
    return Front("certified", "✓", f"{proved}, and it foretells", sentence, ())


def refuted_front(verdict: Refuted, told: str = "", doubts: tuple[str, ...] = ()) -> Front:
    """Return the first screen of a model that is refuted."""
    title = "Proved not well-posed" if verdict.witness.is_about_equations else "Proved not stable"
    return Front("refuted", "✗", title, f"{verdict.witness.sentence.rstrip('.')}{told}.", doubts)


def _scores(results: Results) -> Scores | None:
    return results.record.scores if results.record else None


def foretelling(scores: Scores, unit: str = "s") -> str:
    """Return in one clause how far the model is off, over which time, and on what."""
    row = scores.headline
    if row.blow_ups:
        return f"on {scores.basis}, {row.blow_ups} of {row.runs} free runs over {row.lasting(unit)} blow up"
    return f"on {scores.basis}, it is off by {max(row.percent):.2g} % of the range over {row.lasting(unit)}"


def capital(text: str) -> str:
    """Return a clause as the beginning of a sentence."""
    return text[:1].upper() + text[1:]


def picture(results: Results) -> list[Drawing]:
    """Draw what was held out, or else all measurements, with the delivered model's free run and its proved bound."""
    shown = results.held if results.held is not None else results.data
    if shown is None:
        return []
    model = results.dynamics.dense()
    place = int(np.argmax([len(run) for run in shown]))
    measured = _from_zero(shown[place][:SAMPLES])
    runs = _free_runs(model, measured, results)
    proof = _proof(results.verdict, measured, runs)
    names = model.states[:STATES]
    figure = Figure(figsize=(WIDTH, 1.15 * (len(names) + (proof is not None)) + 0.6), layout="constrained")
    axes = list(figure.subplots(len(names) + (proof is not None), 1, sharex=True, squeeze=False)[:, 0])
    for i, name in enumerate(names):
        plots.free_run(axes[i], measured, runs, i, name)
    if proof is not None:
        plots.bound(axes[-1], proof, runs[0], measured=measured)
    for ax in axes:
        ax.set_xlabel("")
    axes[-1].set_xlabel("t in s from where the prediction starts")
    figure.align_ylabels(axes)
    legend(figure, axes, 3)
    caption = _caption(results, shown, place, runs, proof is not None)
    return [Drawing("foretold", figure, f"Curves over time of {', '.join(names)}. {caption}", caption, least=LEAST)]


def _from_zero(run: Trajectory) -> Trajectory:
    return Trajectory(run.t - run.t[0], run.x, run.u)


def _free_runs(model: PersidskiiModel, measured: Trajectory, results: Results) -> list[Trajectory]:
    """Return the free run from the first sample; where it blows up, as that of an unstable plant may, runs as long as
    those of the score, one behind the other."""
    hold = results.hold
    whole = _free_run(model, measured, hold)
    scores = _scores(results)
    if scores is None or len(whole) == len(measured) or scores.headline.whole:
        return [whole]
    starts = range(0, len(measured) - 1, scores.headline.steps)
    return [_free_run(model, measured[k : k + scores.headline.steps + 1], hold) for k in starts]


def _free_run(model: PersidskiiModel, run: Trajectory, hold: str) -> Trajectory:
    return model.simulate(run.x[0], run.t, input_signal(run.t, run.u, hold))[0]


def _proof(verdict: Verdict, measured: Trajectory, runs: Sequence[Trajectory]) -> Proof | None:
    """Return the proof of a bound along the free run: there is a rate, and start and inputs lie where it holds."""
    if not isinstance(verdict, Certified) or len(runs) > 1:
        return None
    certificate = verdict.certificate
    try:
        certificate.bound(runs[0].x[0], plots.largest_input(certificate, measured), [0.0])
    except PersidError:
        return None
    return certificate


def _caption(results: Results, shown: Trajectories, place: int, runs: Sequence[Trajectory], proved: bool) -> str:
    scores, record = _scores(results), results.record
    held = results.held is not None and scores is not None
    what = capital(scores.basis) if scores is not None and held else "The measurements, all of them used for the fit"
    which = f", run {place + 1} of {len(shown)}" if len(shown) > 1 else ""
    known = "only the first sample and the inputs" if len(runs) == 1 else "only where it starts and the inputs"
    again = "" if len(runs) == 1 or scores is None else f" and starts again every {scores.headline.steps} samples"
    steps = f"{again}, since the whole run blows up" if again else ""
    parts = [f"{what}{which}: {curves_of('the delivered model')} {known}{steps}."]
    parts += [" Below, how far both are from x*, and the bound that is proved for the model (green)."] if proved else []
    parts += [f" Drawn are {STATES} of {results.dynamics.n} states."] if results.dynamics.n > STATES else []
    if held and not (record and record.test):
        parts += [" For the scores the fit was made without this part; the model that is delivered knows all of it."]
    return "".join(parts)
