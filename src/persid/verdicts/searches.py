"""Searches for a Lyapunov function that end in a proof: by margin, or by rate and gain."""

from collections.abc import Callable, Collection
from dataclasses import replace
from fractions import Fraction

import numpy as np

from persid.certificates.certificate import Certificate
from persid.certificates.doubts import without_unproved
from persid.certificates.obstruction import find_obstruction
from persid.certificates.stability import prove
from persid.errors import RejectedError, RoundingError
from persid.lyapunov import decay
from persid.lyapunov.arrays import is_out_of_memory
from persid.lyapunov.coordinates import Coordinates
from persid.lyapunov.interior_point import Status
from persid.lyapunov.multipliers import Lyapunov, choose
from persid.lyapunov.rates import Question, best_rate, kappa, smallest_gain
from persid.lyapunov.search import MORE_FORMS, Outcome, search
from persid.lyapunov.second_pass import in_use, loosened, with_fewer_forms
from persid.lyapunov.sectors import Form
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import System
from persid.models.outputs import OutputModel
from persid.verdicts import failures as words
from persid.verdicts.failures import Failure, stopped
from persid.verdicts.log import Log
from persid.verdicts.verdict import Reason
from persid_check.search.prover import prove_radially_unbounded

SHORTENED_STATES = 20  # up to so many states forms that are not needed leave before a proof
ABOVE = 1 + 1e-6  # times a rate that is asked for: the file carries it rounded

Find = Callable[[Setting], Lyapunov | Failure]


def settled(
    setting: Setting, find: Find, log: Log, outputs: OutputModel | None = None
) -> tuple[Certificate | Failure, Setting]:
    """Find, prove what is used, write and check; what is not proved leaves the pools, and the search is made again.

    Returns:
        The certificate or why there is none, and the setting without what was not proved.
    """
    unproved: list[str] = []
    while log.left() > 0:
        try:
            found = find(setting)
            if not isinstance(found, Lyapunov):
                lacking = found.reason in (Reason.NOT_FOUND, Reason.INFEASIBLE) and unproved
                failure = Failure(Reason.FORM, words.UNPROVED.format("; ".join(unproved[:4]))) if lacking else found
                return failure, setting
            log.progress("proving properties of the functions")
            setting, dropped = without_unproved(setting, found)
            if not dropped:
                log.progress("checking in exact arithmetic")
                certificate = prove(setting.model, found, setting.point, setting.box, outputs)
                log.used |= found.used
                return certificate, setting
        except RejectedError as error:
            if isinstance(found, Lyapunov) and not grows(setting, found):
                return Failure(Reason.FORM, words.NO_GROWTH), setting
            return Failure(Reason.ROUNDING, str(error)), setting
        except RoundingError as error:
            return Failure(Reason.ROUNDING, str(error)), setting
        except (MemoryError, RuntimeError) as error:
            if not is_out_of_memory(error):
                raise
            return Failure(Reason.MEMORY, words.MEMORY), setting
        for line in dropped:
            log.progress(f"not proved and dropped: {line}")
        unproved += dropped
    return stopped(Status.TIME), setting


def grows(setting: Setting, lyapunov: Lyapunov) -> bool:
    """Whether states in V as such and the rows of functions unbounded at both ends span the state space."""
    rows = [np.eye(lyapunov.system.n)[list(lyapunov.system.states)]]
    for group in setting.found:
        curve = group.curve
        axes = [tuple(Fraction(int(j == k)) for k in range(curve.size)) for j in range(1, curve.size)]
        if any(prove_radially_unbounded(curve.exact, axis, curve.domain, curve.shift) for axis in axes):
            rows.append(group.row[None])
    spanned = np.vstack(rows)
    return bool(spanned.size and np.linalg.matrix_rank(spanned) == lyapunov.system.n)


def margin(setting: Setting, full_P: bool, log: Log) -> Lyapunov | Failure:
    """Return a Lyapunov function with V' < 0 and no rate asked for, a full P that stalls in better coordinates."""
    found, better = _with_margin(setting, full_P, log)
    if isinstance(found, Failure):
        return found
    found = shortened(found, log)
    lyapunov = choose(found.assembly, found.solution.y)
    return lyapunov if better is None else better.back(lyapunov)


def sketched(setting: Setting, full_P: bool, log: Log) -> Failure | None:
    """Return why there is no Lyapunov function with V' < 0; None where floating point finds one."""
    found, _ = _with_margin(setting, full_P, log)
    return found if isinstance(found, Failure) else None


