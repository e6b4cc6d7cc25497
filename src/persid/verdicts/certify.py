"""The verdict on a model: certified, refuted, or undecided with its reason: the door to all questions."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy import ndarray

from persid._threads import few_threads
from persid.certificates.certificate import Certificate
from persid.certificates.outputs import refuse_steep_maps
from persid.errors import ModelError
from persid.lyapunov.arrays import arrays_on
from persid.lyapunov.operating_points import vector
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.verdicts.log import Log, Progress
from persid.verdicts.questions import Question, decide
from persid.verdicts.verdict import Certified, Reason, Undecided, Verdict

CLAIMS = ("strongest", "incremental", "practical")  # that may be asked for


def certify(
    model: PersidskiiModel | OutputModel | DescriptorModel,
    *,
    operating_point: object = "auto",
    u_op: object = None,
    domain: object = "global",
    gains: str = "joint",
    rate: float | int | None = None,
    claim: str = "strongest",
    time_limit: float | int = 60.0,
    progress: Progress | None = None,
    device: str = "cpu",
) -> Verdict:
    """Decide whether a model is input-to-state stable about its operating point.

    Global questions are tried first: what refutes, then a Lyapunov function on all of R^n, its rate and gain. Where
    these leave a model undecided that has a box of data, a region inside that box is certified. In discrete time a rate
    is also a share that is left after each step: certificate.contraction.

    Args:
        model: the model; the verdict is about it, not about the plant. The certificate of an OutputModel bounds every
            output in its own unit, in place of the states: certificate.output_gains and output_bound.
        operating_point: "auto" (the equilibrium nearest to x_ref) or a state; the equilibrium nearest to it is meant.
        u_op: the nominal constant input, (m,), default u_ref.
        domain: "global"; "auto" for the largest region that is found: all states where that is proved, else one whose
            bounds the search chooses; "data" for a region in the model's box of data only; or a box [[lo, hi], …]. Of a
            model with algebraic variables a box is of the states, or of these and the algebraic variables.
        gains: "joint" for one gain from sup|u - u*|, as small as is found; "each" for a gain of every input, made small
            where inputs act alike: certificate.gains, and certificate.bound(x0, [sup|u_1 - u_1*|, …], t).
        rate: a rate in 1/s that the certificate is to have at least, with the gain as small as is found; where it is
            not proved, the best one that is, which verdict.best_rate tells. The gain is smallest at about half of that
            one: the default. A weighted l1 norm has the rate that it has.
        claim: "strongest" for what is tried above, the strongest first; the sentence of a certificate tells all that it
            proves. "incremental" for bounds that hold between any two solutions, so that every run forgets its start
            and each constant input has one equilibrium: fewer forms prove that, so that gains may be larger.
            "practical" for a ball about x_ref, as small as is found, that every run comes into, where nothing stronger
            is certified for all states: certificate.spread is its radius; many equilibria may lie in it.
        time_limit: seconds after which the search stops with what it has; with 0 nothing is simulated either.
        progress: is called with a line of text at each step.
        device: where the matrix inequalities are solved: "cpu", with NumPy and SciPy, or a device of PyTorch, such as
            "cuda", for models of hundreds of states (extra "gpu"). What is proved does not depend on it.

    Returns:
        Certified with a certificate, or Refuted with a witness, that `persid_check` has accepted; else Undecided. After
        Ctrl-C the best that was reached: a certificate without a rate, or Undecided.

    Raises:
        ModelError: an argument does not fit the model, an output map has no Lipschitz constant, or there is no such
            device here.
        ImportError: a device that needs PyTorch, where it is not installed.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
        >>> verdict = ps.certify(model)
        >>> verdict.is_certified, verdict.certificate.claim
        (True, 'rate-and-gain')
    """
    outputs = model if isinstance(model, OutputModel) else None
    if outputs is not None:
        refuse_steep_maps(outputs)
    if not time_limit >= 0:
        raise ModelError(f"time_limit is {time_limit!r}; needed are seconds, at least 0")
    if gains not in ("joint", "each"):
        raise ModelError(f'gains is "joint" or "each", not {gains!r}')
    if claim not in CLAIMS:
        raise ModelError(f"claim is one of {', '.join(map(repr, CLAIMS))}, not {claim!r}")
    if claim != "strongest" and not (isinstance(domain, str) and domain == "global"):
        raise ModelError(f'claim="{claim}" is about all states; leave domain at "global"')
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise ModelError(f"rate is {rate!r}; needed is a number of 1/s above 0, or None")
    log, each = Log(float(time_limit), progress or (lambda line: None)), gains == "each"
    if isinstance(model, DescriptorModel):
        from persid.verdicts import descriptors

        if claim == "practical":
            raise ModelError('no claim="practical" is sought of a model with algebraic variables')
        box = _box(model.rows, domain, (model.n, model.rows.n))
        auto, u = _is_auto(domain), _nominal(model, u_op)
        equations = descriptors.Question(
            model=model, near=operating_point, u=u, rate=rate, each=each, claim=claim, box=box, auto=auto
        )
        return _answered(partial(descriptors.decide, equations, log), model.n, log)
    dynamics = model.dynamics if isinstance(model, OutputModel) else model
    asked = Question(
        model=dynamics, near=_near(dynamics, operating_point), u=_nominal(dynamics, u_op),
        box=_box(dynamics, domain, (dynamics.n,)), each=each, rate=rate, outputs=outputs, claim=claim,
        arrays=arrays_on(device), auto=_is_auto(domain),
    )  # fmt: skip
    return _answered(partial(decide, asked, log), dynamics.n, log)


def _answered(answer: Callable[[], Verdict], n: int, log: Log) -> Verdict:
    """Return an answer about n states; after Ctrl-C the best that there was.

    Samples overflow and slopes are infinite on the way: what is not finite proves nothing.
    """
    try:
        with few_threads(n), np.errstate(all="ignore"):
            return answer()
    except KeyboardInterrupt:
        best = None if log.best is None else log.best()
        if isinstance(best, Certificate):
            return Certified(best, tuple(log.attempts))
        return Undecided(Reason.INTERRUPTED, "Run it again and let it finish.", tuple(log.attempts))


def _nominal(model: PersidskiiModel | DescriptorModel, u_op: object) -> ndarray:
    return model.u_ref if u_op is None else vector("u_op", u_op, model.m)


def _near(model: PersidskiiModel, operating_point: object) -> ndarray | None:
    """Return the state near which the operating point is meant, None for the one nearest to x_ref."""
    if isinstance(operating_point, str) and operating_point == "auto":
        return None
    return vector('operating_point, if not "auto",', operating_point, model.n)


def _is_auto(domain: object) -> bool:
    return isinstance(domain, str) and domain == "auto"


def _box(model: PersidskiiModel, domain: object, sizes: tuple[int, ...]) -> ndarray | None:
    """Return the box that a regional question names, of so many variables; None for a global question."""
    if isinstance(domain, str):
        if domain not in ("global", "data", "auto"):
            raise ModelError(f'domain is "global", "data", "auto" or a box [[lo, hi], …], not {domain!r}')
        if domain == "data" and model.domain is None:
            raise ModelError('domain="data" needs a model with a box of data; give the box as [[lo, hi], …]')
        return model.domain if domain == "data" else None
    try:
        box = np.array(domain, float)
    except (TypeError, ValueError):
        box = np.zeros(0)
    if box.shape not in [(n, 2) for n in sizes] or not (np.isfinite(box).all() and (box[:, 0] < box[:, 1]).all()):
        alone = f"{sizes[0]} states" + (f", or of all {sizes[-1]} variables" if len(sizes) > 1 else "")
        raise ModelError(f"a box needs one finite [lo, hi] with lo < hi for each of the {alone}")
    return box
