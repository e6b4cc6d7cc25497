"""Figures: each draws on the Axes it is given, shows what it should, and touches nothing global."""

import io

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.sparse import csc_array

import persid as ps
from persid import plots
from persid._dyadics import value
from persid.identification.diagnostics import Spectrum
from persid.identification.validation import Curve
from persid.reports.proof_figures import nominal_input
from places import VALID


@pytest.fixture
def ax() -> Axes:
    """Axes of a figure that pyplot does not know."""
    return Figure().add_subplot()


@pytest.fixture
def model() -> ps.PersidskiiModel:
    """Two states, one input, a scaled and shifted function."""
    terms = [("tanh(x)", [[0.5, 0.0]], [[-1.0], [0.3]])]
    return ps.PersidskiiModel([[-1, 0], [0.2, -2]], terms, [[1], [0]], [0.5, 0], x_ref=[3, 0], states=["a$b", "x_2"])


@pytest.fixture
def run(model: ps.PersidskiiModel) -> ps.Trajectory:
    """A run of the model."""
    t = np.linspace(0, 5, 200)
    return model.simulate([4, 1], t, np.sin(t))[0]


def drawn(ax: Axes) -> Figure:
    """Render the figure, so that faulty text or data come to light, and return it."""
    figure = ax.figure
    assert isinstance(figure, Figure)
    figure.savefig(io.BytesIO(), format="svg")
    return figure


def test_free_run_shows_both_curves(ax: Axes, run: ps.Trajectory) -> None:
    """The free run shows the measured curve in blue and solid, the model's in red and dashed."""
    assert plots.free_run(ax, run, run, 0, "a$b") is ax
    measured, found = ax.lines
    assert (measured.get_color(), measured.get_linestyle()) == (plots.MEASURED, "-")
    assert (found.get_color(), found.get_linestyle()) == (plots.MODEL, "--")
    assert np.array_equal(np.asarray(measured.get_ydata()), run.x[:, 0])
    drawn(ax)


def test_free_run_marks_a_blow_up(ax: Axes, run: ps.Trajectory) -> None:
    """A blow-up is marked at its time and named, and the measured curve stays readable."""
    gone = ps.Trajectory(run.t[:50], run.x[:50] * np.exp(np.arange(50))[:, None], run.u[:50], diverged_at=1.25)
    plots.free_run(ax, run, gone, 0)
    assert [text.get_text() for text in ax.texts] == ["blows up at 1.25 s"]
    low, high = ax.get_ylim()
    assert high - low < 3 * (run.x[:, 0].max() - run.x[:, 0].min())
    drawn(ax)


def test_long_curves_keep_their_extremes(ax: Axes) -> None:
    """A long curve is thinned out without losing a single spike."""
    t = np.arange(100_000.0)
    x = np.sin(t)
    x[54_321] = 40
    plots.residuals(ax, t, x)
    shown = np.asarray(ax.lines[1].get_ydata())
    assert len(shown) < 3000
    assert shown.max() == 40


def test_constant_states_can_be_drawn(ax: Axes) -> None:
    """A state that never moves gives a figure, not an error."""
    still = ps.Trajectory(np.arange(5.0), np.full((5, 1), 7.0), np.zeros((5, 0)))
    plots.free_run(ax, still, still, 0)
    drawn(ax)


def test_overview_has_a_lane_for_every_column(ax: Axes, run: ps.Trajectory) -> None:
    """Every state and input has its lane, named at its left, its range written at its right; held inputs are steps."""
    data = ps.Trajectories((run,), ("a$b", "x_2"), ("u",))
    plots.overview(ax, data)
    assert [label.get_text() for label in ax.get_yticklabels()] == [r"a\$b", "x_2", "u"]
    assert len(ax.texts) == 3
    assert [line.get_drawstyle() for line in ax.lines] == ["default", "default", "steps-post"]
    for lane, line in enumerate(ax.lines):
        assert np.abs(np.asarray(line.get_ydata()) + lane).max() < 0.5
    drawn(ax)


def test_overview_shades_gaps(ax: Axes) -> None:
    """Runs on one clock leave their gap between them, and so does a long step inside a run."""
    t = np.array([0.0, 1, 2, 3, 8, 9, 10])
    first = ps.Trajectory(t, t[:, None], np.zeros((7, 0)))
    second = ps.Trajectory(t + 20, t[:, None], np.zeros((7, 0)))
    data = ps.Trajectories((first, second), ("x",), ())
    assert plots.gaps(data) == [(3, 8), (23, 28), (10, 20)]
    plots.overview(ax, data)
    assert len(ax.patches) == 3
    drawn(ax)


def test_overview_sets_runs_side_by_side(ax: Axes, run: ps.Trajectory) -> None:
    """Runs that start at the same time do not cover each other, and what lies between them is no gap."""
    data = ps.Trajectories((run, run, run), ("a", "b"), ("u",))
    assert plots.gaps(data) == []
    plots.overview(ax, data)
    spans = [np.asarray(line.get_xdata())[[0, -1]] for line in ax.lines[:3]]
    assert spans[0][1] < spans[1][0] < spans[1][1] < spans[2][0]
    drawn(ax)


