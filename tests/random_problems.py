"""Random small systems and the inequalities made of them: general rows, full P, dropped states, badly matched forms."""

import numpy as np

from persid.lyapunov.inequality import Assembly, assemble
from persid.lyapunov.sectors import groups, pool
from persid.lyapunov.system import Family, System, system
from persid.models.model import PersidskiiModel

FUNCTIONS = ("x**3", "sinh(x)", "tanh(x)", "arctan(x)", "x*abs(x)")


def random_model(seed: int) -> PersidskiiModel:
    """Return a model with n = 1 … 3; some have no linear part (claim M), some have channels with general rows."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    strength = rng.uniform(0.2, 2.0)
    A0 = strength * rng.normal(size=(n, n)) - rng.uniform(0, 3) * np.eye(n)
    terms = []
    for f in rng.choice(FUNCTIONS, size=rng.integers(1, 3), replace=False):
        R = rng.normal(size=(int(rng.integers(1, 3)), n)) if rng.random() < 0.4 else None
        k = n if R is None else len(R)
        A = 0.5 * strength * rng.normal(size=(n, k))
        A -= rng.uniform(0, 2) * (np.eye(n) if R is None else R.T)
        terms.append((str(f), R, A))
    if seed % 5 == 4:
        A0, terms = np.zeros((n, n)), [(f, None, A if R is None else A @ R) for f, R, A in terms]
    return PersidskiiModel(A0, terms, rng.normal(size=(n, 1)))


def random_families(about: System, seed: int) -> tuple[Family, ...]:
    """Choose up to five forms of each pool; where a state is dropped, only forms without y."""
    rng = np.random.default_rng(seed)
    families = []
    for group in about.groups:
        forms = np.array(pool(group.curve)).reshape(-1, group.curve.size)
        dropped = set(np.flatnonzero(group.row)) - set(about.states)
        usable = forms[forms[:, 0] == 0] if dropped else forms
        count = min(len(usable), int(rng.integers(2, 6)))
        families.append(Family.full(usable[np.sort(rng.choice(len(usable), count, replace=False))]))
    return tuple(families)


def random_assembly(seed: int) -> Assembly:
    """Return the inequality of a random model in a random family, with full P for every third seed."""
    model = random_model(seed)
    found = groups(model.channels)
    pools = {group.curve: np.array(pool(group.curve)).reshape(-1, group.curve.size) for group in found}
    about = system(model, found, pools, shifted=False)
    return assemble(about, random_families(about, seed), full_P=seed % 3 == 2)
