"""Learned curves: their values, slopes and tables."""

import numpy as np

from persid.models.functions import scalar_function
from persid.models.learned_curves import knots, slope, table, value, way


def test_a_curve_has_its_slopes_and_is_zero_at_zero():
    """Every row reads its own curve: slopes are those of the pieces, and values are their integral from 0."""
    slopes = np.random.default_rng(0).uniform(size=(2, 3, 6))
    s = np.linspace(-4, 4, 801)[None, None] * np.ones((2, 3, 1))
    f = value(s, slopes)
    np.testing.assert_allclose(f[..., 400], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("abnk,abk->abn", way(s, 6), slopes), f, atol=1e-12)
    rises, middle = np.diff(f) / 0.01, slope((s[..., 1:] + s[..., :-1]) / 2, slopes)
    whole = np.abs(((s[..., 1:] + s[..., :-1]) / 2)[..., None] - knots(6)).min(-1) > 0.006
    np.testing.assert_allclose(rises[whole], middle[whole], atol=1e-9)


def test_what_is_not_a_number_reads_the_first_piece():
    """A diverged run, whose states are no numbers any more, gives no number and no error."""
    assert np.isnan(value(np.array([[np.nan]]), np.full((1, 5), 0.5)))


def test_the_table_of_a_curve_is_the_curve_shifted():
    """The expression in the model is f(x + shift)."""
    slopes, x = np.random.default_rng(1).uniform(size=7), np.linspace(-5, 5, 101)
    found = scalar_function(table(slopes, 0.3)).value(x)
    np.testing.assert_allclose(found, value(x[None] + 0.3, slopes[None])[0], atol=1e-12)
