"""Share of provably stable random models that each family of Lyapunov functions certifies.

The models are those of families.py in the folder of shared data, n = 1 … 6, 60 of each, and the scalar
x' = -3 sinh x + 2 tanh x + u. Every "certified" is a file that persid_check has accepted.

    python benchmarks/power.py [--count 60] [--largest 6]
"""

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
from children import shared_families
from numpy import ndarray

from persid.certificates.doubts import without_unproved
from persid.certificates.stability import prove
from persid.errors import RejectedError, RoundingError
from persid.lyapunov.inequality import assemble
from persid.lyapunov.interior_point import Status, solve
from persid.lyapunov.multipliers import choose
from persid.lyapunov.search import search
from persid.lyapunov.sectors import Curve
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import Family
from persid.models.model import PersidskiiModel

ROOT = Path(__file__).resolve().parents[1]
FAMILIES = ("dissipative", "column_dominance", "row_dominance", "nonnormal", "lure", "port_hamiltonian")
WANTED = dict.fromkeys(FAMILIES, 0.95) | {"row_dominance": 0.80}
SEED = 1

Decision = tuple[str, str]  # the word ("certified", "infeasible", …), and a detail


@cache
def largest_dominated(curve: Curve, i: int, j: int) -> float:
    """Return the best c, to 1 %, for which phi_i - c phi_j is proved to be a sector form; 0 where none is."""
    y = np.concatenate([np.geomspace(1e-6, 50, 4000), -np.geomspace(1e-6, 50, 4000)])
    phi = curve.values(y)
    bound = float((phi[:, i] / phi[:, j]).min())
    for share in (1.0, 0.9999, 0.999, 0.99):
        form = np.zeros(curve.size)
        form[i], form[j] = 1.0, -float(np.float32(share * bound))
        if bound > 1e-3 and curve.proves(form):
            return -float(form[j])
    return 0.0


def axes(curve: Curve) -> ndarray:
    """Return the forms f_0 = y, f_1, …, f_J: the paper's only ones."""
    return np.eye(curve.size)


@cache
def _pairwise(curve: Curve) -> tuple[tuple[float, ...], ...]:
    pairs = [(i, j, largest_dominated(curve, i, j)) for i in range(curve.size) for j in range(curve.size) if i != j]
    rows = [np.eye(curve.size)[i] - c * np.eye(curve.size)[j] for i, j, c in pairs if c]
    return tuple(map(tuple, np.vstack([axes(curve), *rows]).tolist()))


def pairwise(curve: Curve) -> ndarray:
    """Return f_i and f_i - c f_j with the best proved c."""
    return np.array(_pairwise(curve))


def decide(model: PersidskiiModel, forms: Callable[[Curve], ndarray] | None, full_P: bool) -> Decision:
    """Search a family (None: all forms), prove what the solution uses, write the file and have it checked."""
    setting = Setting.of(model, None)
    if forms is not None:
        pools = {curve: forms(curve) for curve in setting.pools}
        unknown = {curve: np.full(len(pool), np.nan) for curve, pool in pools.items()}
        setting = replace(setting, pools=pools, upper=unknown, below=unknown)
    while True:
        assembly, solution = _search(setting, full_P) if forms is None else _solve(setting, full_P)
        if solution.status is not Status.FEASIBLE:
            return solution.status.name.lower(), f"margin between {solution.lower:.1e} and {solution.upper:.1e}"
        try:
            found = choose(assembly, solution.y)
            setting, dropped = without_unproved(setting, found)
            if not dropped:
                return "certified", prove(model, found).claim
        except (RejectedError, RoundingError) as error:
            return "rejected" if "checker" in str(error) else "rounding", str(error)


def _search(setting: Setting, full_P: bool) -> tuple:
    outcome = search(setting.system, setting.pools, full_P=full_P, time_limit=60.0)
    return outcome.assembly, outcome.solution


