"""Results that are read back are those that were saved; what cannot be one is refused in one message."""

from pathlib import Path

import numpy as np
import pytest

from rbfmu.result import Result
from rbfmu_kernels.quantities import OUTPUT

GOOD = "time,omega_b[1],omega_b[2],omega_b[3]\n"


def result() -> Result:
    random = np.random.default_rng(1)
    shapes = {row.name: (7, row.size) if row.size > 1 else (7,) for row in OUTPUT.values()}
    return Result(0.1 * np.arange(7), {name: random.normal(size=shape) for name, shape in shapes.items()})


@pytest.mark.parametrize("ending", [".csv", ".npz"])
def test_what_is_saved_is_read_to_the_bit(ending: str, tmp_path: Path) -> None:
    saved = result()
    saved.save(tmp_path / f"it{ending}")
    read = Result.load(tmp_path / f"it{ending}")
    np.testing.assert_array_equal(read.time, saved.time)
    assert list(read.quantities) == list(saved.quantities)
    for name, values in saved.quantities.items():
        np.testing.assert_array_equal(read.quantities[name], values)


def test_columns_of_others_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "fmu.csv").write_text('"status",' + GOOD + "0,0.0,1,2,3\n0,0.5,4,5,6\n")
    read = Result.load(tmp_path / "fmu.csv")
    assert list(read.quantities) == ["omega_b"]
    np.testing.assert_array_equal(read.omega_b, [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "time is missing"),
        ("time,omega_b[1],omega_b[3]\n0,1,2\n", r"omega_b\[2\] is missing"),
        (GOOD + "0,1,2,3\n0,1,2,3\n", r"time = 0.0 in row 2: expected times that increase"),
        (GOOD + "0,1,2,3\n1,1,nan,3\n", r"omega_b = nan in row 2: expected numbers"),
        (GOOD + "0,1,2,3\n1,1,2\n", "expected numbers"),
        (GOOD + "0,1,2\n", "expected a row of 4 numbers"),
        (GOOD + "0,1,2,x\n", "expected numbers"),
    ],
)
def test_what_is_no_result_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "it.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        Result.load(tmp_path / "it.csv")


def test_arrays_that_are_no_result_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "it.npz"
    np.savez(path, time=np.arange(3.0), omega_b=np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"omega_b has the shape \(3, 2\): expected \(3, 3\)"):
        Result.load(path)
    path.write_text("no arrays")
    with pytest.raises(ValueError, match="cannot be read as arrays"):
        Result.load(path)
    with pytest.raises(ValueError, match=r"expected a name that ends in \.csv or \.npz"):
        Result.load(tmp_path / "it.txt")
