"""Attitude Ephemeris Messages: the standard's own examples, both its issues, and files that go round."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rbfmu
from rbfmu.aem import EPOCH
from rbfmu.cli import main
from rbfmu.result import Result
from tests.support.paths import SCENES
from tests.support.references.exact import EPS

HEAD = """CCSDS_AEM_VERS = 2.0
CREATION_DATE = 2002-11-04T17:22:31
ORIGINATOR    = NASA/JPL
MESSAGE_ID    = A701523
"""
FIRST_SEGMENT = """
META_START
COMMENT This file was produced by M.R. Somebody, MSOO NAV/JPL.
OBJECT_NAME       = MARS_GLOBAL_SURVEYOR
OBJECT_ID         = 1996-062A
CENTER_NAME       = MARS BARYCENTER
REF_FRAME_A       = EME2000
REF_FRAME_B       = SC_BODY_1
TIME_SYSTEM       = UTC
START_TIME        = 1996-11-28T21:29:07.2555
STOP_TIME         = 1996-11-30T01:28:02.5555
ATTITUDE_TYPE     = QUATERNION
INTERPOLATION_METHOD = HERMITE
INTERPOLATION_DEGREE = 7
META_STOP

DATA_START
1996-11-28T21:29:07.2555 0.56748 0.03146 0.45689 0.68427
1996-11-28T22:08:03.5555 0.42319 -0.45697 0.23784 0.74533
1996-11-28T22:08:04.5555 -0.84532 0.26974 -0.06532 0.45652
1996-11-30T01:28:02.5555 0.74563 -0.45375 0.36875 0.31964
DATA_STOP
"""
SECOND_SEGMENT = """
META_START
COMMENT This block begins after trajectory correction maneuver TCM-3.
OBJECT_NAME       = mars_global_surveyor
REF_FRAME_A       = EME2000
REF_FRAME_B       = SC_BODY_1
TIME_SYSTEM       = UTC
START_TIME        = 1996-12-18T12:05:00.5555
STOP_TIME         = 1996-12-28T21:28:00.5555
ATTITUDE_TYPE     = QUATERNION
META_STOP

DATA_START
1996-12-18T12:05:00.5555 -0.64585 0.018542 -0.23854 0.72501
1996-12-28T21:28:00.5555 -0.25485 0.58745 -0.36845 0.67394
DATA_STOP
"""


def read(text: str, folder: Path) -> Result:
    path = folder / "it.aem"
    path.write_text(text)
    return Result.load(path)


def test_the_standard_s_example_is_read(tmp_path: Path) -> None:
    """Figure G-4 of CCSDS 504.0-B-2, without the lines that it leaves out itself."""
    found = read(HEAD + FIRST_SEGMENT + SECOND_SEGMENT, tmp_path)
    day = 86400.0
    first = [0.0, 2336.3, 2337.3, day + 14335.3]
    np.testing.assert_array_equal(found.time[:4], first)
    assert found.time[4] == 20 * day - (21 * 3600 + 29 * 60 + 7.2555) + (12 * 3600 + 5 * 60 + 0.5555)
    assert found.quaternion[0].tolist() == [0.68427, 0.56748, 0.03146, 0.45689]
    assert found.quaternion[-1].tolist() == [0.67394, -0.25485, 0.58745, -0.36845]
    assert list(found.quantities) == ["quaternion"]


def short(*lines: str, kind: str = "QUATERNION", a: str = "EME2000", b: str = "SC_BODY_1", **others: str) -> str:
    """A message of a few lines, as CCSDS 504.0-B-1 has them: without DATA_START."""
    keys = {"REF_FRAME_A": a, "REF_FRAME_B": b, "TIME_SYSTEM": "UTC", "ATTITUDE_TYPE": kind, **others}
    meta = [f"{key} = {value}" for key, value in keys.items()]
    return "\n".join(["CCSDS_AEM_VERS = 1.0", "META_START", *meta, "META_STOP", *lines])


QUARTER = "0.7071067811865476"
ABOUT_Z = f"2000-01-01T12:00:00 0.0 0.0 {QUARTER} {QUARTER}"
X_OF_BODY = [0.0, 1.0, 0.0]
"""In A, of the standard's example F2.2: B is turned from A by 90 deg about Z."""