def test_characteristics_show_curves_knots_and_density(ax: Axes) -> None:
    """The curve of a state is its linear part and its tables, drawn over the data, with a dot at each knot inside."""
    table = ps.lookup_table([-3, -1, 1, 9], [0, -1, 0.5, 0.5])
    model = ps.PersidskiiModel([[-1, 0], [0, -1]], [(table, [[2, 0]], [[0], [3]])], x_ref=[1, 0])
    assert plots.tabulated(model) == [(1, 0)]
    x = np.linspace(0, 4, 200)
    plots.characteristic(ax, model, 1, 0, x)
    curve, dots = (np.array(line.get_data()) for line in ax.lines[:2])
    assert np.allclose(curve[1], [model.rhs(np.array([v, 0]), np.zeros(0))[1] for v in curve[0]])
    assert dots[0].tolist() == [0.5, 1.5]
    assert ax.get_ylim()[0] < curve[1].min()
    assert plots.tabulated(ps.PersidskiiModel([[-1.0]], [("tanh(x)", None, [[1.0]])])) == []


def test_spectrum_shows_the_aliasing_limit(ax: Axes) -> None:
    """Eigenvalues stand in the complex plane; the shaded sector holds those that turn too fast."""
    spectrum = Spectrum(((0.9, 0.1), (0.9, -0.1), (-0.8, 0.0)), 0.1)
    plots.koopman_spectrum(ax, spectrum)
    assert np.array(ax.lines[-1].get_data()).T.tolist() == [list(pair) for pair in spectrum.values]
    sector = ax.patches[0].get_path()
    assert [bool(sector.contains_point(pair)) for pair in spectrum.values] == [False, False, True]
    drawn(ax)


def test_correlations_ring_what_cannot_be_told_apart(ax: Axes, model: ps.PersidskiiModel, run: ps.Trajectory) -> None:
    """A disk stands for every pair of terms that vary; pairs above 0.99 wear a ring."""
    names, R = plots.correlation_matrix(model, run.x, run.u)
    assert names == ["a$b", "x_2", "tanh((a$b - 3)/2)", "u1"]
    plots.correlations(ax, model, run.x, run.u)
    positive, negative, rings = (len(part.get_offsets()) for part in ax.collections)
    assert positive + negative == 6
    assert rings == (np.abs(R[np.tril_indices(4, -1)]) > plots.COLLINEAR).sum() == 1
    drawn(ax)


def test_fits_stand_side_by_side(ax: Axes) -> None:
    """Each fit has a mark for every state; values below 0 are drawn at 0."""
    plots.fits(ax, {"free": [0.9, -7.0], "under the certificate": [0.8, 0.7]}, ["x1", "x2"])
    free, certified = (np.asarray(line.get_xdata()).tolist() for line in ax.lines)
    assert (free, certified) == ([0.9, 0.0], [0.8, 0.7])
    assert ax.get_legend_handles_labels()[1] == ["free", "under the certificate"]
    drawn(ax)


def test_candidates_are_ranked(ax: Axes) -> None:
    """The best candidate stands on top, one without an error is left out, one without a certificate is hollow."""
    plots.candidates(ax, ["a", "b", "c"], [0.3, None, 0.1], [False, False, True])
    assert [label.get_text() for label in ax.get_yticklabels()] == ["c", "a"]
    assert [line.get_markerfacecolor() for line in ax.lines] == [plots.LEVEL, "none"]
    drawn(ax)


def test_attempts_show_their_times(ax: Axes) -> None:
    """Each attempt has a bar as long as its time, the first on top."""
    plots.attempts(ax, ["search", "proof"], [0.5, 2.0])
    assert [patch.get_width() for patch in ax.patches] == [0.5, 2.0]
    assert [text.get_text() for text in ax.texts] == ["0.5 s", "2 s"]
    drawn(ax)


def test_validation_curve_marks_blow_ups(ax: Axes) -> None:
    """The validation curve marks strengths at which runs blow up, and the strength that was used."""
    plots.validation_curve(ax, Curve((1e-4, 1e-2, 1.0), (0.5, 0.1, 0.3), (0.2, 0.0, 0.0)), 1e-2)
    labels = ax.get_legend_handles_labels()[1]
    assert labels == ["error of free runs", "some runs blow up", "used: 0.01"]
    assert np.asarray(ax.lines[1].get_xdata()).tolist() == [1e-4]
    drawn(ax)


def test_level_sets_surround_the_operating_point(ax: Axes, run: ps.Trajectory) -> None:
    """Level sets of V are drawn about the operating point, over the measured runs and the vector field."""
    certificate = ps.load_certificate(VALID / "g_full.json")
    assert plots.level_sets(ax, certificate, runs=[run, run]) is ax
    labels = ax.get_legend_handles_labels()[1]
    assert labels == ["measured", "operating point"]
    assert len(ax.collections) == 2
    drawn(ax)


