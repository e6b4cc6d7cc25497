"""Records sampled far faster than they change: every so-many-th sample is enough to choose a model by."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.outputs.least_squares import Stable
from persid.identification.outputs.records import Record
from persid.identification.outputs.selection import Winner

STRAIGHT = 0.02  # of an output's spread, by which straight lines between every s-th sample may miss the others
WEIGHTS = np.array([-1.0, 0.0, 9.0, 0.0, 9.0, 0.0, -1.0]) / 16  # the cubic through four neighbours, at their middle


def stride_of(records: Sequence[Record], most: int) -> int:
    """Return the largest stride, at most `most`, at which straight lines miss all outputs by noise alone."""
    stride = 1
    while stride < most and all(_is_straight([y[:, i] for _, y in records], stride + 1) for i in _outputs(records)):
        stride += 1
    return stride


def thinned(record: Record, stride: int, hold: str) -> Record:
    """Return every stride-th sample; inputs that are held are the mean of what is held until the next one."""
    u, y = record
    first = np.arange(0, len(u), stride)
    if hold == "foh":
        return u[first], y[first]
    return np.add.reduceat(u, first, 0) / np.diff(first, append=len(u))[:, None], y[first]


def at_full_rate(winner: Winner, stride: int) -> Winner:
    """Return the same model with one sample as the unit of time, which was `stride` samples.

    x' is divided by the stride, and in the stable parametrisation with it J, L L', T, eps and kappa; M has no unit.
    """
    parameters, batch = winner.parameters, winner.batch
    n, q, m = parameters.n, parameters.q, parameters.m
    w = batch.w.copy()
    if isinstance(parameters, Stable):
        shape = parameters.shape
        skew, root, _, densities, log_T, _ = np.cumsum(shape.sizes)
        w[:, :skew] /= stride
        w[:, skew:root] /= np.sqrt(stride)
        w[:, densities:log_T] -= np.log(stride)
        w[:, shape.size : shape.size + n * (m + 1)] /= stride
        shape = replace(shape, kappa=shape.kappa / stride, eps=shape.eps / stride)
        parameters = replace(parameters, shape=shape)
    else:
        w[:, : n * (n + q + m + 1)] /= stride
    substeps = max(1, ceil(winner.substeps / stride))
    return replace(winner, parameters=parameters, batch=replace(batch, w=w), substeps=substeps)


def _outputs(records: Sequence[Record]) -> range:
    return range(records[0][1].shape[1])


def _is_straight(columns: Sequence[Float[ndarray, " N"]], stride: int) -> bool:
    """Say whether straight lines between every stride-th sample miss the others by little more than noise.

    White noise of variance v adds 2/3 v to a line between two samples, on average, and v to the sample in between.
    """
    missed = np.concatenate([_missed(y, stride) for y in columns])
    rest = np.concatenate([(y - np.convolve(y, WEIGHTS, "same"))[3:-3] for y in columns])
    noise = float((rest**2).mean() / (1 + (WEIGHTS**2).sum()))
    spread = float(np.concatenate(columns).var())
    return float((missed**2).mean()) - 5 / 3 * noise <= STRAIGHT**2 * spread


def _missed(y: Float[ndarray, " N"], stride: int) -> Float[ndarray, " M"]:
    k = np.arange(len(y) - (len(y) - 1) % stride)
    between = k[k % stride > 0]
    return np.asarray(y[between] - np.interp(between, k[::stride], y[k[::stride]]))