@pytest.mark.parametrize(("text", "expected"), [
    (short(ABOUT_Z), X_OF_BODY),
    (short(ABOUT_Z, ATTITUDE_DIR="A2B", QUATERNION_TYPE="LAST"), X_OF_BODY),
    (short(f"2000-001T12:00:00Z {QUARTER} 0 0 {QUARTER}", QUATERNION_TYPE="FIRST"), X_OF_BODY),
    (short(ABOUT_Z, ATTITUDE_DIR="B2A"), [0.0, -1.0, 0.0]),
    (short(ABOUT_Z, a="SC_BODY_1", b="ICRF"), [0.0, -1.0, 0.0]),
    (short(ABOUT_Z, a="sc_body_1", b="icrf", ATTITUDE_DIR="B2A"), X_OF_BODY),
    (short(ABOUT_Z, a="SC_BODY_1", b="INSTRUMENT_A"), X_OF_BODY),
    (short(ABOUT_Z, a="SC_BODY_1", b="SC_BODY_2"), X_OF_BODY),
    (short(ABOUT_Z, a="STARTRACKER_2", b="GTOD"), [0.0, -1.0, 0.0]),  # 2026-11-30: was read as GTOD's attitude
    (short(ABOUT_Z, a="RSW", b="GYRO_FRAME_1"), X_OF_BODY),
    (short(ABOUT_Z).replace("VERS = 1.0", "VERS = 0.2"), X_OF_BODY),
    (short(ABOUT_Z + " 1 2 3", kind="QUATERNION/RATE"), X_OF_BODY),
    (short(ABOUT_Z + " 1 2 3 4", kind="QUATERNION/DERIVATIVE"), X_OF_BODY),
])  # fmt: skip
def test_order_frames_and_direction_are_those_of_the_standard(text: str, expected: list, tmp_path: Path) -> None:
    found = read(text, tmp_path)
    np.testing.assert_allclose(rbfmu.rotate(found.quaternion[0], [1.0, 0.0, 0.0]), expected, atol=2.0 * EPS)
    assert list(found.quantities) == ["quaternion"]


@pytest.mark.parametrize(("frames", "frame", "name", "sign"), [
    (("EME2000", "SC_BODY_1"), "SC_BODY_1", "omega_b", 1.0),
    (("EME2000", "SC_BODY_1"), "REF_FRAME_B", "omega_b", 1.0),
    (("EME2000", "SC_BODY_1"), "EME2000", "omega_a", 1.0),
    (("SC_BODY_1", "EME2000"), "SC_BODY_1", "omega_b", -1.0),
    (("SC_BODY_1", "EME2000"), "EME2000", "omega_a", -1.0),
    (("EME2000", "SC_BODY_1"), "ITRF", None, 0.0),
])  # fmt: skip
def test_rates_are_those_of_the_body(frames: tuple, frame: str, name: str, sign: float, tmp_path: Path) -> None:
    """The standard's angular velocity is that of B relative to A, in deg/s."""
    line = ABOUT_Z + " 180.0 -90.0 0.0"
    text = short(line, kind="QUATERNION/ANGVEL", a=frames[0], b=frames[1], ANGVEL_FRAME=frame)
    found = read(text, tmp_path)
    assert [*found.quantities][1:] == ([name] if name else [])
    if name:
        np.testing.assert_allclose(found.quantities[name], [[sign * np.pi, -sign * np.pi / 2, 0.0]])


