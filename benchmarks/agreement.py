"""A thousand small problems: is the sign of the margin that of a library solver, and is every answer proved?

The models are those of families.py of the shared data, n = 1 … 4, with diagonal and full P. Clarabel solves, through
CVXPY, the problem that persid's search ends with, and its own point is judged, not its word. A feasible answer must
become a certificate that persid_check accepts, an infeasible one an obstruction, both in exact arithmetic. Saturated
models have a margin and no certificate: no V of their functions grows in every direction, and the checker asks that.

    python benchmarks/agreement.py [--count 14] [--largest 4]
"""

import argparse
import warnings
from collections import Counter
from collections.abc import Iterator

from children import keep, shared_families
from library import by_library

from persid.certificates.doubts import without_unproved
from persid.certificates.obstruction import find_obstruction
from persid.certificates.stability import prove
from persid.errors import RejectedError, RoundingError
from persid.lyapunov.interior_point import Status
from persid.lyapunov.multipliers import choose
from persid.lyapunov.search import Outcome, search
from persid.lyapunov.shifted_model import Setting
from persid.models.model import PersidskiiModel

FAMILIES = (
    "dissipative", "column_dominance", "row_dominance", "nonnormal", "lure", "port_hamiltonian", "unstable_origin",
    "cooperative_bistable", "saturated",
)  # fmt: skip
ACCURACY = 1e-7  # a margin of Clarabel's below it has no sign: its own tolerance is 1e-8 in each of three measures
SEED = 2
COLUMNS = (
    "problems", "feasible", "infeasible", "stalled", "same sign", "no sign", "contradictions", "proved", "V bounded",
    "not proved",
)  # fmt: skip


def answered(model: PersidskiiModel, full_P: bool) -> list[str]:
    """Return what is counted of one problem."""
    setting = Setting.of(model, None)
    found = search(setting.system, setting.pools, full_P=full_P, time_limit=60.0)
    answer = {Status.FEASIBLE: "feasible", Status.INFEASIBLE: "infeasible"}.get(found.status, "stalled")
    counts = ["problems", answer, _compared(found, answer)]
    if answer != "stalled":
        counts.append(_proved(setting, found, full_P))
    return counts


def _compared(found: Outcome, answer: str) -> str:
    library = by_library(found.assembly.problem, "CLARABEL")
    if answer == "infeasible" and library.margin > 0:
        return "contradictions"
    if answer == "feasible" and library.optimum < -ACCURACY and library.word == "optimal":
        return "contradictions"
    if answer == "stalled" or not abs(library.optimum) > ACCURACY:
        return "no sign"
    return "same sign"


def _proved(setting: Setting, found: Outcome, full_P: bool) -> str:
    """Return what the checker says of the answer; what a certificate uses and is not proved leaves, as in certify."""
    if found.status is Status.INFEASIBLE:
        return "not proved" if find_obstruction(setting.model, found) is None else "proved"
    while found.status is Status.FEASIBLE:
        lyapunov = choose(found.assembly, found.solution.y)
        setting, dropped = without_unproved(setting, lyapunov)
        if not dropped:
            try:
                prove(setting.model, lyapunov)
            except (RejectedError, RoundingError) as error:
                return "V bounded" if "do not span" in str(error) else "not proved"
            return "proved"
        found = search(setting.system, setting.pools, full_P=full_P, time_limit=60.0)
    return "not proved"


def models(family: str, count: int, largest: int) -> Iterator[PersidskiiModel]:
    """Yield the models of a family, smallest first."""
    for n in range(1, largest + 1):
        for _, _, data in shared_families().draw(family, n, count, SEED):
            yield PersidskiiModel.from_dict(data)


def main() -> None:
    """Print a line for each family and kind of P, and write benchmarks/results/agreement.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=14)
    parser.add_argument("--largest", type=int, default=4)
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    rows, total = [], Counter[str]()
    print(f"{'':30}" + "".join(f"{name:>15}" for name in COLUMNS))
    for family in FAMILIES:
        for kind in ("diagonal", "full"):
            found = Counter(
                word
                for model in models(family, options.count, options.largest)
                for word in answered(model, kind == "full")
            )
            total += found
            rows.append({"family": family, "P": kind} | {name: found[name] for name in COLUMNS})
            print(_line(f"{family}, {kind} P", found), flush=True)
    print(_line("all", total))
    keep("agreement", rows=rows, total={name: total[name] for name in COLUMNS})


def _line(head: str, found: Counter[str]) -> str:
    return f"{head:30}" + "".join(f"{found[name]:15}" for name in COLUMNS)


if __name__ == "__main__":
    main()
