"""Frame: a regression and the Lyapunov functions of its models, posed together as one problem for the barrier method.

The forms of the functions are fixed by the frame, not by the model: nondecreasing forms, which hold about every
equilibrium (so the constant b is free), or all sector forms about one anchored equilibrium x* (the constant is then
b = -A phi(x*), and the columns of the regression become phi - phi(x*)).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certified_fits.bilinear import Fit, Inequality, Pairs, Point
from persid.identification.gram import Gram
from persid.identification.structure import Structure
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.inequality import Catalogue, Terms, assemble
from persid.lyapunov.interior_point import Status, solve
from persid.lyapunov.multipliers import NEGLIGIBLE, Lyapunov, lyapunov_function
from persid.lyapunov.sectors import Curve, Group, Place, groups, nondecreasing_facets, pool
from persid.lyapunov.system import (
    Family,
    Scaling,
    System,
    Target,
    scaling,
    system,
)
from persid.lyapunov.unknowns import Unknowns
from persid.models.model import PersidskiiModel

FORMS = {2: 12, 4: 10, 8: 8, 12: 7}  # forms of a group that take part, by the number of states
FEWEST_FORMS = 6
FLOOR = 1e-9  # least ridge: directions that the data do not hold must not run away
NOISE_FLOOR = 1e-6  # least residual that an equation is weighted by, as a share of its left side

Coefficients = Float[ndarray, "p n"]


@dataclass(frozen=True, eq=False)
class Demand:
    """What the certificate has to show: a margin delta (scaled), a rate kappa / 2 in 1/s, gamma / p = `ratio`.

    With `deviations` it has to show that of every plant that they allow.
    """

    delta: float = 1e-5
    kappa: float = 0.0
    ratio: float | None = None
    deviations: tuple[Deviation, ...] = ()


@dataclass(frozen=True, eq=False)
class Frame:
    """Data of the fit: Gram, allowed parameters, fixed coefficients; and where the functions are looked at.

    `anchor` is the equilibrium about which the forms hold, None where they hold about every one; `box` the region of
    the functions (with an anchor). `fixed` (p x n) holds numbers where coefficients are given, NaN elsewhere.
    """

    gram: Gram
    ridge: float
    fixed: Coefficients
    full_P: bool  # noqa: N815 (the matrix is called P)
    demand: Demand
    anchor: Float[ndarray, " n"] | None = None
    box: Float[ndarray, "n 2"] | None = None

    # ---- coefficients

    @cached_property
    def parameter(self) -> ndarray:
        """The number of the unknown at each coefficient, -1 where it is not one."""
        gram = self.gram
        number = gram.structure.parameter.copy()
        number[:-1][gram.weights[:-1] <= 0] = -1
        given = np.unique(number[np.isfinite(self.fixed)])
        number[np.isin(number, given)] = -1
        if self.anchor is not None:
            number[-1] = -1
        return Structure.of(number).parameter

    @cached_property
    def given(self) -> Coefficients:
        """The fixed coefficients, 0 elsewhere; a fixed number holds wherever its parameter is shared."""
        number = self.gram.structure.parameter
        values = self.gram.structure.given.copy()
        for j, i in np.argwhere(np.isfinite(self.fixed)):
            values[number == number[j, i]] = self.fixed[j, i]
            values[j, i] = self.fixed[j, i]
        return values

    def theta(self, w: Float[ndarray, " K"]) -> Coefficients:
        """Return the coefficients of all columns, the constant of an anchored frame included.

        That of a known equation is what it is: an anchor is an equilibrium, where the velocity is 0.
        """
        theta = np.where(self.parameter >= 0, w[self.parameter], self.given)
        if self.anchor is not None:
            known = self.gram.structure.known
            theta[-1] = np.where(known, self.given[-1], -self.values @ theta[: len(self.values)])
        return theta

    def unknowns(self, theta: Coefficients) -> Float[ndarray, " K"]:
        """Return the unknowns of coefficients: means where they are shared."""
        count = int(self.parameter.max()) + 1
        used = self.parameter >= 0
        sums = np.bincount(self.parameter[used], theta[used], count)
        return sums / np.bincount(self.parameter[used], minlength=count)

    @cached_property
    def values(self) -> ndarray:
        """phi(x*) of the columns that depend on x."""
        anchor = self.gram.basis.x_ref if self.anchor is None else self.anchor
        return np.asarray(self.gram.basis.values(anchor[None])[0])

    @cached_property
    def fit(self) -> Fit:
        """The weighted least squares in the unknowns: 1/2 sum_i (residual_i - free residual_i) / free residual_i."""
        gram, number = self.gram, self.parameter
        p = len(number)
        C = np.eye(p)
        if self.anchor is not None:
            C[: len(self.values), -1] = -self.values
            C[-1, -1] = 0.0
        G, H = C @ gram.G @ C.T / gram.rows, C @ gram.H / gram.rows
        G = G + np.diag(np.maximum(self.ridge, FLOOR) * gram.weights**2)
        H = H - G @ np.where(number >= 0, 0.0, self.given * (self.anchor is None or np.arange(p)[:, None] < p - 1))
        count = int(number.max()) + 1
        M, h = np.zeros((count, count)), np.zeros(count)
        for i, weight in enumerate(self.weights):
            used = np.flatnonzero(number[:, i] >= 0)
            ids = number[used, i]
            M[np.ix_(ids, ids)] += weight * G[np.ix_(used, used)]
            h[ids] += weight * H[used, i]
        scale = 1 / np.sqrt(np.maximum(np.diag(M), 1e-300))
        w0 = scale * np.linalg.lstsq(M * scale * scale[:, None], scale * h, rcond=1e-13)[0]
        return Fit(M, w0)

    @cached_property
    def weights(self) -> Float[ndarray, " n"]:
        """One over the mean squared residual of each equation of the free fit."""
        residual = self.gram.residual(self.gram.solve(self.ridge))
        return np.asarray(1 / np.maximum(residual, NOISE_FLOOR * self.gram.yy / self.gram.rows + 1e-300))

    def excess(self, theta: Coefficients) -> float:
        """Return the mean over equations of residual / free residual - 1."""
        free = self.gram.residual(self.gram.solve(self.ridge))
        return float(((self.gram.residual(theta) - free) * self.weights).mean())

    def model(self, theta: Coefficients, domain: ndarray | None = None, **provenance: object) -> PersidskiiModel:
        """Return the model of coefficients."""
        return self.gram.basis.model(theta, domain=domain, provenance=provenance)

    # ---- the Lyapunov functions

    @cached_property
    def template(self) -> PersidskiiModel:
        """A model with 1 at every coefficient that may be different from 0."""
        allowed = (self.parameter >= 0) | (self.given != 0)
        return self.gram.basis.model(allowed.astype(float))

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The groups of the template, shifted to the anchor."""
        if self.anchor is None:
            return groups(self.template.channels)
        place = Place.about(self.anchor, self.gram.basis.x_ref, box=self.box)
        return groups(self.template.channels, place if any(place.offset) or self.box is not None else None)

    @cached_property
    def forms(self) -> tuple[ndarray, ...]:
        """The forms of each group that take part."""
        count = next((k for n, k in FORMS.items() if self.gram.H.shape[1] <= n), FEWEST_FORMS)
        found = []
        for group in self.groups:
            candidates = nondecreasing_facets(group.curve)
            if self.anchor is not None:
                candidates = (*pool(group.curve)[:count], *candidates[: count // 2])
            unique = list(dict.fromkeys(candidates))[: count if self.anchor is None else 3 * count // 2]
            found.append(np.array(unique).reshape(-1, group.curve.size)[: None if group.channels else 0])
        return tuple(found)

    @cached_property
    def families(self) -> tuple[Family, ...]:
        """All forms that have a constant c where a rate is asked for, all products."""
        found = []
        for group, forms in zip(self.groups, self.forms, strict=True):
            full = Family.full(forms)
            rated = np.isfinite(self.upper[group.curve]) | (self.demand.kappa == 0 and self.box is None)
            found.append(Family(forms, tuple(k for k in full.densities if rated[k]), full.products))
        return tuple(found)

    @cached_property
    def upper(self) -> Mapping[Curve, ndarray]:
        """The constants c of the forms, by curve: 1 for nondecreasing forms, 1/2 for y, none (NaN) for others."""
        found = {}
        for group, forms in zip(self.groups, self.forms, strict=True):
            steady = set(nondecreasing_facets(group.curve))
            c = np.array([1.0 if tuple(form) in steady else np.nan for form in forms.tolist()])
            found[group.curve] = np.where((forms[:, 1:] == 0).all(axis=1), 0.5, c)
        return found

    @property
    def target(self) -> Target:
        """The demand as the certification engine takes it."""
        upper = self.upper if self.demand.kappa else {}
        return Target(self.demand.kappa, self.demand.ratio, None, upper, deviations=self.demand.deviations)

    def system(self, theta: Coefficients) -> System:
        """Return the system of coefficients, with every entry of z that the template has."""
        model = self.gram.basis.model(theta)
        pattern = self.pattern
        channels = model.channels
        G = np.hstack([channels.A0[:, list(pattern.states)], channels.columns[:, list(pattern.channels)]])
        return replace(pattern, G=G, B=model.B)

    @cached_property
    def pattern(self) -> System:
        """The system of the template."""
        pools = {group.curve: forms for group, forms in zip(self.groups, self.forms, strict=True)}
        return system(self.template, self.groups, pools, shifted=True)

    @cached_property
    def units(self) -> Scaling:
        """The units of the inequality, taken from the free fit."""
        return scaling(self.system(self.theta(self.fit.w0)))

    @property
    def inputs(self) -> int:
        """Number of inputs that the inequality holds."""
        return self.pattern.B.shape[1] if self.demand.ratio is not None else 0

    @cached_property
    def _catalogue(self) -> Catalogue:
        return Catalogue(self.pattern, self.families, full_P=self.full_P, target=self.target, units=self.units)

    @cached_property
    def _assembled(self) -> tuple[Unknowns, Terms]:
        """What y stands for, and the terms of its unknowns; first among the rows stand those of all entries."""
        whole = self._catalogue
        terms = whole.terms(self.families, range(whole.width))
        return whole.unknowns(self.families, terms), terms

    @cached_property
    def inequality(self) -> Inequality:
        """The inequality in scaled units; unknowns y are P, then group by group mu and tau, then p."""
        _, terms = self._assembled
        S, kept = terms.S.toarray(), np.array(self.pattern.states, int)
        slopes = terms.q >= len(S)
        gradient = Pairs(terms.p, terms.q - len(S), terms.owner, terms.weight)[slopes]
        product = Pairs(terms.p, terms.q, terms.owner, terms.weight)[~slopes]
        return Inequality(
            S=S,
            rho=terms.rho,
            upper=terms.upper,
            base=self._scaled_flow(self.given),
            states=kept,
            gradient=gradient,
            product=product,
            flow=self._flow_pairs(),
            cost=terms.cost,
            symmetric=len(kept) if self.full_P else 0,
            kappa=self.demand.kappa / self.units.rate,
            delta=self.demand.delta,
            coefficients=len(self.fit.w0),
        )

    @cached_property
    def _columns(self) -> ndarray:
        """The entry of z, or of the inputs, that each column of the regression belongs to; -1 for none."""
        found = []
        pattern = self.pattern
        channel = 0
        for column in self.gram.basis.columns:
            if column.kind == "linear":
                found.append(pattern.states.index(column.state) if column.state in pattern.states else -1)
            elif column.kind == "function":
                found.append(pattern.places.get(channel, -1))
                channel += 1
            else:
                found.append(pattern.entries + column.input if column.kind == "input" and self.inputs else -1)
        return np.array(found)

    @cached_property
    def _scales(self) -> ndarray:
        """What a coefficient (column j of the regression, state i) is multiplied by in F."""
        weights = np.concatenate([self.units.entries, self.units.inputs[: self.inputs]])
        used = np.where(self._columns >= 0, weights[np.maximum(self._columns, 0)], 0.0)
        return np.asarray(used[:, None] / self.units.states / self.units.rate)

    def _scaled_flow(self, theta: Coefficients) -> ndarray:
        whole, used = self._catalogue, self._columns >= 0
        F = np.zeros((self.pattern.n, whole.width))
        F[:, self._columns[used]] = (theta * self._scales)[used].T
        F[:, whole.inside :] = whole.flow[:, whole.inside :] / self.units.states[:, None]  # of deviations
        return F

    def _flow_pairs(self) -> Pairs:
        j, i = np.nonzero((self.parameter >= 0) & (self._columns >= 0)[:, None])
        return Pairs(self._columns[j], i, self.parameter[j, i], self._scales[j, i])

    # ---- from models to points and back

    def start(self, theta: Coefficients, time_limit: float = np.inf) -> Point:
        """Return the point of coefficients with the multipliers of largest margin; slack 0 where that suffices."""
        found = assemble(self.system(theta), self.families, full_P=self.full_P, target=self.target)
        solution = solve(found.problem, time_limit=time_limit, gap=1e-3)
        y = self._assembled[0].values(found.unknowns.multipliers(solution.y))
        w, y = self.unknowns(theta), y / (self.inequality.cost @ y)
        inequality = self.inequality
        D = inequality.rows(inequality.flows(w), inequality.slopes(y))
        lowest = float(np.linalg.eigvalsh(inequality.matrix(D, y))[0])
        if solution.status is Status.FEASIBLE and lowest > 0:
            return Point(w, y)
        return Point(w, y, max(-1.5 * lowest, 1e-3))

    def lyapunov(self, model: PersidskiiModel, y: Float[ndarray, " J"], found: tuple[Group, ...]) -> Lyapunov | None:
        """Return the Lyapunov function of a point for the model's groups about its own equilibrium, leanly."""
        pools = {group.curve: forms for group, forms in zip(found, self.forms, strict=True)}
        own = system(model, found, pools, shifted=True)
        sizes = np.where(np.arange(len(y)) < self.inequality.free, np.inf, np.abs(y))
        for share in (*NEGLIGIBLE, 0.0):
            candidate = lyapunov_function(self._assembled[0], np.where(sizes < share * np.abs(y).max(), 0.0, y), own)
            if candidate.is_sound:
                return candidate
        return None
