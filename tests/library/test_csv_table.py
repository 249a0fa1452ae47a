"""Tables of CSV files: what stands in cells and between them, and what is said of it."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

import rbfmu
from rbfmu.csv_table import read_columns


def read(tmp_path, text, **more):
    path = tmp_path / "it.csv"
    path.write_text(text)
    return {name: column.tolist() for name, column in read_columns(path, **more).items()}


@pytest.mark.parametrize("text", [
    "time,x\n0,1\n2,3\n", "\n\ntime,x\n0,1\n\n2,3\n", 'time , x\n 0, " 1 "\n2 ,3\n', "time,x\r\n0,1\r\n2,3\r\n",
])  # fmt: skip
def test_empty_lines_and_spaces_say_nothing(tmp_path, text):
    assert read(tmp_path, text) == {"time": [0.0, 2.0], "x": [1.0, 3.0]}


def test_gaps_are_nan_in_any_case(tmp_path):
    found = read(tmp_path, "time,x,y\n0, NaN ,1\n1,,2\n", gaps=("", "nan"), holds=math.isfinite)
    assert found["y"] == [1.0, 2.0]
    assert np.isnan(found["x"]).all()


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="needs pipes that have paths")
def test_what_can_be_read_but_once_is_read_with_quotes_too():
    reading, writing = os.pipe()
    os.write(writing, b'time,x\n"0","1"\n')
    os.close(writing)
    try:
        columns = read_columns(Path(f"/dev/fd/{reading}"))
    finally:
        os.close(reading)
    assert {name: column.tolist() for name, column in columns.items()} == {"time": [0.0], "x": [1.0]}


@pytest.mark.parametrize(("text", "said"), [
    ("time,x\n0,1#2\n", r'x = "1#2" in row 1: expected a number'),
    ("time,x\n0,1 two\n", r'x = "1 two" in row 1: expected a number'),
    ("time,x\n0,1_0\n", r'x = "1_0" in row 1: expected a number'),
    ("time,x\n0,\u0661\n", r'x = ".*" in row 1: expected a number'),
    ("time,x\n0\n", "row 1 has 1 cells: expected 2, as many as the header"),
    ("time,x\n0,1 2\n0,1 2,3\n", r"row 2 has 3 cells: expected 2, as many as the header"),
    ("time\tx\n0\t1\n", "expected it in the header, with commas between columns, not time\tx"),
    ("x\n1\n", "expected it in the header, not x"),
])  # fmt: skip
def test_what_is_no_number_and_no_row_is_refused(tmp_path, text, said):
    with pytest.raises(rbfmu.SceneError, match=said):
        read(tmp_path, text)
