"""A Duffing oscillator with damping: a hard spring, and a double well.

The hard spring is certified globally: its cube has no damping of its own, so its row in the proof is made exactly zero.
A region is certified, too, for comparison. The double well has three equilibria and is refuted globally; about the
right one a region is certified. That a region is small says nothing about the true basin.

    x1' = x2,   x2' = k x1 - x1^3 - x2/2 + u          (k = -1: hard spring; k = 1: double well)

    python examples/duffing.py
"""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import persid as ps


def duffing(k: float) -> ps.PersidskiiModel:
    """Return the oscillator with linear stiffness -k."""
    cube = ("x**3", [[1.0, 0.0]], [[0.0], [-1.0]])
    return ps.PersidskiiModel(A0=[[0.0, 1.0], [k, -0.5]], terms=[cube], B=[[0.0], [1.0]])


def main() -> Figure:
    """Print both global verdicts, certify a region of each, and draw them."""
    print("hard spring:", ps.certify(duffing(-1.0)))
    print("double well:", ps.certify(duffing(1.0)))
    hard = ps.certify(duffing(-1.0), domain=[[-2, 2], [-3, 3]]).certificate
    well = ps.certify(duffing(1.0), operating_point=[1.0, 0.0], domain=[[0.2, 1.8], [-1.5, 1.5]]).certificate
    for name, found in (("hard spring", hard), ("right well", well)):
        print(f"{name}: |u| <= {found.input_bound:.3f}, rate {found.rate:.3f} 1/s, gain {found.gain:.2f}")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    ps.plots.level_sets(left, hard).set_title("hard spring")
    ps.plots.level_sets(right, well).set_title("double well, about (1, 0)")
    return figure


if __name__ == "__main__":
    main().savefig("duffing.svg")
