"""Figures kept in CSV files, each with a digest of the sources that it rests on, so that old figures are found out."""

import ast
import csv
import hashlib
import io
import re
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from rbfmu.studies import write_rows
from rbfmu.studies.chart.measure import machine

ROOT = Path(__file__).parents[2]
FOLDER = Path(__file__).parent
_PARTS = ("rotations/**/*", "numerics/**/*", "mechanics/**/*", "exact/**/*", "integrators/[!f]*", "body/[!m]*",
          "body/memory", "models/[!f]*", "models/free")  # fmt: skip
KERNELS = tuple(f"kernels/rbfmu_kernels/{part}.py" for part in _PARTS)
"""What is computed. How it is compiled (`compile/`) and planned is left out: plans are compared one by one. So are
`body/members`, which ensembles alone run, and what scenes with formulas run: no figure has such a scene."""
_MEMBERS = "kernels/rbfmu_kernels/body/members.py"
_NATIVE = "fmu_build/rbfmu_fmu/native/*.[ch]"
_STUDY = "rbfmu/studies/chart"
_BENCH = "examples/benchmarks"
SOURCES: dict[str, tuple[str, ...]] = {
    "peers": (*KERNELS, f"{_STUDY}/cases.py", f"{_STUDY}/solvers.py",
              f"{_BENCH}/plans.py:collected"),
    "gallery_cost": (*KERNELS, f"{_BENCH}/gallery.py:competitors,measured"),
    "kernels": (*KERNELS[:2], f"{_BENCH}/support/array_tasks.py:tasks,scipy_calls", f"{_BENCH}/kernels.py:measure"),
    "native": (*KERNELS, _NATIVE, f"{_BENCH}/native.c", f"{_BENCH}/native_by_hand.c",
               f"{_BENCH}/native.py:_scene,_costs,_numba_timer,Running"),
    "interop": (_NATIVE, "examples/interop/importers.py",
                "examples/interop/run.py:by_kernels,job_of,try_importer,comparison"),
    "own_chart": (*KERNELS, f"{_STUDY}/*.py", "rbfmu/planning/*.py",
                  "examples/scenes/top_falling.toml"),
    "ensembles": (f"{_BENCH}/ensembles.py:scene_of,cost_here,costs,draw", "rbfmu/ensembles/*.py", _MEMBERS,
                  "rbfmu/plot.py"),
    "tumbling_brick": ("fmu_build/rbfmu_fmu/demo.py:draw,errors_against_nasa,local_angles",
                       "fmu_build/rbfmu_fmu/nasa_brick.csv", "rbfmu/plot.py"),
    "detumbling": ("rbfmu/ensembles/pictures.py", "rbfmu/ensembles/result.py",
                   "examples/detumbling.toml"),
    "b_dot": ("rbfmu/ensembles/pictures.py", "rbfmu/ensembles/result.py",
              "examples/b_dot.toml", "examples/09_detumbling.py:b_dot"),
    "view": ("rbfmu/viewer/*.*", "tests/support/browser.py:photographed"),
}  # fmt: skip
"""By the name of a file of figures or of a picture: what it rests on, files or functions and classes in them."""
PICTURES = ("own_chart", "ensembles", "tumbling_brick", "detumbling", "b_dot", "view")
"""Pictures of the pages, which carry the digest in their file."""
_STAMP, _KEY = "# sources ", "sources"


def place(name: str) -> Path:
    """Return the file of these figures; the gallery's stand beside its pictures."""
    if name in PICTURES:
        return ROOT / "examples" / f"{name}.png"
    return ROOT / "examples" / "pictures" / f"{name}.csv" if name == "gallery_cost" else FOLDER / f"{name}.csv"


def sources(name: str) -> Iterator[tuple[Path, list[str]]]:
    """Yield the files that these figures rest on, each with the definitions that count there (all: none named)."""
    for entry in SOURCES[name]:
        pattern, _, definitions = entry.partition(":")
        for path in sorted(ROOT.glob(pattern)):
            yield path, definitions.split(",") if definitions else []


def digest(name: str) -> str:
    """Return a digest of what these figures rest on; comments, docstrings and blank lines do not count."""
    found = hashlib.sha256()
    for path, definitions in sources(name):
        text = path.read_text(encoding="utf-8")
        for definition in definitions:
            found.update("\n".join(code_lines(segment(text, definition))).encode())
        if not definitions:
            code = _CODE_OF[path.suffix](text) if path.suffix in _CODE_OF else [text]
            found.update("\n".join([path.name, *code]).encode())
    return found.hexdigest()[:16]


def segment(text: str, definition: str) -> str:
    """Return the source of a function or class. Raises KeyError where there is none."""
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == definition:
            return "\n".join(text.splitlines()[node.lineno - 1 : node.end_lineno]) + "\n"
    raise KeyError(definition)


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


_STRING_OR_COMMENT = re.compile(r'("(?:\\.|[^"\\])*")|/\*.*?\*/|//[^\n]*', re.DOTALL)


def lines_of_c(text: str) -> Iterator[str]:
    """Return the lines of a source in C without comments and blank lines."""
    text = _STRING_OR_COMMENT.sub(lambda found: found[1] or "", text)
    return (line.rstrip() for line in text.splitlines() if line.strip())


_CODE_OF = {".py": code_lines, ".c": lines_of_c, ".h": lines_of_c}


def stamp(name: str) -> str:
    """Return the line of a file's head that says which sources it rests on."""
    return f"{_STAMP.removeprefix('# ')}{digest(name)}"


def write(name: str, rows: Iterable[dict[str, Any]]) -> None:
    """Write figures that were measured just now."""
    write_rows(place(name), rows, [*machine(), stamp(name)])


def stamp_picture(name: str) -> None:
    """Note in a picture that was drawn just now which sources it rests on."""
    text = PngInfo()
    text.add_text(_KEY, digest(name))
    with Image.open(place(name)) as picture:
        picture.load()
        picture.save(place(name), pnginfo=text, optimize=True)


def read(name: str) -> tuple[list[str], list[dict[str, str]]]:
    """Return the lines on where figures were measured, and the figures."""
    lines = place(name).read_text(encoding="utf-8").splitlines()
    head = [line.removeprefix("# ") for line in lines if line.startswith("# ") and not line.startswith(_STAMP)]
    return head, list(csv.DictReader(line for line in lines if not line.startswith("#")))


def is_up_to_date(name: str) -> bool:
    """Return whether figures were measured, or a picture drawn, with today's sources."""
    if name in PICTURES:
        with Image.open(place(name)) as picture:
            return bool(picture.info.get(_KEY) == digest(name))
    return _STAMP + digest(name) in place(name).read_text(encoding="utf-8").splitlines()