def _with_margin(setting: Setting, full_P: bool, log: Log) -> tuple[Outcome | Failure, Coordinates | None]:
    """Return an outcome with V' < 0 or why there is none, and the coordinates in which it is, if not the usual ones."""
    found, better = _searched(setting, setting.system, full_P, log), None
    if found.status is Status.STALLED and full_P and (better := _coordinates(setting)) is not None:
        found = _searched(setting, better.turned, full_P, log)
    if found.status is Status.FEASIBLE:
        return found, better
    obstruction = None
    if found.status is Status.INFEASIBLE and better is None:
        obstruction = find_obstruction(setting.model, found)
    failure = Failure(Reason.INFEASIBLE, words.TRY, obstruction) if obstruction is not None else stopped(found.status)
    return failure, better


def _searched(setting: Setting, system: System, full_P: bool, log: Log) -> Outcome:
    """Search for a margin; where the path from the usual start stalls, once more from another."""
    for first in (None, MORE_FORMS):
        found = search(system, setting.pools, full_P=full_P, first=first, time_limit=log.left(), progress=log.progress)
        if found.status is not Status.STALLED:
            break
    if found.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return found


def shortened(found: Outcome, log: Log, slowest: float = 0.0, known: Collection[Form] = ()) -> Outcome:
    """Return an outcome without the forms that it can spare, its rate at least `slowest`; of large models itself.

    Forms that are `known`, of another proof, stay.

    Where V reads a state through functions alone, their growth is needed, which no inequality asks for: all stay.
    """
    unknowns = found.assembly.unknowns
    if unknowns.system.n > SHORTENED_STATES or len(unknowns.system.states) < unknowns.system.n:
        return found
    return with_fewer_forms(found, loosened(unknowns.target, slowest), log.left, known)


def _coordinates(setting: Setting) -> Coordinates | None:
    """Return better coordinates of the states of a global question."""
    return Coordinates.of(setting.system, setting.jacobian) if setting.box is None else None


def rate_and_gain(setting: Setting, full_P: bool, rate: float | int | None, each: bool, log: Log) -> Lyapunov | Failure:
    """Return a Lyapunov function of at least a rate (1/s), its gain made small; that of the best rate goes to the log.

    The gain is smallest at about half of the best rate, which is taken unless more is asked for. In a box V is bounded
    from below in the shape of the box; with `each`, every input has a gain of its own.
    """
    J = setting.jacobian
    if not np.isfinite(J).all():
        return Failure(Reason.OUTSIDE, words.NO_SLOPE)
    if setting.fastest <= 0:
        return Failure(Reason.OUTSIDE, words.NO_DECAY)
    system, reach = setting.system, setting.reach
    if len(system.states) < system.n:  # a rate keeps every state; no form lets this one be kept
        return stopped(Status.INFEASIBLE)
    units = setting.units if each else None
    if units is not None:
        system = replace(system, B=system.B * units)
    if log.left() <= 0:
        return stopped(Status.TIME)
    shape = None if reach is None else 1 / reach**2
    found = _rated(Question(system, setting.pools, setting.upper, setting.below, full_P, shape), setting, rate, log)
    better = _coordinates(setting) if found is None and full_P and units is None else None
    if better is not None:
        turned = Question(better.turned, setting.pools, setting.upper, setting.below, full_P)
        found = _rated(turned, setting, rate, log)
    if found is None:
        if log.left() > 0 and reach is not None:
            return Failure(Reason.NOT_FOUND, words.SMALLER)
        return stopped(Status.TIME if log.left() <= 0 else Status.INFEASIBLE)
    best, gentle = found
    back = (lambda lyapunov: lyapunov) if better is None else better.back
    log.fastest = lambda: back(choose(best.assembly, best.solution.y, setting.lower, units))
    return back(choose(gentle.assembly, gentle.solution.y, setting.lower, units))


def _rated(question: Question, setting: Setting, rate: float | int | None, log: Log) -> tuple[Outcome, Outcome] | None:
    """Return what has the best rate, and what has a small gain at the rate asked for or at half of the best one."""
    best = best_rate(question, setting.fastest, log.left)
    asked = decay.loss(ABOVE * (rate or 0.0), setting.model.dt)
    if (0.0 if best is None else kappa(best)) < asked <= setting.fastest:  # bisection has left a few percent
        best = question.ask(asked, None, best.families if best else None, log.left) or best
    if best is None:
        return None
    aim = min(max(decay.gentle(kappa(best), setting.model.dt), asked), kappa(best))
    gentle = smallest_gain(question, aim, best, log.left)
    if gentle is None:
        best = shortened(best, log, asked)
        return best, best
    gentle = shortened(gentle, log, asked)
    return shortened(best, log, asked, in_use(gentle)), gentle


def fastest(_: Setting, log: Log) -> Lyapunov | Failure:
    """Return the Lyapunov function of the best rate that was found, once: nothing is searched anew."""
    make, log.fastest = log.fastest, None
    return stopped(Status.TIME) if make is None else make()
