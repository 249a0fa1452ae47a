"""Figures kept in CSV files, each with a digest of the sources that it rests on, so that old figures are found out."""

import ast
import csv
import hashlib
import io
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from rbfmu.studies.work_precision.collection import machine, write_rows

ROOT = Path(__file__).parents[2]
FOLDER = Path(__file__).parent
_PARTS = ("rotations", "numerics", "mechanics", "exact", "integrators", "body", "models")
KERNELS = tuple(f"kernels/rbfmu_kernels/{part}/**/*.py" for part in _PARTS)
"""What is computed. How it is compiled (`compile/`) and planned is left out: plans are compared one by one."""
_NATIVE = ("fmu_build/rbfmu_fmu/native/*.[ch]", "fmu_build/rbfmu_fmu/python/slave.py")
SOURCES: dict[str, tuple[str, ...]] = {
    "peers": (*KERNELS, "examples/benchmarks/plans.py", "rbfmu/studies/work_precision/cases.py",
              "rbfmu/studies/work_precision/*peer*.py", "rbfmu/studies/work_precision/solvers.py"),
    "gallery_cost": (*KERNELS, "examples/benchmarks/gallery.py"),
    "kernels": (*KERNELS[:2], "examples/benchmarks/kernels.py"),
    "native": (*KERNELS, *_NATIVE, "examples/benchmarks/native.*", "examples/benchmarks/native_by_hand.c"),
    "interop": (*_NATIVE, "examples/interop/*.py"),
}  # fmt: skip
"""By the name of a file of figures: what it rests on."""
_STAMP = "# sources "


def place(name: str) -> Path:
    """Return the file of these figures; the gallery's stand beside its pictures."""
    return ROOT / "examples" / "pictures" / f"{name}.csv" if name == "gallery_cost" else FOLDER / f"{name}.csv"


def sources(name: str) -> list[Path]:
    """Return the files that these figures rest on."""
    return sorted(path for pattern in SOURCES[name] for path in ROOT.glob(pattern))


def digest(name: str) -> str:
    """Return a digest of what these figures rest on; comments, docstrings and blank lines do not count."""
    found = hashlib.sha256()
    for path in sources(name):
        text = path.read_text(encoding="utf-8")
        found.update("\n".join([path.name, *(code_lines(text) if path.suffix == ".py" else [text])]).encode())
    return found.hexdigest()[:16]


def code_lines(text: str) -> Iterator[str]:
    """Return the lines of a Python source without comments, docstrings and blank lines."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            lines[node.lineno - 1 : node.end_lineno] = [""] * (node.end_lineno - node.lineno + 1)
    return (line.rstrip() for line in lines if line.strip())


def stamp(name: str) -> str:
    """Return the line of a file's head that says which sources it rests on."""
    return f"{_STAMP.removeprefix('# ')}{digest(name)}"


def write(name: str, rows: Iterable[dict[str, Any]]) -> None:
    """Write figures that were measured just now."""
    write_rows(place(name), rows, [*machine(), stamp(name)])


def read(name: str) -> tuple[list[str], list[dict[str, str]]]:
    """Return the lines on where figures were measured, and the figures."""
    lines = place(name).read_text(encoding="utf-8").splitlines()
    head = [line.removeprefix("# ") for line in lines if line.startswith("# ") and not line.startswith(_STAMP)]
    return head, list(csv.DictReader(line for line in lines if not line.startswith("#")))


def is_up_to_date(name: str) -> bool:
    """Return whether figures were measured with today's sources."""
    return _STAMP + digest(name) in place(name).read_text(encoding="utf-8").splitlines()