def test_rates_that_are_not_of_one_frame_are_left_out(tmp_path: Path) -> None:
    later = ABOUT_Z.replace("T12", "T13")
    parts = [short(f"{line} 1.0 2.0 3.0", kind="QUATERNION/ANGVEL", ANGVEL_FRAME=frame)
             for line, frame in ((ABOUT_Z, "EME2000"), (later, "SC_BODY_1"))]  # fmt: skip
    assert [*read(parts[0], tmp_path).quantities] == ["quaternion", "omega_a"]
    assert [*read("\n".join([parts[0], *parts[1].split("\n")[1:]]), tmp_path).quantities] == ["quaternion"]


def test_a_segment_has_keys_of_its_own_and_days_are_those_of_a_year_too(tmp_path: Path) -> None:
    first = short(f"2000-02-29T12:00:00 {QUARTER} 0 0 {QUARTER}", QUATERNION_TYPE="FIRST")
    later = short(ABOUT_Z.replace("2000-01-01", "2000-061")).partition("\n")[2]  # 61 days are January, February and one
    found = read(f"{first}\n{later}", tmp_path)
    assert found.time.tolist() == [0.0, 86400.0]
    assert found.quaternion[0].tolist() == found.quaternion[1].tolist()


def test_where_a_segment_begins_as_another_ends_its_line_counts(tmp_path: Path) -> None:
    """2026-11-30: files whose segments share a time, as the standard allows, were refused."""
    turned = short(ABOUT_Z).partition("\n")[2]
    first = short(ABOUT_Z.replace("T12", "T11"), "2000-01-01T12:00:00 0.0 0.0 0.0 1.0")
    found = read(f"{first}\n{turned}\n{ABOUT_Z.replace('T12', 'T13')}", tmp_path)
    assert found.time.tolist() == [0.0, 3600.0, 7200.0]
    assert found.quaternion[1].tolist() == found.quaternion[2].tolist()
    for twice in (f"{first}\n{turned}\n{ABOUT_Z}", f"{first}\n{turned.replace('T12', 'T11')}"):
        with pytest.raises(ValueError, match="expected times that increase"):
            read(twice, tmp_path)


def test_a_file_may_begin_with_the_mark_of_utf_8(tmp_path: Path) -> None:
    """2026-11-30: such a file, as Windows' editors write it, was refused."""
    assert read(f"\ufeff{short(ABOUT_Z)}", tmp_path).time.tolist() == [0.0]


def test_a_comment_may_have_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "it.aem"
    path.write_bytes(short(ABOUT_Z).replace("META_STOP", "COMMENT Andr\xe9\nMETA_STOP").encode("latin-1"))
    assert len(Result.load(path).time) == 1


def some_result(time: list[float]) -> Result:
    random = np.random.default_rng(3)
    q = rbfmu.normalize(random.normal(size=(len(time), 4)) * 10.0 ** random.uniform(-9, 0, (len(time), 4)))
    q[0] = [1.0, 0.0, 1e-7, 1e-200]
    return Result(time, {"quaternion": q, "omega_b": random.normal(size=(len(time), 3))})


@pytest.mark.parametrize("time", [
    (0.1 * np.arange(50)).tolist(),
    [-1e9, -43200.0, -0.1, 0.1 + 0.2, 1e-9 + 1.0, 59.99999999999999, 60.0, 86399.9, 1e6 / 3.0, 1e9],
    [5.0, 5.000000000000001, 10.0],
    [-1e-9 / 3.0, 1e-300, 3.5966052440001177e-09, 1e-6 / 7.0],
])  # fmt: skip
def test_times_and_attitudes_go_round_to_the_last_digit(time: list[float], tmp_path: Path) -> None:
    """Rates are turned into deg/s and back."""
    saved, path = some_result(time), tmp_path / "it.aem"
    saved.save(path)
    again = Result.load(path)
    assert again.time.tolist() == saved.time.tolist()
    assert again.quaternion.tolist() == saved.quaternion.tolist()
    np.testing.assert_allclose(again.omega_b, saved.omega_b, rtol=2.0 * EPS)
    again.save(path)
    assert Result.load(path).quaternion.tolist() == saved.quaternion.tolist()


