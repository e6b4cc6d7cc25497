"""Seconds, iterations and memory to decide one matrix inequality, one thread, against library solvers.

The models are of column_dominance (forms) and dissipative (the paper's multipliers) in families.py of the shared data.
Every run is a process of its own with one thread, 8 GiB of address space and 3 minutes; a solver that runs out of
either is not tried on larger models. Seconds are of the processor, without imports and without drawing the model: what
they need is imported by deciding a small model first, with functions of its own. On a device of PyTorch (extra "gpu")
they are by the clock, persid alone is run, without a limit of memory or time, and the host may use all its threads; the
floor of their picture is that of the device's own rate.

    OMP_NUM_THREADS=1 python benchmarks/speed.py [--sizes 5,10,20,50,100,200,400]
    python benchmarks/speed.py --device cuda --kinds paper --sizes 400,1000,2000,4000
"""

import argparse
import json
import resource
import time
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from children import MEMORY, SECONDS, child, joined, keep, kept, shared_families

SOLVERS = ("persid", "CLARABEL", "SCS", "CVXOPT")
ROUNDS, SHORT = 3, 2.0  # a run is made again, and the fastest counts, until so many seconds have passed
SIZES = (5, 10, 20, 50, 100, 200, 400)


def drawn(kind: str, n: int) -> Any:
    """Return the model of size n."""
    from persid.models.model import PersidskiiModel

    family = "dissipative" if kind == "paper" else "column_dominance"
    return PersidskiiModel.from_dict(next(shared_families().draw(family, n, 1, 1))[2])


def decided(kind: str, model: Any, device: str = "cpu") -> tuple[Any, Any, int, int]:
    """Find the forms and decide by the search of persid; return the assembly, the solution, iterations and rounds."""
    from persid.lyapunov.arrays import arrays_on
    from persid.lyapunov.inequality import assemble, corollary_1
    from persid.lyapunov.interior_point import solve
    from persid.lyapunov.own_functions import lacking, own_functions
    from persid.lyapunov.search import search
    from persid.lyapunov.sectors import groups, pool
    from persid.lyapunov.system import system

    found = groups(model.channels)
    pools = {group.curve: np.eye(group.curve.size) for group in found}
    if kind == "forms":
        own = own_functions(model, found)
        pools = {c: np.array([*pool(c), *lacking(c, np.array(pool(c)), own[c])]) for c in pools}
    about = replace(system(model, found, pools, shifted=False), arrays=arrays_on(device))
    if kind == "paper":
        assembly = assemble(about, corollary_1(about))
        answer = solve(assembly.problem)
        return assembly, answer, answer.steps, 1
    outcome = search(about, pools)
    return outcome.assembly, outcome.solution, outcome.steps, outcome.rounds


def warm(kind: str, device: str = "cpu") -> Any:
    """Decide a small model with functions of its own, so that nothing is imported later and no form is known before."""
    from persid.models.model import PersidskiiModel

    terms = [("arctan(x)", None, [[-1.0]]), ("x**5", None, [[-1.0]])]
    return decided(kind, PersidskiiModel([[-1.0]], terms, [[1.0]]), device)[0]


def solved_here(kind: str, n: int, device: str = "cpu") -> dict:
    """Decide by persid; the seconds include finding the forms."""
    from persid.lyapunov.sectors import pool

    model, seconds, clock = drawn(kind, n), [], time.process_time if device == "cpu" else time.perf_counter
    warm(kind, device)
    while len(seconds) < ROUNDS and sum(seconds) < SHORT:
        pool.cache_clear()
        started = clock()
        assembly, answer, iterations, rounds = decided(kind, model, device)
        seconds.append(clock() - started)
    found = {"answer": answer.status.name.lower(), "iterations": iterations, "rounds": rounds}
    return found | {"seconds": min(seconds), "unknowns": len(assembly.problem.cost)}


