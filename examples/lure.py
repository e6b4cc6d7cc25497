"""A Lur'e system: two nonlinearities that read combinations of the states.

tanh reads x1 + x3/2 and the cube reads x2 - x3: these are the rows of R. The claim is global, with sector forms for
each of the two arguments. The rate and the gain are proved bounds, not the best ones; the pictures of the forms show
why a form of mixed signs, such as y - tanh y, can be used like a function of the model.

    python examples/lure.py
"""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import persid as ps

LURE = ps.PersidskiiModel(
    A0=[[-1.0, 1.0, 0.0], [0.0, -2.0, 1.0], [-1.0, 0.0, -3.0]],
    terms=[
        ("tanh(x)", [[1.0, 0.0, 0.5]], [[0.0], [0.0], [-4.0]]),
        ("x**3", [[0.0, 1.0, -1.0]], [[0.0], [-1.0], [1.0]]),
    ],
    B=[[1.0], [0.0], [0.0]],
)


def main() -> Figure:
    """Certify; draw the functions of each group with the sector forms that the proof uses, and a slice of V."""
    certificate = ps.certify(LURE).certificate
    print(f"{certificate.claim}: rate {certificate.rate:.3f} 1/s, gain {certificate.gain:.2f}")
    print(
        f"from x0 = (2, -2, 1): |x(t)| <= {certificate.overshoot([2.0, -2.0, 1.0]):.2f} exp(-{certificate.rate:.3f} t)"
    )
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    ps.plots.sector_forms(axes[0], certificate, 0).set_title("y = x1 + x3/2")
    ps.plots.sector_forms(axes[1], certificate, 1).set_title("y = x2 - x3")
    ps.plots.level_sets(axes[2], certificate, states=(0, 2)).set_title("V over x1 and x3, x2 = 0")
    return figure


if __name__ == "__main__":
    main().savefig("lure.svg")
