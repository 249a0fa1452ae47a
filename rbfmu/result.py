"""The result of a run: its quantities over time. It converts to pandas and xarray, and is saved to and read from files.

CSV files that importers of FMUs write can be read as well.
"""

import csv
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from numbers import Real
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal

import numpy as np

from rbfmu import csv_table, exceptions, extras, on_disk
from rbfmu.arrays.from_kernel import as_floats
from rbfmu.notebook import numbers_text, table
from rbfmu.types import Array, ArrayLike
from rbfmu_kernels.quantities import OUTPUT, TIME, Output, Quantity, elements, indices

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

FORMATS = (".csv", ".npz", ".aem")
ENDINGS = f"{', '.join(FORMATS[:-1])} or {FORMATS[-1]}"
EVENTS, TOUCHES = "events.", "touches."
"""The prefixes of the names of events and touches in an .npz."""
OF_EVENTS = ("time", "name", "kind")
"""The header of the file with a CSV's events."""
KINDS = {"event": EVENTS, "touch": TOUCHES}
"""The kinds in that file, each with its prefix in an .npz."""
AXES = {"quaternion": "parameter", "rpy": "angle"}
"""The names of the axes over components that are not along x, y, z, by quantity."""
CHUNK = 1024
"""The number of rows that the writer of a CSV converts at a time."""


def check_attitude(path: Path | None, quantities: Iterable[str]) -> None:
    """Raise ValueError if the path is that of an AEM and the quantities do not include the attitude."""
    if path is not None and path.suffix == ".aem" and "quaternion" not in quantities:
        raise ValueError(f"cannot save to {str(path)!r}: expected the quantity quaternion, which an AEM is of")


class Row(dict[str, Any]):
    """A time and the quantities at it, as `Simulator.values` returns them; own: the outputs of your own, by name."""

    def __init__(self, values: Mapping[str, Any], own: Mapping[str, Output]) -> None:
        super().__init__(values)
        self.own = own