def _solve(setting: Setting, full_P: bool) -> tuple:
    """Every form in V, every product of two of a group; forms with y drop where a state that they read is dropped."""
    system, families = setting.system, []
    for group in system.groups:
        forms = setting.pools[group.curve][: None if group.channels else 0]
        dropped = set(np.flatnonzero(group.row)) - set(system.states)
        families.append(Family.full(forms[forms[:, 0] == 0] if dropped else forms))
    assembly = assemble(system, families, full_P=full_P)
    return assembly, solve(assembly.problem, time_limit=60.0)


ROUTES: dict[str, tuple[Callable[[Curve], ndarray] | None, bool]] = {
    "Theorem 1": (axes, False),
    "Corollary 1": (axes, True),
    "pairwise": (pairwise, False),
    "all forms": (None, False),
    "all forms, full P": (None, True),
}


def decisions(model: PersidskiiModel) -> dict[str, Decision]:
    """Try every family; one that contains a family with a certificate is searched all the same, but for full P."""
    found: dict[str, Decision] = {}
    for name, (forms, full_P) in ROUTES.items():
        before = found.get("all forms")
        if name == "all forms, full P" and before is not None and before[0] == "certified":
            found[name] = before  # a diagonal P is a full one
        else:
            found[name] = decide(model, forms, full_P)
    return found


def models(count: int, largest: int) -> Iterable[tuple[str, int, str, PersidskiiModel]]:
    """Yield (family, n, name, model), the scalar example first."""
    scalar = PersidskiiModel(terms=[("sinh(x)", None, [[-3.0]]), ("tanh(x)", None, [[2.0]])], B=[[1.0]])
    yield "scalar", 1, "-3 sinh x + 2 tanh x", scalar
    for family in FAMILIES:
        for n in range(1, largest + 1):
            for name, _, data in shared_families().draw(family, n, count, SEED):
                yield family, n, name, PersidskiiModel.from_dict(data)


def main() -> None:
    """Print one line for each family and size, then the smallest model of each family that is not certified."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--largest", type=int, default=6)
    options = parser.parse_args()
    started, cells, missing = time.perf_counter(), defaultdict(list), {}
    for family, n, name, model in models(options.count, options.largest):
        found = decisions(model)
        cells[family, n].append(found)
        if found["all forms, full P"][0] != "certified":
            missing.setdefault(family, (name, *found["all forms, full P"]))
        if len(cells[family, n]) in (options.count, 1 if family == "scalar" else -1):
            print(_line(family, str(n), cells[family, n]), flush=True)
    _report(cells, missing, time.perf_counter() - started)


def _line(family: str, n: str, found: list[dict[str, Decision]]) -> str:
    shares = "  ".join(f"{name} {_share(found, name):4.0%}" for name in ROUTES)
    return f"{family:17} n = {n:>5}  {shares}"


def _share(found: list[dict[str, Decision]], name: str) -> float:
    return float(Fraction(sum(each[name][0] == "certified" for each in found), len(found)))


def _report(cells: dict, missing: dict, seconds: float) -> None:
    print()
    by_family = defaultdict(list)
    for (family, _), found in cells.items():
        by_family[family] += found
    for family, found in by_family.items():
        reached = _share(found, "all forms, full P") >= WANTED.get(family, 1.0)
        print(_line(family, "all", found), "" if reached else "  BELOW WHAT IS WANTED")
    for family, (name, word, detail) in missing.items():
        print(f"first of {family} without a certificate: {name}: {word}, {detail}")
    words = [each[name][0] for found in cells.values() for each in found for name in ROUTES]
    print(f"files written that the checker rejects: {words.count('rejected')};  {seconds:.0f} s")
    result = {
        "seed": SEED,
        "seconds": round(seconds, 1),
        "shares": {f: {name: _share(found, name) for name in ROUTES} for f, found in by_family.items()},
        "by_size": [
            {"family": f, "n": n, "models": len(found)} | {name: _share(found, name) for name in ROUTES}
            for (f, n), found in cells.items()
        ],
        "outcomes": {word: words.count(word) for word in sorted(set(words))},
        "first_uncertified": {f: {"model": name, "outcome": w, "detail": d} for f, (name, w, d) in missing.items()},
    }
    path = ROOT / "benchmarks" / "results" / "power.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
