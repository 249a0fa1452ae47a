"""`rbfmu chart SCENE`: what table and picture say, on made-up figures."""

import math
import random
from dataclasses import replace

import pytest

from rbfmu.studies.chart import contestants, findings, tables
from rbfmu.studies.chart.result import KINDS, STOPPED, Chart, End, Row
from rbfmu.studies.chart.tables import WIDTH
from tests.support.covering import some_of
from tests.support.pictures import overlaps


def _row(kind: str, method: str, family: str, error: float, micros: float, **more: object) -> Row:
    row = Row(kind, method, "", family, "tolerance", 1e-6, error, 1e-6 * micros, 2e-6 * micros, 1.05, math.nan)
    return replace(row, **more)


def made_up(peer: float, scene: str = "it", **changes: object) -> Chart:
    """A plan of 1 us at 1e-6, a peer that costs so many, one that is too slow, and one that never gets there."""
    detail = "elliptic functions, Gauss's rule of 16 points"
    plan = _row("rbfmu's plan", "rbfmu, as planned", "planned", 2e-7, 1.0, detail=detail)
    peers_rows = [_row("heyoka.py", "heyoka.py", "peer", 10.0**-k, peer * 1.2 ** (k - 6)) for k in range(3, 14)]
    slow = [_row("MuJoCo", "MuJoCo implicitfast", "peer", 10.0**-k, 900.0 * 2.0**k) for k in range(1, 4)]
    others = [_row("RK4, Euler and others", "RK4, quaternion not normalised", "classic", 10.0**-k, 3.0 * 2.0**k)
              for k in range(1, 13)]  # fmt: skip
    ends = [End(row.kind, row.method, row.error, why) for row, why in
            ((peers_rows[-1], "all settings tried"), (slow[-1], STOPPED), (others[-1], STOPPED))]  # fmt: skip
    further = [replace(plan, value=1e-7, error=9e-9, seconds=1.5e-6), replace(plan, value=1e-8, seconds=4e-6)]
    chart = Chart(
        scene, "torque-free body, body force", 1e-6, 2.0, 400, ("torque_b",),
        (*others, *peers_rows, *slow, plan, *further), tuple(ends),
        (contestants.TooSmall("torque-free symmetric body", 0.37), contestants.TooSmall("angular momentum", math.inf,
         "shows no attitude")), ("Drake: not installed",), "1e-09: refused", ("a processor",),
    )  # fmt: skip
    return replace(chart, **changes)


@pytest.mark.parametrize(
    ("peer", "first", "second"),
    [
        (3.0, "it at 1e-6, ports at zero: use rbfmu's plan, 1.0 µs per", "best peer heyoka.py, 3.0 x that"),
        (1.02, "use rbfmu's plan", "heyoka.py is even"),
        (0.97, "use rbfmu's plan", "heyoka.py is even"),
        (0.5, "cheapest is heyoka.py, 500 ns per simulated second", "rbfmu's plan costs 2.0 x that"),
    ],
)
def test_the_headline_names_what_to_use(peer: float, first: str, second: str) -> None:
    lines = list(tables.headline(made_up(peer)))
    assert first in lines[0]
    assert second in lines[1]


def test_noise_is_that_of_what_costs_about_as_much_as_the_plan() -> None:
    noisy = [replace(row, spread=9.0 if row.seconds > 1e-5 else row.spread) for row in made_up(3.0).rows]
    assert findings.noise(made_up(3.0, rows=tuple(noisy))) == pytest.approx(1.05)
    noisy = [replace(row, spread=1.4) for row in made_up(3.0).rows]
    assert findings.noise(made_up(3.0, rows=tuple(noisy))) == pytest.approx(1.4)


