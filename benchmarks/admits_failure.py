"""Of 200 models that are known NOT to be input-to-state stable, how many does each tool's closest feature call stable?

Models of unstable_origin, cooperative_bistable and saturated (families.py of the shared data), n = 2 … 5. persid and
the paper's Theorem 1 get the model; PySINDy and pykoop, which fit, get four runs of 400 noise-free samples of it,
0.05 s apart, from starts of size 1 with random held inputs.

    persid                            certify says Certified
    Theorem 1, SOLVER [, strict]      CVXPY says "optimal" for the conditions as printed; strict: ">" as ">= 1e-6"
    PySINDy, StableLinearSR3          every eigenvalue of the linear model that it returns has a negative real part
    PySINDy, TrappingSR3              the eigenvalues of its symmetrised linear part are negative: its trapping theorem
    pykoop, spectral radius           the matrix that it returns for the lifted state has a spectral radius below 1

As a control the same is asked about 40 models that are stable by construction (dissipative).

    python benchmarks/admits_failure.py [--tools "persid;..."] [--families ...]
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from children import child, joined, keep, kept, measured, python_of, shared_families

COUNTS = {"unstable_origin": 67, "cooperative_bistable": 67, "saturated": 66, "dissipative": 40}
STABLE = "dissipative"  # the control: 40 models that ARE input-to-state stable; who says no to everything is no help
SIZES, SEED = (2, 3, 4, 5), 10
RUNS, SAMPLES, DT, HOLD = 4, 400, 0.05, 20
SECONDS = 900  # for all models of a family
STRICT = 1e-6
LIFTING = "x**3"  # of pykoop, beside x
FEWER = {"pykoop, spectral radius": 20}  # models of each family for a tool that takes seconds for each


def drawn(family: str) -> list[dict]:
    """Return the models of a family, the sizes in turn."""
    families = shared_families()
    streams = [families.draw(family, n, COUNTS[family], SEED) for n in SIZES]
    turns = (next(streams[i % len(streams)]) for i in range(COUNTS[family]))
    return [
        model
        for _, truth, model in islice(turns, COUNTS[family])
        if truth == ("iss" if family == STABLE else "not_iss")
    ]


def measurements(model: dict, seed: int) -> dict[str, Any]:
    """Return runs of a model as arrays x (runs, N, n), u (runs, N, m)."""
    from persid.models.model import PersidskiiModel

    given, rng = PersidskiiModel.from_dict(model), np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-0.5, 0.5, (RUNS, SAMPLES // HOLD, given.m)), HOLD, axis=1)
    t = np.arange(SAMPLES) * DT
    x = [given.simulate(rng.uniform(-1, 1, given.n), t, force)[0].x for force in u]
    length = min(map(len, x))
    return {"x": np.array([run[:length] for run in x]), "u": u[:, :length], "dt": DT}


def persid(model: dict, data: Any) -> bool:
    """Answer whether persid certifies the model."""
    from persid import PersidskiiModel, certify

    return certify(PersidskiiModel.from_dict(model), time_limit=10).is_certified


def theorem_1(solver: str, strict: float) -> Callable[[dict, Any], bool]:
    """Return the question of Theorem 1 as printed, with x among the functions and rho = 1. Paper: thm:main_ISS."""

    def ask(model: dict, data: Any) -> bool:
        import cvxpy as cp

        Gamma = [np.array(model["A0"]), *(np.array(term["A"]) for term in model["terms"])]
        n, M = len(Gamma[0]), len(Gamma)
        unbounded = 1 + sum(term["f"] != "tanh(x)" for term in model["terms"])  # phi; those stand first
        P, Phi = cp.Variable((n, n), PSD=True), cp.Variable((n, n), PSD=True)
        Lambda, Xi = ([cp.diag(cp.Variable(n, nonneg=True)) for _ in range(M)] for _ in range(2))
        U = {(s, z): cp.diag(cp.Variable(n, nonneg=True)) for s in range(M + 1) for z in range(s + 1, M + 1)}
        Q: list[list[Any]] = [[np.zeros((n, n))] * (M + 2) for _ in range(M + 2)]
        for j, G in enumerate(Gamma, 1):
            Q[0][j] = P @ G + U[0, j]
            Q[j][j] = G.T @ Lambda[j - 1] + Lambda[j - 1] @ G + Xi[j - 1]
            Q[j][M + 1] = Lambda[j - 1]
            for z in range(j + 1, M + 1):
                Q[j][z] = G.T @ Lambda[z - 1] + Lambda[j - 1] @ Gamma[z - 1] + U[j, z]
        Q[0][M + 1], Q[M + 1][M + 1] = P, -Phi
        for s in range(M + 2):
            for z in range(s):
                Q[s][z] = Q[z][s].T
        positive = sum(Xi[:unbounded]) + 2 * sum(U[s, z] for s, z in U if z <= unbounded)
        eye = strict * np.eye(n)
        conditions = [P + sum(Lambda) >> eye, positive >> eye, Phi >> eye, cp.bmat(Q) << 0]
        program = cp.Problem(cp.Minimize(0), conditions)
        try:
            program.solve(solver=solver)
        except cp.SolverError:
            return False
        return program.status == "optimal"

    return ask


def _sindy(feature_library: Any, optimizer: Any, data: Any) -> Any:
    import pysindy

    model = pysindy.SINDy(feature_library=feature_library, optimizer=optimizer)
    return model.fit(list(data["x"]), t=float(data["dt"])).optimizer


def stable_linear(model: dict, data: Any) -> bool:
    """Answer whether PySINDy's stable linear model is stable."""
    import pysindy

    optimizer = pysindy.StableLinearSR3(reg_weight_lam=0, relax_coeff_nu=1e-5, max_iter=1000)
    library = pysindy.PolynomialLibrary(degree=1, include_bias=False)
    return bool(np.linalg.eigvals(_sindy(library, optimizer, data).coef_).real.max() < 0)


