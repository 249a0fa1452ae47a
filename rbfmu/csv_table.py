"""Tables of numbers with named columns, read from CSV files."""

import csv
import json
from collections.abc import Callable, Collection, Iterable, Sequence
from io import StringIO
from pathlib import Path
from typing import TextIO

import numpy as np

from rbfmu.exceptions import SceneError
from rbfmu.types import Array


def read_columns(
    path: Path, expected: str = "a number", holds: Callable[[float], bool] = lambda x: True,
    gaps: Collection[str] = (), needed: str = "time",
    faults_of_names: Callable[[Sequence[str]], Iterable[tuple[str, str]]] = lambda names: (),
) -> dict[str, Array]:  # fmt: skip
    """Return the columns (rows,) of a file by the names in its header.

    expected: which numbers are allowed, in words; holds: whether a number is allowed; gaps: the texts, in lower case,
    of cells without a number, which become NaN; needed: a column that must be there (empty: none); faults_of_names:
    gets the names in the header, and yields columns with what is wrong with them. A cell may contain all numbers of
    an array, as FMPy writes arrays of FMI 3.0: column `x` then becomes columns `x[1]`, `x[2]` and so on.
    Raises SceneError with the first fault of each column; its rows are counted from 1, without the header.
    """
    source = str(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as given:
            file = given if given.seekable() else StringIO(given.read(), newline="")  # a pipe can be read only once
            names = [x.strip() for x in next(filter(None, csv.reader(file, skipinitialspace=True)), [])]
            if needed and needed not in names:
                apart = ", with commas between columns" if len(names) == 1 and set(names[0]) & set(";\t") else ""
                message = f"column {needed!r} is missing: expected it in the header{apart}, not "
                raise SceneError(message + (", ".join(names) or "nothing"), source)
            rows = list[list[str]]()
            if (plain := _plain_numbers(file, len(names))) is None:
                file.seek(0)
                rows = [*filter(None, csv.reader(file, skipinitialspace=True))][1:]
                names, rows = _spread(names, rows, needed)
            if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
                raise SceneError((f"column {name!r} stands twice: expected each column once" for name in twice), source)
            faults = dict(faults_of_names(names))
            table = _numbers(faults, names, rows, expected, holds, gaps) if plain is None else plain
            if faults:
                raise SceneError(faults.values(), source)
    except (UnicodeDecodeError, csv.Error) as error:
        raise SceneError(f"not a CSV file: {error}", source) from None
    return dict(zip(names, table.T, strict=True))


def _plain_numbers(lines: TextIO, columns: int) -> Array | None:
    """Return the numbers of a table, fast; None if it has anything else than finite numbers without quotes."""
    text = lines.read()
    if not text.strip("\r\n"):  # NumPy warns if there are no rows; to silence it is not safe with several threads
        return np.empty((0, columns))
    try:
        table = np.loadtxt(StringIO(text, newline=""), delimiter=",", ndmin=2, comments=None)
    except ValueError:
        return None
    return table if table.shape[1] == columns and np.isfinite(table).all() else None


def _spread(names: list[str], rows: list[list[str]], needed: str) -> tuple[list[str], list[list[str]]]:
    """Return names and rows with a column for each number of an array, which has spaces in a cell of the first row."""
    parts = [cell.split() for cell in rows[0]] if rows else []
    arrays = {
        i: [f"{name}[{k + 1}]" for k in range(len(x))]
        for i, (name, x) in enumerate(zip(names, parts, strict=False))
        if len(x) > 1 and name != needed and "[" not in name and all(_number(number)[1] for number in x)
    }
    if not arrays or any(len(row) != len(names) for row in rows):
        return names, rows

    def numbers(i: int, cell: str) -> list[str]:
        found = cell.split()
        if i not in arrays or len(found) == len(arrays[i]):
            return found if i in arrays else [cell]
        return [f"[{cell}]" if found else ""] * len(arrays[i])  # another length, which is no number; or a gap

    flat = [column for i, name in enumerate(names) for column in arrays.get(i, [name])]
    return flat, [[x for i, cell in enumerate(row) for x in numbers(i, cell)] for row in rows]


def _numbers(
    faults: dict[str, str], names: list[str], rows: list[list[str]], expected: str, holds: Callable[[float], bool],
    gaps: Collection[str],
) -> Array:  # fmt: skip
    """Return the numbers of the rows; add the first fault of each column to `faults`."""
    table = np.full((len(rows), len(names)), np.nan)
    for k, row in enumerate(rows):
        if len(row) != len(names):
            faults["a row"] = f"row {k + 1} has {len(row)} cells: expected {len(names)}, as many as the header"
            break
        for i, (name, cell) in enumerate(zip(names, map(str.strip, row), strict=True)):
            if cell.lower() not in gaps:
                table[k, i], good = _number(cell)
                if not good or not holds(table[k, i]):
                    faults.setdefault(name, f"{name} = {json.dumps(cell)} in row {k + 1}: expected {expected}")
    return table


def _number(cell: str) -> tuple[float, bool]:
    """Return a number, and whether it is valid: `float` accepts 1_0 and digits of other scripts, no importer does."""
    try:
        return float(cell), cell.isascii() and "_" not in cell
    except ValueError:
        return np.nan, False
