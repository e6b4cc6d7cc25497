"""Which candidates a race keeps, and from which models they begin."""

import numpy as np
import pytest

from persid.identification.outputs import least_squares, selection, starts
from persid.identification.outputs.answer import _Search
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.least_squares import Task
from persid.identification.outputs.records import Pieces
from persid.identification.outputs.selection import Group, LinearFit, Question
from persid.identification.outputs.starts import Freedom


def group(count: int, n: int = 1) -> Group:
    W = np.tile(np.hstack([-0.1 * np.eye(n), np.ones((n, 1)), np.zeros((n, 1))]), (count, 1, 1))
    latent = Latent(
        W, np.zeros((count, 0, n + 1)), np.ones((count, 1, n + 2)), np.zeros((count, 1, n)), np.zeros((count, 0, 0))
    )
    parameters, batch = starts.free_batch(latent, Freedom(True))
    task = Task(Pieces.of([(np.ones((20, 1)), np.ones((20, 1)))]), parameters, np.zeros((count, batch.w.shape[1])))
    fit = least_squares.begun(task, batch)
    return Group(0, Freedom(True), np.zeros(count), tuple(range(count)), task, fit)


def test_a_race_keeps_who_foretells_and_who_learns(monkeypatch: pytest.MonkeyPatch) -> None:
    """The best on held-out samples goes on, and so does the one that follows the fitted samples best."""
    monkeypatch.setattr(least_squares, "fitted", lambda task, fit, steps, tell=None: fit)
    one = group(6)
    one.fit.error[:], one.fit.held_out[:] = [0.5, 0.4, 0.1, 0.3, 0.6, 0.01], [0.2, 0.3, 0.4, 0.5, 0.6, 10.0]
    least = selection.raced([one], lambda error: None, ((5, 1),))
    assert least == [0.2]
    assert one.fit.ended.tolist() == [False, True, True, True, True, True]  # the last one is hopeless
    one = group(6)
    one.fit.error[:], one.fit.held_out[:] = [0.5, 0.4, 0.1, 0.3, 0.6, 0.7], [0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    selection.raced([one], lambda error: None, ((5, 1),))
    assert one.fit.ended.tolist() == [False, True, False, True, True, True]


@pytest.mark.parametrize(("error", "tried"), [(0.1, [2, 3, 4]), (0.01, [2, 3])])
def test_two_states_more_are_tried_where_one_does_not_help(
    error: float, tried: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Poles come in pairs: after one more state without gain another one is tried, but not where the error is small."""

    def linear(n: int) -> LinearFit:
        one = group(1, n)
        latent = one.task.parameters.latent(one.fit.batch)[0]
        return LinearFit(latent, error, error, one.fit.start, Freedom(True))

    def race(self: _Search, chosen: list[LinearFit], *_: object) -> None:
        for one in chosen:
            self.groups.append(group(1, one.latent.n))
            self.groups[-1].fit.held_out[:] = error * (0.3 if one.latent.n == 4 else 1)

    monkeypatch.setattr(selection, "linear_fit", lambda part, pieces, n, question: linear(n))
    monkeypatch.setattr(_Search, "_race", race)
    question = Question(certified=False, neurons=0, feedthrough=True)
    search = _Search(group(1).task.pieces, [(np.ones((20, 1)), np.ones((20, 1)))], question, lambda stage, error: None)
    monkeypatch.setattr(selection, "ORDERS", 4)
    search.run([linear(2)])
    assert [one.order for one in search.groups] == tried
    assert search.winner().candidate.order == (4 if error > 0.05 else 2)
