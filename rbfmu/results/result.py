"""The result of a run: its quantities over time, and the files that it is saved to."""

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.exceptions import named
from rbfmu.notebook import numbers_text, table
from rbfmu_kernels.quantities import OUTPUT, TIME

Array = NDArray[np.float64]
FORMATS = (".csv", ".npz")
CHUNK = 1024
"""Rows that a CSV's writer holds as text."""


def check_shape(name: str, values: Array, points: int) -> None:
    """Raise ValueError where a quantity's array, or that of the times, has not the shape of so many points in time."""
    size = OUTPUT[name].size if name in OUTPUT else 1
    shape = (points, size) if size > 1 else (points,)
    if values.shape != shape:
        raise ValueError(f"{name} has the shape {values.shape}: expected {shape}")


class Result:
    """A simulated scene: `.time` (n,) in s, and one (n,) or (n, k) array per quantity by attribute.

    Raises ValueError for what is no quantity of a scene, and for arrays of another shape.
    """

    def __init__(self, time: Any, quantities: Mapping[str, Any]) -> None:
        self.time: Array = np.asarray(time, dtype=np.float64)
        self.quantities: dict[str, Array] = {
            name: np.asarray(values, dtype=np.float64) for name, values in quantities.items()
        }
        for name, values in self.quantities.items():
            if name not in OUTPUT:
                raise ValueError(f"quantity {name!r}: expected some of {', '.join(OUTPUT)}")
            check_shape(name, values, len(self.time))

    def __getattr__(self, name: str) -> Array:
        try:
            return self.__dict__["quantities"][name]  # type: ignore[no-any-return]
        except KeyError:
            known = ", ".join(self.__dict__.get("quantities", ()))
            raise AttributeError(f"no quantity {name!r} in this result; it has time, {known}") from None

    def __repr__(self) -> str:
        return f"Result({len(self.time)} points, {', '.join(self.quantities)})"

    def _repr_html_(self) -> str:
        header = ("quantity", "unit", *(f"t = {self.time[k]:g} s" for k in (0, -1)), "smallest", "largest")
        rows = (
            (name, OUTPUT[name].unit, *map(numbers_text, (v[0], v[-1], v.min(axis=0), v.max(axis=0))))
            for name, v in self.quantities.items()
        )
        return table(f"{len(self.time)} points in time", header, rows)

    def plot(self, path: str | Path | None = None, title: str = "") -> Any:
        """Draw one panel for each quantity over time, and return the matplotlib.figure.Figure, which notebooks show.

        path: a file to draw to, whose ending (.png, .svg, .pdf) sets the format.
        """
        from rbfmu.plot import drawn, plot_result

        return drawn(self, title) if path is None else plot_result(self, path, title)

    def to_dataframe(self) -> Any:
        """Return a pandas.DataFrame: time (s) as index, a column for each FMU variable, units in `.attrs["units"]`."""
        from rbfmu.results.tables import dataframe

        return dataframe(self)

    def to_xarray(self) -> Any:
        """Return a xarray.Dataset: a variable for each quantity, with the names of its components and its unit."""
        from rbfmu.results.tables import dataset

        return dataset(self)

    def columns(self) -> dict[str, Array]:
        """Return flat columns by FMU variable name: time, quaternion[1], ..."""
        columns = {"time": self.time}
        for name, values in self.quantities.items():
            if values.ndim == 1:
                columns[name] = values
            else:
                columns |= {f"{name}[{i + 1}]": values[:, i] for i in range(values.shape[1])}
        return columns

    @property
    def units(self) -> dict[str, str]:
        """Return the SI units of time and of each quantity."""
        return {"time": TIME.unit} | {name: OUTPUT[name].unit for name in self.quantities}

    def until(self, stop: float | None) -> "Result":
        """Return the part up to this time (s), all where it is None."""
        if stop is None:
            return self
        n = int(np.searchsorted(self.time, stop, side="right"))
        return Result(self.time[:n], {name: values[:n] for name, values in self.quantities.items()})

    @classmethod
    def of_rows(cls, rows: Iterable[Mapping[str, Any]]) -> "Result":
        """Return the result of a loop: a row for each time, as `Simulator.values` gives it.

        Raises ValueError where there is none, and for what is no quantity.
        """
        if not (listed := list(rows)):
            raise ValueError("rows = []: expected at least one, as Simulator.values gives them")
        columns = {name: np.array([row[name] for row in listed]) for name in listed[0]}
        return cls(columns.pop("time"), columns)

    @classmethod
    def load(cls, path: str | Path) -> "Result":
        """Read what `save` wrote, or a CSV that an FMU's importer wrote; columns that are no quantity are left out.

        Raises ValueError where the file has no time, an incomplete quantity or a number that is not finite.
        """
        from rbfmu.results.files import read_result

        return cls(*read_result(Path(path)))

    def save(self, path: str | Path) -> None:
        """Write `.csv` (FMU variable names, every digit) or `.npz` (arrays by quantity).

        A CSV's units stand in a second file beside it: those of `run.csv` in `run.units.csv`, a line a column with
        name, unit and meaning, so that the first keeps one header and serves as an FMU's input in FMPy.
        """
        path = Path(path)
        if path.suffix == ".npz":
            with named(path):
                np.savez(path, time=self.time, **self.quantities)  # type: ignore[arg-type]
        elif path.suffix == ".csv":
            self._write_csv(path)
            self._write_units(path.with_suffix(".units.csv"))
        else:
            raise ValueError(f"cannot save to {str(path)!r}: the name must end in .csv or .npz")

    def _write_csv(self, path: Path) -> None:
        columns = self.columns()
        with named(path), path.open("w") as file:
            file.write(",".join(f'"{name}"' for name in columns) + "\n")
            for first in range(0, len(self.time), CHUNK):
                rows = zip(*(c[first : first + CHUNK].tolist() for c in columns.values()), strict=True)
                file.writelines(",".join(map(repr, row)) + "\n" for row in rows)

    def _write_units(self, path: Path) -> None:
        known = {"time": TIME} | OUTPUT
        with named(path), path.open("w", newline="") as file:
            table = csv.writer(file, quoting=csv.QUOTE_ALL, lineterminator="\n")
            table.writerow(("name", "unit", "meaning"))
            rows = ((name, known[name.split("[")[0]]) for name in self.columns())
            table.writerows((name, row.unit, row.meaning) for name, row in rows)
