"""Lines of angles: gaps where they lose a turn, none where they count on."""

import numpy as np

from rbfmu import plot as charts


def test_a_line_of_angles_has_a_gap_where_it_loses_a_turn() -> None:
    time, angles = np.arange(6.0), np.array([3.0, 3.1, -3.1, -3.0, 3.0, 2.0])
    t, y = charts.with_gaps(time, angles, 2.0 * np.pi)
    assert np.isnan(y).nonzero()[0].tolist() == [2, 5]
    assert y[~np.isnan(y)].tolist() == angles.tolist()
    assert t[~np.isnan(y)].tolist() == time.tolist()
    assert charts.with_gaps(time, angles, np.inf)[1].tolist() == angles.tolist()


def test_an_angle_that_counts_on_is_a_line_without_gaps() -> None:
    """2026-11-27: where a wheel turned by more than half a turn between all points, nothing was drawn."""
    time, angles = np.arange(4.0), np.array([0.0, 10.0, 20.0, np.nan])
    assert charts.with_gaps(time, angles, 2.0 * np.pi)[1].tolist()[:3] == [0.0, 10.0, 20.0]