def test_what_is_written_is_as_the_standard_says(tmp_path: Path) -> None:
    """Mandatory keys in their order, a point in every number, no -0, times within START_TIME and STOP_TIME."""
    result = some_result([0.0, 0.5, 86400.25])
    result.quaternion[1] = [0.0, -0.0, 1.0, 0.0]
    result.save(tmp_path / "it.aem")
    lines = (tmp_path / "it.aem").read_text().splitlines()
    keys = [line.partition(" =")[0] for line in lines if line and not line.startswith("COMMENT")]
    assert keys[:15] == [
        "CCSDS_AEM_VERS", "CREATION_DATE", "ORIGINATOR", "META_START", "OBJECT_NAME", "OBJECT_ID", "REF_FRAME_A",
        "REF_FRAME_B", "TIME_SYSTEM", "START_TIME", "STOP_TIME", "ATTITUDE_TYPE", "ANGVEL_FRAME", "META_STOP",
        "DATA_START",
    ]  # fmt: skip
    assert f"START_TIME = {EPOCH}.0" in lines
    assert "STOP_TIME = 2000-01-02T12:00:00.25" in lines
    data = [line.split() for line in lines[lines.index("DATA_START") + 1 : -1]]
    assert [row[0] for row in data] == [f"{EPOCH}.0", f"{EPOCH}.5", "2000-01-02T12:00:00.25"]
    assert data[1][1:5] == ["0.0", "1.0", "0.0", "0.0"]
    assert all(re.fullmatch(r"-?\d+\.\d+(e[-+]\d+)?", x) for row in data for x in row[1:])
    assert lines[-1] == "DATA_STOP"


