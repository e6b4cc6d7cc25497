"""Verdicts on models of known truth: named ones, random families, the traffic system, and how sharp the bounds are.

    OMP_NUM_THREADS=1 python benchmarks/verdicts.py [--count 200] [--largest 6] [--only named,families,traffic,…]

A verdict counts as right if it is the expected one, and as safe if no model that is not input-to-state stable is
certified and none that is, is refuted. Results are written to benchmarks/results/verdicts.json.
"""

import argparse
import json
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import persid as ps
from persid.verdicts.verdict import Verdict

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
sys.path += [str(ROOT / "tests"), str(SHARED)]

from adversaries import worst_ratio  # noqa: E402
from problems import PROBLEMS  # noqa: E402
from questions import ASKED, SEVERAL_INPUTS, SHARP, TRAFFIC, Case  # noqa: E402

UNSTABLE = ("unstable_origin", "cooperative_bistable", "saturated")


def cases() -> Iterator[Case]:
    """Yield every named question."""
    for problem in PROBLEMS:
        yield Case(problem.name, problem.verdict, problem.why, problem.model)
    yield from ASKED


def word(verdict: Verdict) -> str:
    """Return "certified", "refuted" or "undecided"."""
    return type(verdict).__name__.lower()


def how(verdict: Verdict) -> str:
    """Return the claim, the kind of witness, or the reason."""
    match verdict:
        case ps.Certified(certificate):
            return certificate.claim
        case ps.Refuted(witness):
            return witness.kind
    return verdict.reason.name.lower()


def named() -> list[dict[str, Any]]:
    """Ask every named question and print a row each."""
    rows = []
    print(f"\n{'model':34s} {'expected':10s} {'obtained':10s} {'how':22s} {'s':>6s}")
    for case in cases():
        started = time.perf_counter()
        verdict = ps.certify(ps.PersidskiiModel(**case.model), time_limit=30, **case.question)
        row = {
            "name": case.name,
            "why": case.why,
            "expected": case.expected,
            "obtained": word(verdict),
            "how": how(verdict),
            "sentence": str(verdict),
            "seconds": round(time.perf_counter() - started, 2),
        }
        mark = "" if row["expected"] == row["obtained"] else "  <-- differs"
        rows.append(row)
        print(f"{case.name:34s} {case.expected:10s} {row['obtained']:10s} {row['how']:22s} {row['seconds']:6.2f}{mark}")
    right = sum(row["expected"] == row["obtained"] for row in rows)
    print(f"{right} of {len(rows)} as expected")
    return rows


def random_families(count: int, largest: int) -> list[dict[str, Any]]:
    """Draw models that are not input-to-state stable and count the verdicts."""
    import families

    rows = []
    print(
        f"\n{'family':22s} {'n':>2s} {'models':>6s} {'certified':>9s} {'refuted':>8s} {'undecided':>9s} {'s/model':>8s}"
    )
    for family in UNSTABLE:
        for n in range(1, largest + 1):
            started, found, kinds = time.perf_counter(), Counter(), Counter()
            for _, _, model in families.draw(family, n=n, count=count, seed=1):
                verdict = ps.certify(ps.PersidskiiModel.from_dict(model), time_limit=20)
                found[word(verdict)] += 1
                kinds[how(verdict)] += 1
            seconds = (time.perf_counter() - started) / count
            rows.append({"family": family, "n": n, "count": count, **found, "how": dict(kinds), "seconds": seconds})
            numbers = f"{count:6d} {found['certified']:9d} {found['refuted']:8d} {found['undecided']:9d}"
            print(f"{family:22s} {n:2d} {numbers} {seconds:8.3f}", flush=True)
    return rows


