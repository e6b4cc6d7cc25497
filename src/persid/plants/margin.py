"""From measurements to a statement about the plant: a certificate, and an estimate that the plant is what it speaks of.

Proved is a sentence about every plant with |g / width|^2 <= delta^2 |(x - x*) / width|^2 + epsilon^2. What the data say
of g = x' - F(x, u) is a band in the space of functions (`estimates`): at every (x, u) between the samples

    |g_i| <= |(theta_i'phi - F_i)(x, u)| + sqrt(quantile phi' Cov_i phi) + |q_i'phi|,

q_i what errors of integrals may have moved theta_i by (`alarms`), so epsilon^2 is the largest of
band^2 - delta^2 |(x - x*) / width|^2 that is found there. It is an estimate, printed as one: measured coverage of bands
of nominal 99 % is about 95 % where the assumptions hold, so that is what is taken.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid._files import Json
from persid.certificates.certificate import Certificate
from persid.certificates.margin import Margin
from persid.errors import DataError, PersidError, RejectedError
from persid.identification.estimates import Dictionary, estimate, windows_of
from persid.identification.windows import NOISE_RATIO, WITH_INSTRUMENTS, choose_window
from persid.lyapunov.margins import Residuals
from persid.measurements.trajectories import Trajectories
from persid.models.model import PersidskiiModel
from persid.networks.certificate import NetworkCertificate
from persid.plants.alarms import Alarm, Evidence, alarms
from persid.plants.bounded import Places, bounded_band
from persid.plants.members import CertifiedModels, certified_models
from persid.verdicts.verdict import Certified, Verdict

OPTIMISM = 5.0  # bands of confidence 1 - a cover with probability 1 - OPTIMISM a, as measured: .99 for about .95
POINTS = 2048  # between two samples, and as many samples, at which the band is looked at
NOISES = ("random", "bounded")


@dataclass(frozen=True, eq=False)
class PlantMargin:
    """What may be said of the plant: the certificate for (delta, epsilon), and how sure the data are that it applies.

    `delta` and `epsilon` (1/s) are in half widths of the data. `spread` (state units) is the distance from x* at which
    the state stays in the long run without input, proved for every plant within them. At a `share` of the places
    between the samples epsilon would not be needed; `alarms` are signs that what the estimate assumes does not hold.
    `certificate` is None where so large an epsilon leaves nothing to prove. `models` says which multiple of the set of
    all coefficients that the data allow is certified, each model about its own equilibria: the sharper statement where
    functions are few; None with bounded noise, and where no multiple is found.

    Examples:
        >>> data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> fit = ps.PersidskiiIdentifier(["x"], ridge=1e-4).fit(data)
        >>> found = ps.plant_margin(fit, ps.certify(fit.model_), data)
        >>> 0 < found.share <= 1
        True
    """

    delta: float
    epsilon: float
    confidence: float
    certificate: Certificate | None
    blocks: int
    share: float
    alarms: tuple[Alarm, ...]
    noise: str
    models: CertifiedModels | None = None

    @property
    def spread(self) -> float | None:
        """The distance from x* at which plants may stay without input, in state units, rounded up."""
        return None if self.certificate is None else self.certificate.spread

    def to_dict(self) -> Json:
        """Return the object that `--json` prints; the certificate is a file of its own."""
        doubts = [{"kind": alarm.kind, "text": alarm.text} for alarm in self.alarms]
        numbers = {"delta": self.delta, "epsilon": self.epsilon, "confidence": self.confidence, "spread": self.spread}
        models = None if self.models is None else self.models.to_dict()
        return numbers | {
            "blocks": self.blocks, "share": self.share, "noise": self.noise, "alarms": doubts, "models": models,
        }  # fmt: skip

    @classmethod
    def from_dict(
        cls, data: Json, certificate: Certificate | None, of_models: Certificate | NetworkCertificate | None = None
    ) -> "PlantMargin":
        """Return what `to_dict` was called on, with the certificates that were read beside it."""
        kept = {name: data[name] for name in ("delta", "epsilon", "confidence", "blocks", "share", "noise")}
        models = None if of_models is None else CertifiedModels.from_dict(data["models"], of_models)
        alarms = tuple(Alarm(**alarm) for alarm in data["alarms"])
        return cls(**kept, certificate=certificate, alarms=alarms, models=models)

    def __str__(self) -> str:
        g = f"|g / width|^2 <= ({self.delta:.4g} |(x - x*) / width|)^2 + {self.epsilon:.4g}^2 (1/s)"
        about = {
            "random": f"at about {100 * self.confidence:.0f} % it obeys the bound between the measured samples, and of "
            "what is outside they say nothing",
            "bounded": "with noise within the given bounds it obeys the bound between the measured samples, of which "
            "some were looked at",
        }[self.noise]
        proved = f"No plant x' = F(x, u) + g with {g} is certified: " + (
            "the constant part is too large." if self.delta else "a weighted l1 norm has no residual margin."
        )
        if self.certificate is not None:
            stays = (
                ""
                if self.spread is None
                else f" and stays in the long run within {self.spread:.4g} of x* without input"
            )
            proved = f"Every plant x' = F(x, u) + g with {g} is certified{stays}."
        said = "" if self.models is None else f" {self.models.sentence(self.confidence)}"
        return (
            f"{proved} That your plant is one of them is not proved; what the data say is an estimate: {about}."
            f"{said}{self.doubts}"
        )

    @property
    def doubts(self) -> str:
        """What the alarms say, in sentences."""
        return "".join(f" But {alarm.text}." for alarm in self.alarms)


def plant_margin(
    fit: Any,
    verdict: Verdict,
    data: object,
    *,
    confidence: float = 0.95,
    instruments: bool = True,
    noise: str = "random",
    bound: object = None,
    time_limit: float | int = 60.0,
) -> PlantMargin:
    """Return what measurements say of the distance between the plant and a certified model, and what is proved of it.

    Args:
        fit: the PersidskiiIdentifier or CertifiedIdentifier that made the model: it knows the window and the hold.
        verdict: Certified, with a residual margin, or by a weighted l1 norm, which has none.
        data: the measurements, as for `fit`.
        confidence: what the estimate shall be right with, approximately, where its assumptions hold: the plant's x' is
            in the span of the model's functions, noise has no memory, inputs are as `hold` says, samples are close.
        instruments: whether columns of earlier windows take the place of those of the window itself: without them noise
            that acts on the plant biases every coefficient, the more surely the longer the record.
        noise: "random", or "bounded": measurement noise of at most `bound` (n,) in state units, no statistics.
        time_limit: seconds after which the search for the largest certified set of models ends with what it has.

    Raises:
        PersidError: there is no residual margin to compare with.
        DataError: an argument does not fit, or the data are not those of the fit.
        UnderdeterminedError: the data are too few.

    Examples:
        >>> data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> fit = ps.PersidskiiIdentifier(["x"], ridge=1e-4).fit(data)
        >>> found = ps.plant_margin(fit, ps.certify(fit.model_), data)
        >>> found.epsilon > 0
        True
    """
    free = getattr(fit, "free_", fit)
    window = free.window_ if free.instruments == (instruments and noise == "random") else None
    asked = Reading(free.hold, window, confidence, instruments, noise, bound, time_limit=time_limit)
    return margin_of(verdict, free._known(data), asked)


@dataclass(frozen=True)
class Reading:
    """How measurements are to be read: see `plant_margin`; window None: as the data suggest."""

    hold: str = "zoh"
    window: int | None = None
    confidence: float = 0.95
    instruments: bool = True
    noise: str = "random"
    bound: object = None
    time_limit: float | int = 60.0  # s, for the largest certified set of models

    def __post_init__(self) -> None:
        if self.noise not in NOISES or not 0 < self.confidence < 1:
            raise DataError(
                f'noise is "random" or "bounded", 0 < confidence < 1; given {self.noise!r}, {self.confidence}'
            )


def margin_of(verdict: Verdict, data: Trajectories, asked: Reading) -> PlantMargin:
    """Return what measurements of the states and inputs of a certified model say; see `plant_margin`."""
    subject = _Subject.of(verdict)
    model, random = subject.model, asked.noise == "random"
    phi, instruments = Dictionary(model), asked.instruments and random
    window = asked.window or choose_window(data, WITH_INSTRUMENTS if instruments else NOISE_RATIO)
    windows = windows_of(data, phi, window, asked.hold, instruments)
    used = np.tile(subject.free, (phi.size, 1))
    nominal = 1 - (1 - asked.confidence) / OPTIMISM
    about = Evidence(
        data=data,
        phi=phi,
        windows=windows,
        found=estimate(windows, used),
        hold=asked.hold,
        instruments=asked.instruments,
        confidence=nominal,
    )
    places = _places(data, phi)
    if random:
        x, away = places.x, about.found.distance(places.phi, model.rhs(places.x, places.u), nominal, about.quadrature)
    else:
        at, away = bounded_band(data, asked.hold, used, _bound(asked.bound, model), phi, places)
        x = places.x[at]
    size = np.linalg.norm((away / subject.width)[:, subject.free], axis=1)
    distance = np.linalg.norm((x - subject.certificate.operating_point) / subject.width, axis=1)
    beyond = size**2 - (subject.delta * distance) ** 2
    epsilon = float(np.sqrt(max(0.0, float(beyond.max()))))
    return PlantMargin(
        delta=subject.delta,
        epsilon=epsilon,
        confidence=asked.confidence,
        certificate=_with_constant(subject.margin, epsilon),
        blocks=about.found.blocks,
        share=float((beyond <= 0).mean()),
        alarms=tuple(alarms(about)) if random else (),
        noise=asked.noise,
        models=certified_models(subject.certificate, about, places.phi, asked.time_limit) if random else None,
    )


@dataclass(frozen=True, eq=False)
class _Subject:
    """Of what a verdict speaks: a model with its residual margin, or a network, which has none (delta = 0)."""

    model: PersidskiiModel
    certificate: Certificate | NetworkCertificate
    margin: Margin | None
    delta: float
    width: Float[ndarray, " n"]
    free: Bool[ndarray, " n"]

    @classmethod
    def of(cls, verdict: Verdict) -> "_Subject":
        margin = verdict.margin if isinstance(verdict, Certified) else None
        if margin is not None:
            model = margin.certificate.model
            free = np.array([name not in margin.known for name in model.states])
            return cls(model, margin.certificate, margin, margin.delta, margin.width, free)
        certificate = verdict.certificate if isinstance(verdict, Certified) else None
        if not isinstance(certificate, NetworkCertificate) or certificate.model.is_large:
            raise PersidError(
                "a certified model with a residual margin is needed (verdict.margin); this verdict has none: see "
                "attempts"
            )
        model = certificate.model.dense()
        residuals = Residuals.of(model, model.m)
        return cls(model, certificate, None, 0.0, residuals.width, residuals.free)


def _with_constant(margin: Margin | None, epsilon: float) -> Certificate | None:
    try:
        return None if margin is None else margin.with_constant(epsilon).certificate
    except RejectedError:
        return None


def _bound(bound: object, model: PersidskiiModel) -> Float[ndarray, " n"]:
    try:
        sizes = np.broadcast_to(np.asarray(bound, float), (model.n,)).copy()
    except (TypeError, ValueError):
        sizes = np.full(model.n, np.nan)
    if not (np.isfinite(sizes).all() and (sizes >= 0).all()):
        raise DataError(
            f'noise="bounded" needs bound=, one size of the noise or {model.n}, in state units; given {bound}'
        )
    return sizes


def _places(data: Trajectories, phi: Dictionary) -> Places:
    """Return samples, and points between two samples of states and inputs each: the hull of what was measured."""
    both = np.vstack([np.hstack([run.x, run.u]) for run in data])
    rng, n = np.random.default_rng(0), len(data.states)
    first, second = both[rng.integers(len(both), size=POINTS)], both[rng.integers(len(both), size=POINTS)]
    share = rng.uniform(size=(POINTS, 1))
    found = np.vstack([both[:: max(1, len(both) // POINTS)], first + share * (second - first)])
    x, u = found[:, :n], found[:, n:]
    return Places(x, u, phi.columns(x, u))
