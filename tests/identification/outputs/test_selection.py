"""Which candidates a race keeps, and from which models they begin."""

import numpy as np
import pytest

from persid.identification.outputs import least_squares, selection, starts
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.least_squares import Task
from persid.identification.outputs.records import Pieces
from persid.identification.outputs.selection import Group
from persid.identification.outputs.starts import Freedom


def group(count: int) -> Group:
    W, V, O = np.tile([[[-0.1, 1.0, 0.0]]], (count, 1, 1)), np.zeros((count, 0, 2)), np.ones((count, 1, 3))  # noqa: E741
    latent = Latent(W, V, O, np.zeros((count, 1, 1)))
    parameters, batch = starts.free_batch(latent, Freedom(True))
    task = Task(Pieces.of([(np.ones((20, 1)), np.ones((20, 1)))]), parameters, np.zeros((count, 6)))
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