def test_level_sets_show_the_region(ax: Axes) -> None:
    """For a regional claim the certified region is shaded, and the frame holds it within the box of the claim."""
    certificate = ps.load_certificate(VALID / "r_pendulum.json")
    plots.level_sets(ax, certificate)
    box = np.array([[value(lo), value(hi)] for lo, hi in certificate.content["box"]])
    assert (ax.get_xlim()[0] >= box[0, 0], ax.get_ylim()[1] <= box[1, 1]) == (True, True)
    x, y = np.meshgrid(np.linspace(*box[0], 50), np.linspace(*box[1], 50))
    points = np.column_stack([x.ravel(), y.ravel()])
    inside = points[certificate.V(points) <= value(certificate.content["level"])]
    assert (inside[:, 1].max() <= ax.get_ylim()[1], inside[:, 0].min() >= ax.get_xlim()[0]) == (True, True)
    levels = [np.asarray(c.levels) for c in ax.collections if hasattr(c, "levels")]
    level = value(certificate.content["level"])
    assert any(len(some) == 1 and some[0] == level for some in levels)
    drawn(ax)


def test_certificates_of_networks_are_drawn(ax: Axes) -> None:
    """Level sets and bound take a certificate of claim L1 too."""
    model = ps.PersidskiiModel(csc_array([[-2.0, 1.0], [1.0, -2.0]]), [], csc_array([[1.0], [0.0]]))
    certificate = ps.certify(model).certificate  # type: ignore[union-attr]
    assert isinstance(certificate, ps.NetworkCertificate)
    assert nominal_input(certificate).tolist() == [0.0]
    t = np.linspace(0, 3, 40)
    (run,) = model.simulate([1.0, -0.5], t, 0.1 * np.sin(t)[:, None])
    plots.bound(ax, certificate, run)
    proved, drawn = (np.array(line.get_ydata()) for line in ax.lines[:2])
    assert proved[0] >= drawn[0]
    ax.clear()
    plots.level_sets(ax, certificate, [(-1.0, 1.0), (-1.0, 1.0)])
    assert ax.collections


def test_bound_stays_above_the_run(ax: Axes) -> None:
    """The proved bound lies above the distance of a simulated run at all times, and needs a claim with a rate."""
    certificate = ps.load_certificate(VALID / "e_mixed_pair.json")
    t = np.linspace(0, 6, 100)
    run = certificate.model.simulate([1, -1], t, np.tile(np.sin(t)[:, None], (1, 2)))[0]
    plots.bound(ax, certificate, run)
    high, low = (line.get_data() for line in ax.lines)
    assert (np.interp(run.t, *high) >= low[1]).all()
    other = certificate.model.simulate([0.5, 0.5], t, np.zeros((100, 2)))[0]
    plots.bound(ax, certificate, run, [other])
    assert ax.get_legend_handles_labels()[1][2:] == ["simulations", "proved bound", "model, free run"]
    with pytest.raises(ps.PersidError, match="no rate"):
        plots.bound(ax, ps.load_certificate(VALID / "g_full.json"), run)
    drawn(ax)


@pytest.mark.parametrize("name", ["g_full", "e_shifted", "g_rows_dropped", "r_pendulum"])
def test_sector_forms_have_the_sign_of_y(ax: Axes, name: str) -> None:
    """Every drawn sector form keeps to the shaded quadrants, about shifted points as well."""
    certificate = ps.load_certificate(VALID / f"{name}.json")
    for g in range(len(certificate.stated.parts)):
        plots.sector_forms(ax, certificate, g)
    for line in ax.lines:
        if line.get_color() == plots.FORM:
            y, form = (np.asarray(part, float) for part in line.get_data())
            assert (y * form >= -1e-9).all()
    drawn(ax)


def test_contributions_are_root_mean_squares(ax: Axes, model: ps.PersidskiiModel, run: ps.Trajectory) -> None:
    """The bars add up in squares as the terms of the equation do, one by one."""
    names, sizes = plots.terms(model, run.x, run.u, 0)
    assert names == ["a$b", "x_2", "tanh((a$b - 3)/2)", "u1", "constant"]
    expected = [run.x[:, 0] - 3, 0 * run.t, np.tanh((run.x[:, 0] - 3) / 2), run.u[:, 0], 0.5 + 0 * run.t]
    assert sizes == pytest.approx([np.sqrt((part**2).mean()) for part in expected])
    plots.contributions(ax, model, run.x, run.u, 0)
    assert len(ax.patches) == 4
    drawn(ax)


def test_vector_field_survives_overflow(ax: Axes) -> None:
    """Where the right side overflows, arrows vanish and no warning escapes."""
    model = ps.PersidskiiModel([[-1, 0], [0, -1]], [("sinh(x)", [[1e3, 0]], [[-1], [0]])])
    plots.phase_portrait(ax, model)
    drawn(ax)


def test_nothing_global_is_touched(ax: Axes, model: ps.PersidskiiModel) -> None:
    """Drawing changes no setting of matplotlib."""
    before = dict(mpl.rcParams)
    plots.phase_portrait(ax, model)
    assert dict(mpl.rcParams) == before