def solved_by_library(kind: str, n: int, solver: str) -> dict:
    """Decide the inequality that persid decides last, through CVXPY; persid's own search for it is not counted."""
    from library import by_library

    assembly = decided(kind, drawn(kind, n))[0]
    by_library(warm(kind).problem, solver)
    seconds: list[float] = []
    while len(seconds) < ROUNDS and sum(seconds) < SHORT:
        found = by_library(assembly.problem, solver)
        seconds.append(found.seconds)
    answer = "feasible" if found.margin > 0 else found.word  # judged by the point itself, not by what is said of it
    return {"answer": answer, "seconds": min(seconds), "unknowns": len(assembly.problem.cost)}


def one(kind: str, n: int, solver: str) -> None:
    """Run in the child process: print one JSON object."""
    name, _, device = solver.partition(" on ")
    result = solved_here(kind, n, device or "cpu") if name == "persid" else solved_by_library(kind, n, solver)
    result["memory_GiB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    if device.startswith("cuda"):
        import torch

        result["device_GiB"] = torch.cuda.max_memory_allocated(device) / 2**30
        result["device"] = torch.cuda.get_device_name(device)
    if device:
        result["gflops"] = rate_of(device)
    print(json.dumps(result))


def main() -> None:
    """Print one line a case and write benchmarks/results/speed.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", default=",".join(map(str, SIZES)))
    parser.add_argument("--kinds", default="paper,forms")
    parser.add_argument("--solvers", default=",".join(SOLVERS))
    parser.add_argument("--device", help="a device of PyTorch, such as cuda, for persid in place of all solvers")
    parser.add_argument("--one", nargs=3, metavar=("KIND", "N", "SOLVER"))
    options = parser.parse_args()
    if options.one:
        return one(options.one[0], int(options.one[1]), options.one[2])
    for kind in options.kinds.split(","):
        for solver in [f"persid on {options.device}"] if options.device else options.solvers.split(","):
            for n in map(int, options.sizes.split(",")):
                case = {"kind": kind, "n": n, "solver": solver}
                result = case | child("speed.py", "--one", kind, str(n), solver, limits=not options.device)
                print(_line(result), flush=True)
                _keep(result)
                if result["answer"] == "time-out" or "emory" in result.get("why", ""):
                    break
    return None


def _keep(result: dict) -> None:
    """Put a result into the file in place of an older one, so that the table may be made in parts."""
    runs = joined(kept("speed", "runs"), result, ("kind", "n", "solver"))
    places = {solver: place for place, solver in enumerate(SOLVERS)}
    runs.sort(key=lambda each: (each["kind"], places.get(each["solver"], len(places)), each["n"]))
    keep("speed", bytes=MEMORY, seconds=SECONDS, gflops=gflops(), runs=runs)


@cache
def gflops() -> float:
    """Return the rate of this machine's matrix product of order 2,000, one thread, the best of five."""
    A, seconds = np.random.default_rng(0).normal(size=(2000, 2000)), []
    for _ in range(5):
        started = time.process_time()
        A @ A
        seconds.append(time.process_time() - started)
    return 2e-9 * len(A) ** 3 / min(seconds)


def rate_of(device: str) -> float:
    """Return the rate of a device's matrix product in double precision, in Gflop/s, the best of five."""
    import torch

    order, seconds = 8000 if device.startswith("cuda") else 2000, []
    A = torch.ones(order, order, dtype=torch.float64, device=device)
    for _ in range(5):
        started = time.perf_counter()
        float((A @ A)[0, 0])  # reading a number waits for the product
        seconds.append(time.perf_counter() - started)
    return 2e-9 * order**3 / min(seconds)


def _line(result: dict) -> str:
    head = f"{result['kind']:6} n = {result['n']:4}  {result['solver']:9}"
    if "seconds" not in result:
        return f"{head} {result['answer']} {result.get('why', '')}"
    steps = f"{result['iterations']:3} iterations in {result['rounds']} rounds" if "rounds" in result else ""
    there = f"{result['device_GiB']:6.2f} GiB there  " if "device_GiB" in result else ""
    return (
        f"{head} {result['seconds']:8.2f} s  {result['memory_GiB']:5.2f} GiB  {there}{result['unknowns']:6} unknowns  "
        f"{result['answer']:10} {steps}"
    )


if __name__ == "__main__":
    main()
