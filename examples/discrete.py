"""A loop that overshoots at every sample: discrete time, without a logarithm.

A level is corrected once a second, too strongly, and swings from side to side; of such steps no logarithm can be
trusted. The steps themselves are identified from noisy samples, and certified between any two solutions. So what
one-step predictions of a new recording leave over bounds a free run through all of it (shaded), whatever the plant is.

    the plant, unknown to the fit:  x1[k+1] = 0.3 x1 - tanh(x1) + 0.2 x2 + u,   x2[k+1] = 0.2 x1 + 0.5 x2

    python examples/discrete.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

PULL = ("tanh(x)", None, [[-1.0, 0.0], [0.0, 0.0]])
PLANT = ps.PersidskiiModel([[0.3, 0.2], [0.2, 0.5]], [PULL], [[1.0], [0.0]], time="discrete", dt=1.0)


def recorded(count: int, seed: int) -> ps.Trajectories:
    """Return noisy samples of the plant, its input a random one that changes every five seconds."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.5, 1.5, (count // 5, 1)), 5, axis=0)
    x = PLANT.simulate([2.0, 0.0], np.arange(float(count)), u)[0].x
    return ps.Trajectories.from_arrays(x + 0.01 * rng.normal(size=x.shape), u, dt=1.0)


def main() -> Figure:
    """Print the refusal, the fit and the certificate; draw a new recording, its free run, and both bounds."""
    data, new, start = recorded(400, seed=1), recorded(60, seed=2)[0], [6.0, -4.0]
    try:
        ps.PersidskiiIdentifier(["x", "tanh(x)"], method="edmd").fit(data)
    except ps.GeneratorError as error:
        print("edmd:", str(error).split(": the eigenvalue")[0])
    fit = ps.PersidskiiIdentifier(["x", "tanh(x)"], time="discrete", stride=1).fit(data)
    print(fit.equations(digits=2))
    found = ps.certify(fit.model_, claim="incremental").certificate
    print(f"rate {found.rate:.2f} 1/s, each step leaves {found.contraction:.2f}, gain {found.gain:.1f}")
    free, bound = fit.model_.simulate(new.x[0], new.t, new.u)[0].x, ps.free_run_bound(found, new)
    error, proved = (np.sqrt((part**2).mean()) for part in (free - new.x, bound))
    print(f"free run through a new recording: RMSE {error:.3f}, at most {proved:.3f} by its one-step residuals")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained", width_ratios=[3, 2])
    band = {"color": "tab:green", "alpha": 0.2, "lw": 0, "label": "bound of the free run"}
    left.fill_between(new.t, (free - bound)[:, 0], (free + bound)[:, 0], **band)
    left.plot(new.t, new.x[:, 0], "o", color="tab:blue", ms=3, label="measured")
    left.plot(new.t, free[:, 0], "--", color="tab:orange", label="free run")
    left.set(xlabel="t in s", ylabel="x1, the level")
    far = fit.model_.simulate(start, np.arange(20.0))[0]
    away = np.linalg.norm(far.x - found.operating_point, axis=1)
    right.semilogy(far.t, found.bound(start, 0.0, far.t), color="tab:green", label="proved")
    right.semilogy(far.t, away, "o-", color="tab:orange", ms=3, lw=0.8, label="model, from (6, -4)")
    right.set(xlabel="t in s", ylabel="distance from x*")
    _ = left.legend(fontsize="small"), right.legend(fontsize="small")
    return figure


if __name__ == "__main__":
    main().savefig("discrete.svg")
