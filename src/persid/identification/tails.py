"""Scores of a fit on the tails of the runs, which a fit like it, made without them, has not seen."""

from dataclasses import dataclass

import numpy as np

from persid.identification.diagnostics import whiteness
from persid.identification.free_runs import Score, free_run_score, one_step, score
from persid.identification.regressions import Problem, Solution
from persid.identification.scores import LONGEST, Record, Scores, held_out_scores
from persid.identification.validation import tail

RUNS = 20  # whose tails are scored


@dataclass(frozen=True)
class Unseen:
    """What the tails say: free runs, one step ahead, how white the residuals of steps are, and runs of several horizons
    where whole free runs say little; all None or empty where nothing was held out."""

    free_run: Score | None = None
    one_step: Score | None = None
    whiteness: tuple[tuple[float, float], ...] = ()
    foretold: Scores | None = None


def tail_scores(problem: Problem, solution: Solution, hold: str) -> Unseen:
    """Score the fit without the tails on the tails: free runs of at most 5000 samples each, one step, whiteness.

    Where a whole free run says little for the model, shorter ones are scored, too: that of an unstable plant blows up.
    """
    held = tail(problem.data, problem.parts, LONGEST, RUNS)
    if held is None or solution.held_out is None:
        return Unseen()
    model = problem.basis.model(solution.held_out)
    after = np.concatenate([run.x[1:] for run in held])
    guess = np.concatenate([one_step(model, run, hold)[:-1] for run in held])
    free = free_run_score(model, held, hold)
    poor = free.blow_ups or not free.r2_mean >= 0
    foretold = held_out_scores(model, held, Record.of(problem.data), hold=hold) if poor else None
    return Unseen(free, score(after, guess), whiteness(after - guess), foretold)
