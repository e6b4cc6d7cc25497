"""Bad units: do models get the same verdict with functions, times and states a million times larger or smaller?

Every model of known truth, stable or not, is certified as it is and in other units; the system is the same. A verdict
counts when persid_check has accepted its file.

    python benchmarks/scaling.py [--count 3] [--largest 3]
"""

import argparse
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator

import numpy as np
from children import keep, shared_families

import persid as ps

FAMILIES = ("dissipative", "column_dominance", "nonnormal", "lure", "port_hamiltonian", "unstable_origin", "saturated")
SEED = 3


def rescaled(model: ps.PersidskiiModel, seconds: float, units: np.ndarray) -> ps.PersidskiiModel:
    """Return the same system with time in units of `seconds` and state i in units of `units[i]`."""
    terms = []
    for term in model.terms:
        R = np.eye(model.n) if term.R is None else term.R
        terms.append(([f.text for f in term.f], R * units, seconds * term.A / units[:, None]))
    A0 = seconds * model.A0 / units[:, None] * units
    return ps.PersidskiiModel(A0, terms, seconds * model.B / units[:, None])


def magnified(model: ps.PersidskiiModel, factor: float) -> ps.PersidskiiModel:
    """Return the same system with every function multiplied by a factor and its columns divided by it."""
    terms = [([f"{factor!r}*({f.text})" for f in term.f], term.R, term.A / factor) for term in model.terms]
    return ps.PersidskiiModel(model.A0, terms, model.B)


def mixed(model: ps.PersidskiiModel, size: float) -> np.ndarray:
    """Return units that are alternately large and small."""
    return np.array([size, 1 / size] * model.n)[: model.n]


UNITS: dict[str, Callable[[ps.PersidskiiModel], ps.PersidskiiModel]] = {
    "functions x 1e-6": lambda model: magnified(model, 1e-6),
    "functions x 1e-3": lambda model: magnified(model, 1e-3),
    "functions x 1e3": lambda model: magnified(model, 1e3),
    "functions x 1e6": lambda model: magnified(model, 1e6),
    "time in ms": lambda model: rescaled(model, 1e-3, np.ones(model.n)),
    "time in hours": lambda model: rescaled(model, 3600.0, np.ones(model.n)),
    "states x 1e-3": lambda model: rescaled(model, 1.0, np.full(model.n, 1e3)),
    "states x 1e3": lambda model: rescaled(model, 1.0, np.full(model.n, 1e-3)),
    "states x 1e3, 1e-3": lambda model: rescaled(model, 1.0, mixed(model, 1e-3)),
}


def models(count: int, largest: int) -> Iterator[tuple[str, ps.PersidskiiModel]]:
    """Yield (name, model)."""
    for family in FAMILIES:
        for n in range(1, largest + 1):
            for name, _, data in shared_families().draw(family, n, count, SEED):
                yield name, ps.PersidskiiModel.from_dict(data)


def word(model: ps.PersidskiiModel) -> str:
    """Return the verdict as a word."""
    return type(ps.certify(model)).__name__.lower()


def main() -> None:
    """Print how many verdicts stay as they are in each kind of units; write benchmarks/results/scaling.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=3)
    parser.add_argument("--largest", type=int, default=3)
    options = parser.parse_args()
    same, changed, verdicts = Counter[str](), defaultdict[str, list[str]](list), Counter[str]()
    for name, model in models(options.count, options.largest):
        expected = word(model)
        verdicts[expected] += 1
        for units, change in UNITS.items():
            found = word(change(model))
            if found == expected:
                same[units] += 1
            else:
                changed[units].append(f"{name}: {expected}, then {found}")
                print(f"{units}: {changed[units][-1]}", flush=True)
    total = sum(verdicts.values())
    print(", ".join(f"{count} {each}" for each, count in verdicts.items()))
    for units in UNITS:
        print(f"{units:20} {same[units]:4} of {total} verdicts unchanged")
    rows = [{"units": units, "models": total, "same": same[units], "changed": changed[units]} for units in UNITS]
    keep("scaling", verdicts=dict(verdicts), rows=rows)


if __name__ == "__main__":
    main()
