"""Studies of methods. This module has what they share: TOML tables, CSV files of rows, and numbers as text."""

import csv
import math
import textwrap
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from rbfmu.on_disk import replacing

Progress = Callable[[int, int, str], object]
"""A function that is called with (done, total, text)."""
WIDTH = 80
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"), (1e-12, "ps"), (1e-15, "fs"))


def tables_of(name: str) -> dict[str, Any]:
    """Return the tables of a TOML file; name: its path from this folder."""
    return tomllib.loads((Path(__file__).parent / name).read_text(encoding="utf-8"))


def write_rows(path: Path, rows: Iterable[Mapping[str, object]], head: Iterable[str]) -> Path:
    """Write a CSV file; head: lines that say where the figures come from, written first, each after a #."""
    rows = list(rows)
    with replacing(path, "w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {' '.join(line.split())}\n" for line in head)
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def wrap_lines(lines: Iterable[str]) -> list[str]:
    """Return the lines, wrapped to at most `WIDTH` characters."""
    return [part for line in lines for part in textwrap.wrap(line, WIDTH, subsequent_indent="  ")]


def join_parts(parts: Iterable[Iterable[str]]) -> str:
    """Return all lines as one text, with an empty line between the parts; parts without lines are left out."""
    return "\n\n".join(filter(None, ("\n".join(line.rstrip() for line in part) for part in parts)))


def cost_text(seconds: float) -> str:
    """Return a time with two digits and a unit: 0.41 fs, 8.1 ps, 170 ns, 1.4 ms."""
    size, unit = next(((size, unit) for size, unit in UNITS if seconds >= 0.9995 * size), UNITS[-1])
    return f"{two_digits(seconds / size)} {unit}"


def times(ratio: float) -> str:
    """Return a ratio of costs with two digits: 0.41 x, 3.0 x, 1,200 x; beyond 1e5 with one."""
    return f"{two_digits(ratio) if ratio < 1e5 else short(ratio)} x"


def short_number(number: float) -> str:
    """Return an error or accuracy in its shortest form: 1e-6, 2e-16, 3."""
    if number == 0.0:
        return "0"
    return short(number) if number < 0.095 else two_digits(number).removesuffix(".0")


def short(number: float) -> str:
    """Return a number in its shortest form, such as 1e-9."""
    return f"{number:.0e}".replace("e-0", "e-")


def two_digits(number: float) -> str:
    """Return a number rounded to two significant digits, without an exponent."""
    number = float(f"{number:.1e}")
    return f"{number:,.{max(0, 1 - math.floor(math.log10(number)))}f}"
