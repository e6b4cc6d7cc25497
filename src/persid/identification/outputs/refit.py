"""From an earlier fit to the point at which a fit to other records begins."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError, ModelError
from persid.identification.outputs import least_squares, selection, starts
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.least_squares import Batch, Free, Stable, Task
from persid.identification.outputs.parametrisation import Multiplied, Shape, parameters_under
from persid.identification.outputs.records import Pieces, Record, Scales
from persid.identification.outputs.selection import Candidate, Question, Winner
from persid.identification.outputs.starts import Freedom
from persid.models.outputs import OutputModel
from persid.models.stable_fit import StableFit

FIRST = 50  # samples that tell the state at the start of a record


def winner_of(fit: StableFit, records: Sequence[Record], scales: Scales, dt: float, question: Question) -> Winner:
    """Return an earlier fit as the winner of a search that did not take place; its errors are those before a refit.

    Raises:
        DataError: the earlier model has other inputs, outputs, kind or condition than the question.
    """
    _refuse_others(fit, records, question)
    fit, hardening = _with_hardening_first(fit)
    latent = _standardised(fit, records, scales, dt).hardened(hardening)
    pieces = Pieces.of([scales.standardised(record) for record in records], question.hold, kept=selection.KEPT)
    through = bool(question.feedthrough) or (question.feedthrough is None and bool(np.any(fit.D)))
    freedom = Freedom(through, selection.outlasts(latent.A[0], pieces), one_curve=_is_one_curve(latent.F[0]))
    parameters, batch = _point(fit, latent, dt, question, freedom)
    substeps = selection.substeps_for(latent)
    found = least_squares.begun(Task(pieces, parameters, selection.ridge_of(latent, np.zeros(1)), substeps), batch)
    if found.ended[0]:
        raise DataError("the earlier model does not follow these records; fit anew, without warm_start=")
    candidate = Candidate(
        order=latent.n, neurons=latent.q, feedthrough=bool(np.any(fit.D)), ridge=0.0, seed=0,
        error=float(found.error[0]), held_out=float(found.held_out[0]), steps=0,
        hardening=latent.hardening, function=latent.activation,
    )  # fmt: skip
    return Winner(parameters, batch, 0.0, substeps, candidate)


def _is_one_curve(F: Float[ndarray, "q k"]) -> bool:
    return bool(len(F) > 1 and not np.ptp(F, 0).any())


def _refuse_others(fit: StableFit, records: Sequence[Record], question: Question) -> None:
    u, y = records[0]
    n, q = fit.R.shape[1], len(fit.R)
    pairs = (
        ("inputs", u.shape[1], fit.B.shape[1]),
        ("outputs", y.shape[1], len(fit.C)),
        ("output=", question.output_map, fit.output_map),
        ("hold=", question.hold, fit.hold),
        ("order=", question.order or n, n),
        ("neurons=", q if question.neurons is None else question.neurons, q),
        ("certified=", question.certified, fit.M is not None),
    )
    for name, asked, had in pairs:
        if asked != had:
            raise DataError(f"{name} is {asked} and was {had} in the earlier fit; fit anew, without warm_start=")
    if q and fit.activation not in question.functions:
        asked = ", ".join(question.functions)
        raise DataError(f"functions= are {asked}; that of the earlier fit was {fit.activation}; name it among them")


def _with_hardening_first(fit: StableFit) -> tuple[StableFit, int]:
    """Return the same model with its neurons in another order, M < 0 first, and how many of those there are."""
    if fit.M is None or fit.T is None:
        return fit, 0
    order = np.argsort(fit.M >= 0, kind="stable")
    moved = replace(
        fit,
        R=fit.R[order],
        beta=fit.beta[order],
        A1=fit.A1[:, order],
        M=fit.M[order],
        T=fit.T[order],
        F=None if fit.F is None else fit.F[order],
    )
    return moved, int((fit.M < 0).sum())


def _standardised(fit: StableFit, records: Sequence[Record], scales: Scales, dt: float) -> Latent:
    """Return the fit in standard units of these records, a sample being the unit of time.

    With u = u_mean + u_scale v: B (u - u_ref) = B u_scale v + B (u_mean - u_ref), and so for D; y = y_mean + y_scale s.
    """
    model, moved = OutputModel.from_fit(fit), scales.u_mean - fit.u_ref
    x0 = []
    for u, y in records:
        t = dt * np.arange(min(len(u), FIRST))
        try:
            x0.append(model.estimate_state(t, u[: len(t)], y[: len(t)]))
        except ModelError as error:
            raise DataError(f"the earlier model does not fit these records: {error}") from None
    W = np.hstack([fit.A, fit.A1, fit.B * scales.u_scale, (fit.b + fit.B @ moved)[:, None]]) * dt
    rows = np.hstack([fit.C, fit.D * scales.u_scale, (fit.d + fit.D @ moved - scales.y_mean)[:, None]])
    outputs = rows / scales.y_scale[:, None]
    V = np.hstack([fit.R, fit.beta[:, None]])
    return Latent(
        W=W[None],
        V=V[None],
        O=outputs[None],
        x0=np.array(x0)[None],
        F=np.zeros((1, len(fit.R), 0)) if fit.F is None else fit.F[None],
        activation=fit.activation,
        output_map=fit.output_map,
    )


def _point(
    fit: StableFit, latent: Latent, dt: float, question: Question, freedom: Freedom
) -> tuple[Free | Stable, Batch]:
    if fit.M is None or fit.T is None:
        return starts.free_batch(latent, freedom)
    shape = Shape(latent.n, latent.q, question.kappa, starts.slack(latent.A, question.kappa))
    try:
        given = Multiplied(latent.A[0], latent.A1[0], latent.R[0], np.abs(fit.M), fit.T * dt)
        v = parameters_under(shape, given)
    except ValueError:
        raise DataError("the earlier model is slower than min_rate= asks for; fit anew, without warm_start=") from None
    return starts.stable_point(shape, v[None], latent, freedom)