def changed(old: str, new: str) -> str:
    text = HEAD + FIRST_SEGMENT
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(("text", "said"), [
    ("", "line 1: '': expected CCSDS_AEM_VERS = 2.0 or 1.0, in keyword-value notation"),
    ('<?xml version="1.0"?>', "line 1: '<?xml version=\"1.0\"?>': expected CCSDS_AEM_VERS = 2.0"),
    (changed("CCSDS_AEM_VERS = 2.0", "CCSDS_OEM_VERS = 2.0"), "line 1: 'CCSDS_OEM_VERS = 2.0': expected"),
    (changed("REF_FRAME_B       =", "FRAME_B ="), "line 22: REF_FRAME_B is missing before the first attitude"),
    (changed("= QUATERNION\n", "= SPIN\n"), "line 22: ATTITUDE_TYPE = SPIN: expected one of QUATERNION, "),
    (changed("0.45689 0.68427", "0.45689"), "line 22: expected a time and 4 numbers"),
    (changed("0.45689 0.68427", "0.45689 none"), "line 22: could not convert string to float: 'none'"),
    (changed("0.45689 0.68427", "0.45689 nan"), "line 22: quaternion 0.56748 0.03146 0.45689 nan: expected one of l"),
    (changed("0.45689 0.68427", "0.45689 0.9"), "line 22: quaternion 0.56748 0.03146 0.45689 0.9: expected one of l"),
    (changed("0.45689 0.68427", "0.45689 0.69"), "line 22: quaternion 0.56748 0.03146 0.45689 0.69: expected one of "),
    (changed("1996-11-28T22:08:03.5555", "1996-11-28"), "line 23: '1996-11-28': expected a time such as 2000-01-01T"),
    (changed("1996-11-28T22:08:03.5555", "1996-13-28T22:08:03"), "line 23: month must be in 1..12"),
    (changed("1996-11-28T22:08:03.5555", "1996-11-28T22:61:03"), "line 23: '1996-11-28T22:61:03': expected a time su"),
    (changed("1996-11-28T22:08:03.5555", "1996-11-28T24:08:03"), "line 23: '1996-11-28T24:08:03': expected a time su"),
    (changed("1996-11-28T22:08:03.5555", "1996-11-28T22:08:61"), "line 23: '1996-11-28T22:08:61': expected a time su"),
    (changed("1996-11-28T22:08:03.5555", "1997-366T22:08:03"), "line 23: '1997-366T22:08:03': expected a day of 1997"),
    (changed("1996-11-28T22:08:03.5555", "9999-366T22:08:03"), "line 23: '9999-366T22:08:03': expected a day of 9999"),
    (changed("1996-11-28T22:08:03.5555", "1997-000T22:08:03"), "line 23: '1997-000T22:08:03': expected a day of 1997"),
    (changed("1996-11-28T22:08:03.5555", "1996-11-28T20:08:03"), "in row 2: expected times that increase"),
    (changed("1996-11-28T22:08:03.5555", "QUATERNION_TYPE = FIRST\n1996"), "line 23: expected a time and 4 numbers"),
    (HEAD + FIRST_SEGMENT.partition("DATA_START")[0], "line 20: expected lines of attitudes"),
    (changed("0.31964\nDATA_STOP", "0.3196"), "line 25: expected DATA_STOP after the attitudes; the file has been cut"),
])  # fmt: skip
def test_a_bad_file_is_one_message(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=re.escape(said)) as refused:
        read(text, tmp_path)
    assert str(refused.value).startswith(f"{tmp_path / 'it.aem'}: ")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("time", "quaternion", "rate", "said"), [
    ([0.0, 1.0], [2.0, 0.0, 0.0, 0.0], 0.1, "quaternion = [2.0, 0.0, 0.0, 0.0] in row 1: expected one of length 1"),
    ([0.0, 1.0], [1.0, 0.0, 0.0, 0.0], math.inf, "omega_b = inf in row 1: expected numbers"),
    ([1.0, 0.5], [1.0, 0.0, 0.0, 0.0], 0.1, "time = 0.5 in row 2: expected times that increase"),
    ([0.0, 1e15], [1.0, 0.0, 0.0, 0.0], 0.1, "time = 1000000000000000.0 s: expected one within some thousand years"),
    ([0.0, math.nan], [1.0, 0.0, 0.0, 0.0], 0.1, "time = nan in row 2: expected numbers"),
    ([0.0, 1.0], [math.nan, 0.0, 0.0, 0.0], 0.1, "quaternion = nan in row 1: expected numbers"),
])  # fmt: skip
def test_what_could_not_be_read_again_is_not_written(
    time: list, quaternion: list, rate: float, said: str, tmp_path: Path
) -> None:
    """2026-11-29: each was written, and refused where it was read."""
    path = tmp_path / "it.aem"
    with pytest.raises(ValueError, match=re.escape(said)):
        Result(time, {"quaternion": [quaternion] * 2, "omega_b": [[rate] * 3] * 2}).save(path)
    assert not path.exists()


def test_a_run_is_written_and_shown(tmp_path: Path) -> None:
    path, page, scene = tmp_path / "brick.aem", tmp_path / "brick.html", SCENES / "tumbling_brick.toml"
    done = CliRunner().invoke(main, ["run", str(scene), "--stop", "0.5", "-o", str(path)])
    assert done.exit_code == 0, done.output
    run = rbfmu.simulate(rbfmu.load_scene(scene).replace(run={"stop": 0.5}))
    read = Result.load(path)
    assert read.time.tolist() == run.time.tolist()
    assert read.quaternion.tolist() == run.quaternion.tolist()
    done = CliRunner().invoke(main, ["view", str(path), "-o", str(page)])
    assert done.exit_code == 0, done.output
    assert page.stat().st_size > 1e5


def test_a_run_without_attitude_is_refused_before_it_begins(tmp_path: Path) -> None:
    scene = tmp_path / "rates.toml"
    scene.write_text("body = {mass = 1, inertia = [1, 2, 2.5]}\noutputs = {quantities = ['omega_b']}")
    done = CliRunner().invoke(main, ["run", str(scene), "-o", str(tmp_path / "it.aem")])
    assert done.exit_code == 2
    assert "expected the quantity quaternion" in done.output
    assert not (tmp_path / "it.aem").exists()
