"""How long does `certify` of a model of two states take: in a fresh process, and when it is asked again?

Each kind is decided in processes of its own: once from nothing, with the imports of a first call and all proofs about
functions, then once more with what the process remembers. The fastest of each counts, in seconds of the processor.
Verdict, rate, gain and the number of forms of the certificate stand beside.

    OMP_NUM_THREADS=1 python benchmarks/two_states.py [--times 3]
"""

import argparse
import json
import time

import numpy as np
from children import child

import persid as ps

KINDS: dict[str, tuple[tuple[str, ...], bool]] = {  # functions, and whether each state has one of its own
    "tanh, sin": (("tanh(x)", "sin(x)"), False),
    "x^3, arctan": (("x**3", "arctan(x)"), False),
    "sinh, x/(1+x^2)": (("sinh(x)", "x/(1+x**2)"), False),
    "tanh | sin": (("tanh(x)", "sin(x)"), True),
    "x^3 | arctan": (("x**3", "arctan(x)"), True),
    "tanh": (("tanh(x)",), False),
    "x^3": (("x**3",), False),
    "sin x + tanh 2x": (("sin(x)+tanh(2*x)",), False),
}
A0 = [[-2.0, 0.5], [-0.3, -1.5]]
A = np.array([[[-0.5, 0.2], [0.1, -0.4]], [[-0.3, 0.1], [-0.1, -0.2]]])


def model(kind: str) -> ps.PersidskiiModel:
    """Return the model of a kind: both states read all functions, or each its own."""
    functions, own = KINDS[kind]
    terms = [(f, np.eye(2)[[j]] if own else None, A[j][:, [j]] if own else A[j]) for j, f in enumerate(functions)]
    return ps.PersidskiiModel(A0, terms, [[1.0], [0.5]])


def decided(kind: str) -> dict[str, object]:
    """Return what is found from nothing, and how long it takes then and again."""
    drawn, seconds = model(kind), []
    for _ in range(2):
        started = time.process_time()
        verdict = ps.certify(drawn)
        seconds.append(time.process_time() - started)
    certificate = verdict.certificate
    forms = sum(len(curve["forms"]) for curve in json.loads(certificate.data)["curves"])
    return {
        "first": seconds[0],
        "again": seconds[1],
        "rate": certificate.rate,
        "gain": certificate.gain,
        "forms": forms,
    }


def main() -> None:
    """Print one line a kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=3, help="processes for each kind")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(decided(options.one)))
        return
    print(f"{'functions':16s} {'first/s':>8s} {'again/s':>8s} {'rate':>6s} {'gain':>6s} {'forms':>6s}")
    for kind in KINDS:
        found = [child("two_states.py", "--one", kind) for _ in range(options.times)]
        first, again = (min(each[name] for each in found) for name in ("first", "again"))
        last = found[-1]
        print(f"{kind:16s} {first:8.3f} {again:8.3f} {last['rate']:6.3f} {last['gain']:6.3f} {last['forms']:6d}")


if __name__ == "__main__":
    main()