def traffic() -> dict[str, Any]:
    """Count proved equilibria of the traffic system; judge least-squares fits of its data."""
    model = ps.PersidskiiModel(**TRAFFIC, domain=[[-20.0, 20.0], [-20.0, 20.0]])
    points = ps.find_operating_point(model, starts=4096)
    print(f"\ntraffic system at u = 0: {len(points)} equilibria found and proved")
    data = ps.read_csv(ROOT / "examples" / "traffic.csv", states=["x1", "x2"], inputs=["u"])
    rows = []
    for functions in (["x"], ["x", "x**3"], ["x", "x**3", "sinh(x)", "tanh(x)"], ["x", "sin(x)", "cos(x)"]):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # least squares warns of the collinear columns, as it should
            fit = ps.PersidskiiIdentifier(functions=functions, ridge=0.0).fit(data)
        verdict = ps.certify(fit.model_, time_limit=60)
        count = len(ps.find_operating_point(fit.model_, starts=512))
        rows.append({"functions": functions, "verdict": word(verdict), "how": how(verdict), "sentence": str(verdict),
                     "equilibria": count})  # fmt: skip
        print(f"least squares with {', '.join(functions):28s} {count:3d} equilibria: {str(verdict)[:150]}")
    return {"equilibria": len(points), "points": [point.x.tolist() for point in points], "fits": rows}


def sharpness() -> list[dict[str, Any]]:
    """Compare the bound with the worst of seven adversaries from several starts, at |u - u*| <= 1."""
    rows = []
    print(f"\n{'model':28s} {'rate':>7s} {'gain':>7s} {'max |x|/bound':>13s} {'gain/worst':>10s}")
    for name, arguments in SHARP.items():
        verdict = ps.certify(ps.PersidskiiModel(**arguments), time_limit=30)
        if not isinstance(verdict, ps.Certified) or verdict.certificate.rate is None:
            print(f"{name:28s} {verdict}")
            continue
        found = verdict.certificate
        angles = np.linspace(0, 2 * np.pi, 6, endpoint=False)
        circle = np.stack([np.cos(angles), np.sin(angles)], axis=1) if found.model.n == 2 else np.array([[1.0], [-1.0]])
        starts = found.operating_point + np.vstack([0 * circle[:1], circle, 3 * circle])
        largest, ratio = worst_ratio(found, starts, 1.0, T=8 / found.rate, steps=4000)
        rows.append({"name": name, "rate": found.rate, "gain": found.gain, "largest": largest, "ratio": ratio})
        print(f"{name:28s} {found.rate:7.3f} {found.gain:7.3f} {largest:13.3f} {ratio:10.2f}", flush=True)
    return rows


def gains_of_each_input() -> list[dict[str, Any]]:
    """Compare the bound with adversaries that use one input alone, and all at once, at |u_l - u_l*| <= size_l."""
    rows = []
    print(f"\n{'model':28s} {'input':>6s} {'joint gain':>10s} {'gain':>8s} {'max |x|/bound':>13s} {'bound/worst':>11s}")
    for name, arguments in SEVERAL_INPUTS.items():
        model = ps.PersidskiiModel(**arguments)
        joint, each = (ps.certify(model, gains=gains, time_limit=60) for gains in ("joint", "each"))
        if not (isinstance(joint, ps.Certified) and isinstance(each, ps.Certified)):
            print(f"{name:28s} {joint} {each}")
            continue
        found, sizes = each.certificate, 1 / np.linalg.norm(model.B, axis=0)
        starts = found.operating_point + np.vstack([np.zeros(model.n), np.eye(model.n), -3 * np.eye(model.n)])
        for k in [*range(model.m), None]:
            u_sup = sizes if k is None else np.where(np.arange(model.m) == k, sizes, 0.0)
            largest, ratio = worst_ratio(found, starts, u_sup, T=8 / found.rate, steps=2000)
            which, gain = ("all", np.nan) if k is None else (f"u{k + 1}", float(found.gains[k]))
            rows.append({"name": name, "input": which, "joint": joint.certificate.gain, "gain": gain,
                         "largest": largest, "ratio": ratio})  # fmt: skip
            print(f"{name:28s} {which:>6s} {joint.certificate.gain:10.3f} {gain:8.3f} {largest:13.3f} {ratio:11.2f}")
    return rows


def main() -> None:
    """Print the tables and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="models of each random family and size")
    parser.add_argument("--largest", type=int, default=6, help="number of states up to which families are drawn")
    parser.add_argument("--only", default="named,traffic,bounds,gains,families", help="parts, separated by commas")
    chosen = parser.parse_args()
    path = ROOT / "benchmarks" / "results" / "verdicts.json"
    results = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    parts = {
        "named": named,
        "traffic": traffic,
        "bounds": sharpness,
        "gains": gains_of_each_input,
        "families": lambda: random_families(chosen.count, chosen.largest),
    }
    for part in chosen.only.split(","):
        results[part] = parts[part]()
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
