"""What a user would write instead of persid's solver: the matrix inequality in CVXPY, for Clarabel, SCS or CVXOPT.

Not a benchmark: `speed.py` and `agreement.py` use it. Every generator is scaled to order 1 and all are passed as one
sparse matrix. Clarabel ends with a numerical error after no step at n = 20 unless it regularises its factors more.
"""

import time
from typing import NamedTuple

import numpy as np
from scipy import sparse

from persid.lyapunov.pairs import Problem

OPTIONS: dict[str, dict] = {
    "SCS": {"eps_abs": 1e-7, "eps_rel": 1e-7, "max_iters": 200_000},
    "CLARABEL": {"static_regularization_constant": 1e-7},
}


class Answer(NamedTuple):
    """The optimal margin as the solver has it, the margin of its point as it is, its own word, processor seconds."""

    optimum: float
    margin: float
    word: str
    seconds: float


def by_library(given: Problem, solver: str) -> Answer:
    """Maximise t over the unknowns of a problem, whitened as persid's own method whitens it."""
    import cvxpy as cp

    problem = given.whitened()
    started = time.process_time()
    M, norms = _generators(problem)
    N, J, free = problem.order, len(norms), problem.free
    y, t = cp.Variable(J), cp.Variable()
    half = cp.reshape(M @ y, (N, N), order="F")
    cost = problem.cost / norms
    constraints = [-half - half.T - t * np.eye(N) >> 0, (cost / cost.mean()) @ y == 1, y[free:] >= 0]
    if free:
        of = problem.triangle
        units = np.array([of.matrix(unit / s).ravel() for unit, s in zip(np.eye(free), norms, strict=False)])
        k = problem.symmetric
        P = cp.reshape(units.T @ y[:free], (k, k), order="C")
        constraints.append(0.5 * (P + P.T) >> 0)
    program = cp.Problem(cp.Maximize(t), constraints)
    program.solve(solver=solver, **OPTIONS.get(solver, {}))
    point = y.value if y.value is not None else np.full(J, np.nan)
    point[free:] = np.maximum(point[free:], 0)
    whole = (M @ point).reshape(N, N, order="F")
    margin = float(np.linalg.eigvalsh(-whole - whole.T)[0]) if np.isfinite(point).all() else float("nan")
    value = np.nan if program.value is None else float(program.value) / float(cost.mean())  # c'y = 1, as persid has it
    return Answer(value, margin / float(cost.mean()), str(program.status), time.process_time() - started)


def _generators(problem: Problem) -> tuple[sparse.csc_array, np.ndarray]:
    """Return half of every F_k as a column of one matrix, scaled, and the scales."""
    D = sparse.csr_array(sparse.vstack([problem.S, sparse.csr_array(problem.H)]))
    pairs = [(D[[p]].T @ D[[q]]) for p, q in zip(problem.p, problem.q, strict=True)]
    if problem.tie is not None:
        tie = sparse.csc_array(problem.tie)
        spans = zip(tie.indptr, tie.indptr[1:], strict=False)
        pairs = [sum(tie.data[i] * pairs[tie.indices[i]] for i in range(a, b)) for a, b in spans]
    columns = [sparse.coo_array(pair) for pair in pairs]
    norms = np.array([2 * float(np.sqrt((column.data**2).sum())) for column in columns])
    N = problem.order
    places = np.concatenate([c.row + N * c.col for c in columns])
    values = np.concatenate([c.data / s for c, s in zip(columns, norms, strict=True)])
    which = np.repeat(np.arange(len(columns)), [len(c.data) for c in columns])
    return sparse.csc_array((values, (places, which)), shape=(N * N, len(columns))), norms
