"""Pictures of results: names fit, and lines of angles have gaps where they lose a turn."""

import numpy as np

import rbfmu
from rbfmu.plot import with_gaps
from tests.support.scenes.balls import ball


def test_long_names_stay_within_their_picture_and_panel() -> None:
    name = "ratio_of_energy_to_momentum_squared_of_the_body"
    figure = rbfmu.simulate(ball(outputs={name: "t"})).plot(title="a title that is long " * 8)
    figure.draw_without_rendering()
    panel, label = figure.axes[-1], figure.axes[-1].yaxis.label
    assert figure.bbox.contains(*figure._suptitle.get_window_extent().min)
    assert label.get_window_extent().height < 1.3 * panel.get_window_extent().height
    assert label.get_text().replace("\n", "") == name


def test_names_of_three_events_at_one_time_do_not_overlap() -> None:
    events = {name: [0.5] for name in ("rise", "fall", "stop")}
    figure = rbfmu.Result([0.0, 1.0], {"kinetic_energy": [1.0, 2.0]}, None, events).plot()
    figure.draw_without_rendering()
    lows = sorted(text.get_window_extent().y0 for text in figure.axes[0].texts)
    assert np.diff(lows).min() > 8.0


def test_a_line_of_angles_has_a_gap_where_it_loses_a_turn() -> None:
    time, angles = np.arange(6.0), np.array([3.0, 3.1, -3.1, -3.0, 3.0, 2.0])
    t, y = with_gaps(time, angles, 2.0 * np.pi)
    assert np.isnan(y).nonzero()[0].tolist() == [2, 5]
    assert y[~np.isnan(y)].tolist() == angles.tolist()
    assert t[~np.isnan(y)].tolist() == time.tolist()
    assert with_gaps(time, angles, np.inf)[1].tolist() == angles.tolist()


def test_an_angle_that_counts_on_is_a_line_without_gaps() -> None:
    """2026-11-27: where a wheel turned by more than half a turn between all points, nothing was drawn."""
    time, angles = np.arange(4.0), np.array([0.0, 10.0, 20.0, np.nan])
    assert with_gaps(time, angles, 2.0 * np.pi)[1].tolist()[:3] == [0.0, 10.0, 20.0]
