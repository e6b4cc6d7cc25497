"""Many small models: how much longer than the decisions themselves does a batch in processes take?

A thousand models of two states are decided by `certify_many`; what remains when the seconds of the attempts, which
every verdict names, are taken from those of all processes is sending models and verdicts, and starting. The answers
must stand in the order of the models: each certificate names the model that was sent.

    python benchmarks/batches.py [--count 1000] [--jobs 2]
"""

import argparse
import os
import time

import numpy as np

import persid as ps


def drawn(count: int, seed: int = 0) -> list[ps.PersidskiiModel]:
    """Return saturating models of two states, all different, most of them stable."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, 2, 2))
    return [ps.PersidskiiModel(-np.eye(2), [("tanh(x)", None, 0.6 * A)], [[1.0], [0.0]]) for A in rows]


def main() -> None:
    """Print one line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    models = drawn(options.count)
    started = time.perf_counter()
    answers = ps.certify_many(models, jobs=options.jobs)
    wall = time.perf_counter() - started
    certified = [(model, answer) for model, answer in zip(models, answers, strict=True) if answer.is_certified]
    ordered = all(answer.certificate.model == model for model, answer in certified)
    deciding = sum(attempt.seconds for answer in answers for attempt in getattr(answer, "attempts", ()))
    share = deciding / options.jobs / wall
    print(
        f"{len(models)} models in {wall:.1f} s with {options.jobs} processes, {1e3 * wall / len(models):.0f} ms each; "
        f"{100 * share:.1f} % of it decides; {len(certified)} certified; order kept: {ordered}"
    )


if __name__ == "__main__":
    main()