def trapping(model: dict, data: Any) -> bool:
    """Answer whether PySINDy's trapping regressor ends with its condition fulfilled."""
    import pysindy

    n = len(model["states"])
    optimizer = pysindy.TrappingSR3(_n_tgts=n, _include_bias=True, eta=1e-2, reg_weight_lam=0, max_iter=200)
    fitted = _sindy(pysindy.PolynomialLibrary(degree=2, include_bias=True), optimizer, data)
    return bool(np.max(fitted.PWeigs_history_[-1]) < 0)


def spectral_radius(model: dict, data: Any) -> bool:
    """Answer whether the lifted matrix of pykoop's constrained regressor has a spectral radius below 1."""
    import pykoop
    from peers import pykoop_lifting
    from pykoop.lmi_regressors import LmiEdmdSpectralRadiusConstr

    regressor = LmiEdmdSpectralRadiusConstr(spectral_radius=0.999, max_iter=1, solver_params={"solver": "cvxopt"})
    episodes = [(float(i), np.hstack([x, u])) for i, (x, u) in enumerate(zip(data["x"], data["u"], strict=True))]
    pipeline = pykoop.KoopmanPipeline([("lift", pykoop_lifting(pykoop, LIFTING, constant=False)())], regressor)
    pipeline.fit(pykoop.combine_episodes(episodes, True), n_inputs=data["u"].shape[-1], episode_feature=True)
    A = pipeline.regressor_.coef_.T
    return bool(np.abs(np.linalg.eigvals(A[:, : len(A)])).max() < 1)


TOOLS: dict[str, tuple[str, Callable[[dict, Any], bool]]] = {
    "persid": ("persid", persid),
    "Theorem 1, CLARABEL": ("persid", theorem_1("CLARABEL", 0)),
    "Theorem 1, SCS": ("persid", theorem_1("SCS", 0)),
    "Theorem 1, CLARABEL, strict": ("persid", theorem_1("CLARABEL", STRICT)),
    "Theorem 1, SCS, strict": ("persid", theorem_1("SCS", STRICT)),
    "PySINDy, StableLinearSR3": ("PySINDy", stable_linear),
    "PySINDy, TrappingSR3": ("PySINDy", trapping),
    "pykoop, spectral radius": ("pykoop", spectral_radius),
}


def ask_all(tool: str, folder: Path) -> dict[str, Any]:
    """Ask a tool about every model of a folder, in this process."""
    models = json.loads((folder / "models.json").read_text())[: FEWER.get(tool)]
    ask, stable, failed, total = TOOLS[tool][1], 0, 0, 0.0
    for i, model in enumerate(models):
        data = dict(np.load(folder / f"{i}.npz"))
        try:
            answer, seconds, _ = measured(lambda model=model, data=data: ask(model, data))
        except Exception as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
            failed += 1
            continue
        stable, total = stable + answer, total + seconds
    return {"called_stable": stable, "models": len(models), "gave_up": failed, "seconds": total}


def main() -> None:
    """Ask every tool about every family; print and keep a line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tools", default=";".join(TOOLS))
    parser.add_argument("--families", default=",".join(COUNTS))
    parser.add_argument("--one", nargs=2, metavar=("TOOL", "FOLDER"))
    options = parser.parse_args()
    if options.one:
        return print(json.dumps(ask_all(options.one[0], Path(options.one[1]))))
    for family in options.families.split(","):
        with tempfile.TemporaryDirectory() as folder:
            models = drawn(family)
            Path(folder, "models.json").write_text(json.dumps(models))
            for i, model in enumerate(models):
                np.savez(Path(folder, f"{i}.npz"), **measurements(model, i))
            for tool in options.tools.split(";"):
                python = python_of(TOOLS[tool][0])
                row = {"tool": tool, "family": family}
                row |= child("admits_failure.py", "--one", tool, folder, python=python, seconds=SECONDS)
                print("  ".join(f"{k}: {v}" for k, v in row.items()), flush=True)
                rows = joined(kept("admits_failure", "rows"), row, ("tool", "family"))
                rows.sort(key=lambda r: list(TOOLS).index(r["tool"]))
                keep("admits_failure", rows=rows, totals=totals(rows))
    return None


def totals(rows: list[dict]) -> list[dict]:
    """Return one line a tool: wrong answers over the three families, right ones over the control."""
    done = [row for row in rows if row["answer"] == "done"]
    found = []
    for tool in (tool for tool in TOOLS if any(row["tool"] == tool for row in done)):
        wrong = [row for row in done if row["tool"] == tool and row["family"] != STABLE]
        right = [row for row in done if row["tool"] == tool and row["family"] == STABLE]
        found.append(
            {"tool": tool}
            | {
                "not_ISS_called_stable": sum(row["called_stable"] for row in wrong),
                "of": sum(r["models"] for r in wrong),
            }
            | {"ISS_called_stable": sum(row["called_stable"] for row in right), "of_": sum(r["models"] for r in right)}
            | {"gave_up": sum(r["gave_up"] for r in wrong + right), "seconds": sum(r["seconds"] for r in wrong + right)}
        )
    return found


if __name__ == "__main__":
    main()