class Result:
    """A simulated scene: `.time` (n,) in s, and each quantity as an attribute, (n,) or (n, k), in SI units.

    Raises ValueError for names that are not quantities, and for arrays of another shape.
    """

    def __init__(
        self,
        time: ArrayLike,
        quantities: Mapping[str, ArrayLike],
        own: Mapping[str, Output] | None = None,
        events: Mapping[str, ArrayLike] | None = None,
        touches: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """own: the outputs of your own, by name; events, touches: their times (n,) in s, by name.

        At an event a formula changes its sign; at a touch it reaches zero without a sign change.
        """
        self.time: Array = as_floats("Result", "time", time)
        if self.time.ndim != 1:
            raise ValueError(f"time has the shape {self.time.shape}: expected (n,)")
        self.events, self.touches, self.quantities = map(_arrays, (events or {}, touches or {}, quantities))
        known = {**OUTPUT, **(own or {})}
        if unknown := [name for name in self.quantities if name not in known]:
            raise ValueError(f"quantity {unknown[0]!r}: expected some of {', '.join(known)}")
        self.rows = {name: known[name] for name in self.quantities}
        for name, values in self.quantities.items():
            _check_shape(self.rows[name], values, len(self.time))

    def __getattr__(self, name: str) -> Array:
        try:
            return self.__dict__["quantities"][name]  # type: ignore[no-any-return]
        except KeyError:
            known = ", ".join(self.__dict__.get("quantities", ()))
            raise AttributeError(f"no quantity {name!r} in this result; it has time, {known}") from None

    def __repr__(self) -> str:
        return f"Result({len(self.time)} points, {', '.join(self.quantities)})"

    def _repr_html_(self) -> str:
        if not len(self.time):
            return table("0 points in time", ("quantity", "unit"), [(name, r.unit) for name, r in self.rows.items()])
        header = ("quantity", "unit", *(f"t = {self.time[k]:g} s" for k in (0, -1)), "smallest", "largest")
        shown = {name: (v[0], v[-1], v.min(axis=0), v.max(axis=0)) for name, v in self.quantities.items()}
        rows = ((name, self.rows[name].unit, *map(numbers_text, values)) for name, values in shown.items())
        return table(f"{len(self.time)} points in time", header, rows)

    def plot(self, path: str | Path | None = None, title: str = "") -> "Figure":
        """Draw one panel for each quantity over time, and return the matplotlib.figure.Figure, which notebooks show.

        path: a file to draw to, whose ending (.png, .svg, .pdf) sets the format.
        """
        from rbfmu.plot import plot_result

        return plot_result(self, path, title)

    def to_dataframe(self) -> "DataFrame":
        """Return a pandas.DataFrame: time (s) as index, a column for each FMU variable, units in `.attrs["units"]`."""
        table: DataFrame = extras.needed("pandas", "tables").DataFrame(self.columns()).set_index("time")
        table.attrs["units"] = self.units
        return table

    def to_xarray(self) -> "Dataset":
        """Return a xarray.Dataset: a variable for each quantity, with the names of its components and its unit."""
        variables: dict[str, object] = {}
        coordinates: dict[str, object] = {"time": ("time", self.time, {"units": TIME.unit, "long_name": TIME.meaning})}
        for name, values in self.quantities.items():
            row, axis = self.rows[name], AXES.get(name, "axis")
            axis += "_" * (axis in self.quantities)  # an output of your own may be called so
            attributes = {"units": row.unit, "long_name": row.meaning}
            variables[name] = ("time" if values.ndim == 1 else ("time", axis), values, attributes)
            if values.ndim == 2:
                coordinates[axis] = list(row.components)
        return extras.needed("xarray", "tables").Dataset(variables, coordinates)

    def columns(self) -> dict[str, Array]:
        """Return flat columns by FMU variable name: time, quaternion[1], ..."""
        columns = {"time": self.time}
        for name, values in self.quantities.items():
            components = values.T if values.ndim > 1 else [values]
            columns |= {name + index: x for index, x in zip(indices(self.rows[name]), components, strict=True)}
        return columns

    @property
    def units(self) -> dict[str, str]:
        """Return the SI units of time and of each quantity."""
        return {"time": TIME.unit} | {name: self.rows[name].unit for name in self.quantities}

    def until(self, stop: float | None) -> "Result":
        """Return the part up to this time in s; None: all of it. Raises ValueError for a time before the first."""
        if stop is None:
            return self
        first = self.time[:1].tolist() or [stop]  # a result without rows has no first time
        if not isinstance(stop, Real) or not stop >= first[0]:
            raise ValueError(f"stop = {stop!r}: expected a time from {first[0]!r} s on")
        last = float(stop) + 1e-15 * abs(float(stop))  # times are sums of steps: three of 0.1 are 4e-17 beyond 0.3
        n = int(np.searchsorted(self.time, last, side="right"))
        quantities = {name: values[:n] for name, values in self.quantities.items()}
        happened = ({name: times[times <= last] for name, times in of.items()} for of in (self.events, self.touches))
        return Result(self.time[:n], quantities, self.rows, *happened)

    @classmethod
    def of_rows(cls, rows: Iterable[Mapping[str, ArrayLike]]) -> "Result":
        """Return the result of a loop from a row for each time, as `Simulator.values` returns it.

        Raises ValueError if there are no rows or they differ in their names, and for names that are not quantities.
        """
        if not (listed := list(rows)):
            raise ValueError("rows = []: expected at least one, as Simulator.values gives them")
        for k, row in enumerate(listed):
            if not isinstance(row, Mapping) or "time" not in row or row.keys() != listed[0].keys():
                expected = "expected time and the same quantities in each, as Simulator.values gives them"
                raise ValueError(f"rows[{k}]: {expected}")
        columns = {name: as_floats("Result", name, [row[name] for row in listed]) for name in listed[0]}
        return cls(columns.pop("time"), columns, getattr(listed[0], "own", None))

    @classmethod
    def load(cls, path: str | Path) -> "Result":
        """Read a file that `save` wrote, a CSV that an FMU's importer wrote, or an AEM.

        Columns that are not quantities are left out. The events of a CSV are read from the file beside it,
        `run.events.csv`, if there is one. Raises ValueError if the file has no time, times that do not increase, a cell
        that is not a number (in any column), an incomplete quantity, or a number that is not finite.
        """
        path = exceptions.path_of(path)
        if path.suffix not in FORMATS:
            raise ValueError(f"{str(path)!r}: expected a name that ends in {ENDINGS}")
        from rbfmu.aem import read_aem  # runs do not need it

        columns = {".csv": _read_csv, ".npz": arrays_of_npz, ".aem": read_aem}[path.suffix](path)
        if "time" not in columns:
            raise ValueError(f"{path}: time is missing: expected the result of a run")
        time, quantities = columns["time"], {name: columns[name] for name in OUTPUT if name in columns}
        for name, values in {"time": time, **quantities}.items():
            _check_shape(OUTPUT.get(name, TIME), values, time.size, f"{path}: ")
            refuse_gaps(name, values, f"{path}: ")
        refuse_disorder(time, f"{path}: ")
        happened = ({n.removeprefix(k): t for n, t in columns.items() if n.startswith(k)} for k in (EVENTS, TOUCHES))
        return cls(time, quantities, None, *happened)

    def save(self, path: str | Path) -> None:
        """Write `.csv` (FMU variable names, every digit), `.npz` (arrays by quantity) or `.aem` (CCSDS, the attitude).

        The units of a CSV are in a second file beside it, `run.units.csv` for `run.csv`, with name, unit and meaning
        of each column; so the first has one header, and FMPy can read it as an FMU's input. If the scene has events,
        they are in a third file, `run.events.csv`, in the order of time; if not, that of an earlier run is deleted.
        A file is replaced when the new one is completely written. Raises ValueError for what cannot be saved.
        """
        path = exceptions.path_of(path)
        if path.suffix == ".npz":
            events = {EVENTS + n: t for n, t in self.events.items()} | {TOUCHES + n: t for n, t in self.touches.items()}
            with on_disk.replacing(path) as file:
                write_npz(file, {"time": self.time, **self.quantities, **events})
        elif path.suffix == ".csv":
            self._write_tables(path)
        elif path.suffix == ".aem":
            from rbfmu.aem import write_aem

            check_attitude(path, self.quantities)
            if not len(self.time):
                raise ValueError(f"cannot save to {str(path)!r}: expected at least one point in time")
            for name in ("time", "quaternion", *({"omega_b"} & self.quantities.keys())):
                refuse_gaps(name, getattr(self, name))
            refuse_disorder(self.time)
            write_aem(path, self.time, self.quaternion, self.quantities.get("omega_b"))
        else:
            raise ValueError(f"cannot save to {str(path)!r}: the name must end in {ENDINGS}")

    def _write_tables(self, path: Path) -> None:
        columns, known, points = self.columns(), {"time": TIME} | self.rows, range(0, len(self.time), CHUNK)
        parts = (zip(*(c[k : k + CHUNK].tolist() for c in columns.values()), strict=True) for k in points)
        _write_table(path, chain([[*columns]], chain.from_iterable(parts)), csv.QUOTE_NONNUMERIC)
        units = ((name, known[name.partition("[")[0]]) for name in columns)
        rows = [("name", "unit", "meaning"), *((name, row.unit, row.meaning) for name, row in units)]
        _write_table(path.with_suffix(".units.csv"), rows, csv.QUOTE_ALL)
        of_events = path.with_suffix(".events.csv")
        if self.events:
            kinds = dict(zip(KINDS, (self.events, self.touches), strict=True))
            listed = [(t, n, kind) for kind in kinds for n, times in kinds[kind].items() for t in times.tolist()]
            _write_table(of_events, [OF_EVENTS, *sorted(listed)])
        elif _has_events(of_events):
            of_events.unlink()


def _has_events(path: Path) -> bool:
    """Return whether a file is one to which a result wrote its events."""
    return path.is_file() and path.read_bytes().startswith(",".join(OF_EVENTS).encode())


def _read_csv(path: Path) -> dict[str, Array]:
    """Return the arrays of a CSV, and the times of events from the file beside it, with the names that a .npz has."""
    columns = by_quantity(csv_table.read_columns(path, faults_of_names=incomplete))
    beside, found = path.with_suffix(".events.csv"), dict[str, list[float]]()
    rows = csv.reader(beside.read_text(encoding="utf-8").splitlines()[1:] if _has_events(beside) else ())
    for k, row in enumerate(rows):
        try:
            time, name, kind = row
            found.setdefault(f"{KINDS[kind]}{name}", []).append(float(time))
        except (ValueError, KeyError):
            raise ValueError(f"{beside}: row {k + 1}: expected a time, a name, and event or touch") from None
    return columns | {name: np.array(times) for name, times in found.items()}


def _check_shape(row: Quantity, values: Array, points: int, where: str = "") -> None:
    shape = (points, row.size) if row.size > 1 else (points,)
    if values.shape != shape:
        raise ValueError(f"{where}{row.name} has the shape {values.shape}: expected {shape}")


def refuse_gaps(name: str, values: Array, where: str = "") -> None:
    """Raise ValueError if a number is not finite; where: the start of the message."""
    if bad := np.argwhere(~np.isfinite(values)).tolist():
        found = float(values[tuple(bad[0])])
        raise ValueError(f"{where}{name} = {found!r} in row {bad[0][0] + 1}: expected numbers")


def refuse_disorder(time: Array, where: str = "") -> None:
    """Raise ValueError if times do not increase; where: the start of the message."""
    if np.any(np.diff(time) <= 0.0):
        row = int(np.argmax(np.diff(time) <= 0.0)) + 1
        raise ValueError(f"{where}time = {float(time[row])!r} in row {row + 1}: expected times that increase")


def quaternion_lengths(rows: Array) -> Array:
    """Return the lengths (n,) of quaternions (n, 4), NaN for gaps. Raises ValueError if one is not within 0.1 of 1."""
    lengths: Array = np.linalg.norm(rows, axis=1)
    off = np.abs(lengths - 1.0)
    if np.any(off > 0.1):
        row = int(np.nanargmax(off))
        raise ValueError(f"quaternion in row {row + 1} has length {lengths[row]:.3g}: expected 1, scalar first")
    return lengths


def _arrays(values: Mapping[str, ArrayLike]) -> dict[str, Array]:
    if not hasattr(values, "items"):
        raise TypeError(f"{f'Result: {values!r}':.120}: expected a mapping from names to arrays")
    return {name: as_floats("Result", name, rows) for name, rows in values.items()}


def _write_table(path: Path, rows: Iterable[Sequence[object]], quoting: Literal[0, 1, 2] = csv.QUOTE_MINIMAL) -> None:
    with on_disk.replacing(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, quoting=quoting, lineterminator="\n").writerows(rows)


def write_npz(file: IO[bytes], arrays: Mapping[str, ArrayLike]) -> None:
    """Write a .npz as `np.savez` does; arrays may also have the names of its arguments (file, allow_pickle)."""
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asanyarray(array), allow_pickle=False)


