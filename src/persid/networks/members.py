"""Robust networks: claim L1 of every model whose rows of coefficients lie in ellipsoids about a network's.

An ellipsoid C_i of row i adds |C_i E_k v| to what generator v of node k asks of the weights: the same linear
inequalities with larger entries, hence the same value iteration. The specification is in docs/network-format.md.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse import csr_array

from persid._dyadics import dyadic
from persid.errors import RejectedError
from persid.lyapunov.deviations import Deviation
from persid.models.model import PersidskiiModel
from persid.networks.certificate import NetworkCertificate, prove, table
from persid.networks.weights import Network, Weights, find_weights, laid_out, network
from persid_check.model import model_of
from persid_check.networks.members import Members


def prove_members(model: PersidskiiModel, rows: Sequence[Deviation]) -> NetworkCertificate | None:
    """Return the certificate of all models with rows in ellipsoids about a small model's, None where none is found.

    The deviations have one column each, the equation that they are of; the constants epsilon play no part.
    """
    nodes = None if model.is_large else table(model)
    if nodes is None:
        return None
    net = network(nodes, every=True)
    listed = [(int(np.flatnonzero(row.L[:, 0])[0]), row.C) for row in rows]
    idle = [model.n + c for c in np.flatnonzero(~model.channels.columns.any(axis=0))]
    if any(C[:, idle].any() for _, C in listed):
        return None
    found = find_weights(_widened(net, model, listed))
    if not isinstance(found, Weights):
        return None
    lines = [{"state": i, "C": [_row(line) for line in C]} for i, C in listed]
    try:
        return prove(model, net, found, True, {"deviations": lines})
    except RejectedError:
        return None


def _row(line: Float[ndarray, " Z"]) -> list[list[object]]:
    return [[int(j), dyadic(float(line[j]))] for j in np.flatnonzero(line)]


def _widened(net: Network, model: PersidskiiModel, listed: Sequence[tuple[int, Float[ndarray, "c Z"]]]) -> Network:
    """Return a network whose entries are larger by |C_i E_k v|, all of them kept."""
    n, width = net.table.n, len(net.table.values)
    at = np.full((n, width), -1)
    for entry, (k, slot) in Members(model_of(model.canonical), ()).places.items():
        at[k, slot] = entry
    N, d = [], net.d.copy()
    for r, ray in enumerate(laid_out(net.cones, width)[:, net.table.kind]):
        whole = net.N[r].toarray()
        for i, C in listed:
            more = np.linalg.norm((np.where(at >= 0, C[:, at], 0.0) * ray).sum(axis=2), axis=0)
            d[r, i] += more[i]
            whole[:, i] += np.where(np.arange(n) == i, 0.0, more)
        N.append(csr_array((whole.ravel(), np.tile(np.arange(n), n), np.arange(0, n * n + 1, n)), shape=(n, n)))
    return replace(net, N=tuple(N), d=d)