def test_the_table_has_every_answer() -> None:
    text = made_up(3.0).table
    assert "MuJoCo                stopped: 1e-3 by MuJoCo implicitfast (stopped: time limit)" in text
    assert "torque-free symmetric body          0.37     3.7e+05 x" in text
    assert "shows no attitude" in text
    assert "1e-7      elliptic functions, Gauss's rule of 16" in text
    assert "1e-09: refused" in text
    assert "torque_b at zero" in text
    assert "Drake: not installed" in text
    assert max(map(len, text.splitlines())) <= WIDTH


def test_a_method_stopped_by_time_is_not_said_to_be_unable() -> None:
    one = made_up(3.0)
    unable = made_up(3.0, ends=tuple(replace(end, why="no more digits") for end in one.ends))
    for chart, word, other in ((one, "stopped", "misses"), (unable, "misses", "stopped")):
        labels = [text.get_text() for axes in chart.figure().axes for text in axes.texts]
        assert f"MuJoCo  {word}" in labels
        assert f"MuJoCo  {other}" not in labels
    assert "MuJoCo                misses it: 1e-3 by MuJoCo implicitfast (no more digits)" in unable.table


def test_the_picture_s_words_name_further_digits_and_models() -> None:
    small = [*made_up(3.0).too_small, *(contestants.TooSmall(m, 1e-9, "takes no torque_b") for m in ("one", "two"))]
    words = " ".join(text.get_text() for text in made_up(3.0, too_small=tuple(small)).figure().texts)
    assert "1e-7: 1.5 x, 1e-8: 4.0 x, no plan at 1e-09" in words
    assert "their errors: torque-free symmetric body 0.37. Models without torque_b: one, two." in words
    even = [replace(row, seconds=1e-6) for row in made_up(3.0).plans]
    others = [row for row in made_up(3.0).rows if row.family != "planned"]
    words = " ".join(text.get_text() for text in made_up(3.0, rows=(*others, *even)).figure().texts)
    assert "1e-7 to 1e-8: 1.0 x" in words


def test_costs_within_a_decade_have_no_labels_of_another_kind() -> None:
    one = made_up(3.0)
    figure = replace(one, rows=one.plans[:1], ends=()).figure()
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert not any(tick.label1.get_text() for tick in axes.yaxis.get_minor_ticks())


def test_a_part_of_a_run_is_said_to_be_one() -> None:
    assert "the first 2 s of 500 s" in tables.conditions(made_up(3.0, whole=500.0))


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (1.2e-15, "1.2 fs"),
        (3.4e-13, "340 fs"),
        (5e-12, "5.0 ps"),
        (1.54e-8, "15 ns"),
        (9.96e-6, "10 µs"),
        (1.06e-6, "1.1 µs"),
        (0.25, "250 ms"),
        (1.5, "1.5 s"),
    ],
)
def test_costs_have_units_of_their_size(seconds: float, text: str) -> None:
    assert tables.cost_text(seconds) == text


def crowded(seed: int) -> Chart:
    """All kinds of methods, whose lines end anywhere."""
    draw, rows, ends = random.Random(seed), [], []
    for kind in KINDS:
        cost, best = 10.0 ** draw.uniform(-1.0, 4.0), draw.randint(4, 15)
        if kind != "rbfmu's plan":
            mine = [_row(kind, kind, "peer", 10.0**-k, cost * 1.3**k) for k in range(draw.randint(1, 3), best)]
            rows += mine
            ends.append(End(kind, kind, mine[-1].error, STOPPED))
    one = made_up(1.0, draw.choice(("it", "a_satellite_with_a_long_name_that_somebody_gave_it")))
    accuracy = 10.0 ** -draw.randint(1, 13)
    plans = [replace(row, value=accuracy * 0.1**k) for k, row in enumerate(one.plans)]
    return replace(one, rows=(*rows, *plans), ends=tuple(ends), accuracy=accuracy)


@pytest.mark.parametrize("seed", some_of(range(12), 3))
def test_no_label_of_the_picture_lies_on_another(seed: int) -> None:
    assert overlaps(crowded(seed).figure()) == []
    assert max(map(len, crowded(seed).table.splitlines())) <= WIDTH
