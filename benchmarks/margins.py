"""How much of what is possible the residual margins of random models reach.

The models are the first of each family and size of families.py in the folder of shared data. `largest` is the largest
delta that is found, as a share of the complex stability radius of the linearisation, and of the smaller of that and of
the distance at which such a plant could rest elsewhere: no method could beat either.

    python benchmarks/margins.py [--count 3] [--largest 3] [-o benchmarks/results/margins.json]
"""

import argparse
import json
from pathlib import Path

import numpy as np
from children import shared_families

import persid as ps

FAMILIES = ("dissipative", "column_dominance", "row_dominance", "nonnormal", "lure", "port_hamiltonian")
SEED = 1


def row(family: str, n: int, count: int) -> dict[str, object]:
    """Medians over the models of one family and size."""
    models = (ps.PersidskiiModel.from_dict(data) for _, _, data in shared_families().draw(family, n, count, SEED))
    verdicts = [ps.certify(model, time_limit=30) for model in models]
    certified = [verdict for verdict in verdicts if isinstance(verdict, ps.Certified)]
    margins = [verdict.margin for verdict in certified if verdict.margin is not None]
    both = [min(margin.radius, margin.resting) for margin in margins]
    shares = {
        "of the radius": [margin.largest / margin.radius for margin in margins],
        "of both": [margin.largest / bound for margin, bound in zip(margins, both, strict=True)],
        "proved": [margin.delta / bound for margin, bound in zip(margins, both, strict=True)],
    }
    medians = {name: float(np.median(values)) if values else None for name, values in shares.items()}
    return {"family": family, "n": n, "models": count, "certified": len(certified), "margins": len(margins), **medians}


def main() -> None:
    """Print and record a row a family and size."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=3)
    parser.add_argument("--largest", type=int, default=3)
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results" / "margins.json")
    given = parser.parse_args()
    rows = []
    for family in FAMILIES:
        for n in range(2, given.largest + 1):
            rows.append(row(family, n, given.count))
            print(rows[-1], flush=True)
            given.output.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