def read_npz(path: Path) -> dict[str, Any]:
    """Return the arrays of a .npz; `np.load` would treat a file that is not an archive as a pickle, which is unsafe."""
    with path.open("rb") as raw, np.lib.npyio.NpzFile(raw) as file:
        return {name: file[name] for name in file.files}


def arrays_of_npz(path: Path) -> dict[str, Array]:
    """Return the arrays of a result's .npz. Raises ValueError if it has none, or they are not numbers."""
    try:
        arrays = read_npz(path)
    except FileNotFoundError:
        raise
    except Exception as error:
        cause = f"{error!s:.100}"  # NumPy's message may contain a whole text that is not a number
        raise ValueError(f"{path}: cannot be read as arrays of NumPy ({cause}): expected the result of a run") from None
    if "resume/head" in arrays:
        raise ValueError(f"{path}: an ensemble's: expected the result of a run; EnsembleResult.load takes it")
    return {name: as_floats(str(path), name, rows) for name, rows in arrays.items()}


def incomplete(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield (missing column, message) for each quantity of which only some columns are there."""
    for name in dict.fromkeys(name.partition("[")[0] for name in names):
        wanted = elements(name, OUTPUT[name].size) if name in OUTPUT else []
        if missing := [element for element in wanted if element not in names]:
            yield missing[0], f"{missing[0]} is missing: expected all of {', '.join(wanted)}"


def by_quantity(flat: Mapping[str, Array]) -> dict[str, Array]:
    """Return arrays by quantity from columns by FMU variable name; columns of incomplete arrays stay as they are."""
    names = [name.partition("[")[0] for name in flat]
    found = dict[str, Array]()
    for name in dict.fromkeys(names):
        wanted = elements(name, OUTPUT[name].size if name in OUTPUT else names.count(name))
        if any(column not in flat for column in wanted):
            found |= {column: values for column, values in flat.items() if column.partition("[")[0] == name}
        else:
            found[name] = np.stack([flat[column] for column in wanted], axis=1) if len(wanted) > 1 else flat[wanted[0]]
    return found
