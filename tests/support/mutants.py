"""Mutants of the product, drawn by a seed: does a test fail that reaches the changed line?

    python -m tests.support.mutants reach        # run all tests once: which pass, and which lines each reaches
    python -m tests.support.mutants draw 7 60    # what would be changed, by the seed 7
    python -m tests.support.mutants run 7 60     # change one after the other in a copy, and test it [--quick]

A mutant is one change in one line of a package of the product or of the C layer: a sign, a bound, a constant or a
branch. Its tests run in the order of nearness, first those of `make test`, then those that are `thorough`, until one
fails. What compiled code and child processes run is not seen line by line: such a line is taken for reached by all
tests of the folders that `NEAR` names. This needs the package coverage.
"""

import argparse
import ast
import json
import os
import queue
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from tests.support.paths import ROOT, of_a_session

PACKAGES = {"kernels": "*.py", "rbfmu": "*.py", "fmu_build": "*.py", "C": "*.c"}
PLACE = Path(tempfile.gettempdir()) / "rbfmu-mutants"
MOST_SECONDS = 1500
"""The time after which the tests of a mutant are given up as running for ever. It is no limit of CPU time: under one
the clock of a process moves in steps of some ms, at which charts fail."""


class Mutant(NamedTuple):
    """A change of a line: what stands from one column to another, and what takes its place."""

    path: str
    line: int
    begin: int
    end: int
    right: str
    wrong: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {self.right!r} -> {self.wrong!r}"

    def planted(self, text: str) -> str:
        """Return the text of the file with the change."""
        lines = text.split("\n")
        row = lines[self.line - 1].encode()
        assert row[self.begin : self.end].decode() == self.right, self
        lines[self.line - 1] = (row[: self.begin] + self.wrong.encode() + row[self.end :]).decode()
        return "\n".join(lines)


# --- drawing

OPERATORS = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "+": "-", "-": "+", "*": "/", "/": "*"}
OPERATORS |= {"and": "or", "or": "and", "&&": "||", "||": "&&", "is": "is not", "in": "not in"}
SYMBOL = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.Add: "+", ast.Sub: "-",
    ast.Mult: "*", ast.Div: "/", ast.And: "and", ast.Or: "or", ast.Is: "is", ast.In: "in",
}  # fmt: skip
C_OPERATOR = re.compile(r" (<=|>=|==|!=|&&|\|\||<|>|\+|-) |\b(?:0|1)\b(?=[;)\]])")
C_BESIDES = re.compile(r'^\s*(#|//|\*|/\*)|"')


@cache
def _all_sites() -> dict[str, tuple[int, list[Mutant]]]:
    """Return for each package how many lines it has, and all that could be changed."""
    files = {name: list(_files(name)) for name in PACKAGES}
    return {
        name: (
            sum(len((ROOT / path).read_text().split("\n")) for path in paths),
            [*chain.from_iterable(map(_sites, paths))],
        )
        for name, paths in files.items()
    }


def drawn(seed: int, count: int) -> list[Mutant]:
    """Return mutants: of each package as many as its lines are of all, of each at least one in twelve."""
    sites = _all_sites()
    all_lines = sum(lines for lines, _ in sites.values())
    shares = {name: max(1 / 12, lines / all_lines) for name, (lines, _) in sites.items()}
    found: list[Mutant] = []
    for name, (_, mutants) in sites.items():
        found += random.Random(f"{seed} {name}").sample(mutants, round(count * shares[name] / sum(shares.values())))
    random.Random(seed).shuffle(found)
    return found


def package_of(path: str) -> str:
    """Return the name of a package to which a file of the product belongs."""
    return "C" if path.endswith(".c") else path.partition("/")[0]


def _files(name: str) -> Iterator[Path]:
    for path in sorted((ROOT / ("fmu_build" if name == "C" else name)).rglob(PACKAGES[name])):
        yield path.relative_to(ROOT)


def _sites(path: Path) -> list[Mutant]:
    text = (ROOT / path).read_text()
    return list(_sites_in_c(str(path), text) if path.suffix == ".c" else _sites_in_python(str(path), text))


def _sites_in_c(path: str, text: str) -> Iterator[Mutant]:
    for number, line in enumerate(text.split("\n"), 1):
        if not C_BESIDES.search(line):
            for found in C_OPERATOR.finditer(line):
                right = found[1] or found[0]
                wrong = OPERATORS.get(right) or str(1 - int(right))
                begin = found.start(1) if found[1] else found.start()
                yield Mutant(path, number, begin, begin + len(right), right, wrong)


def _sites_in_python(path: str, text: str) -> Iterator[Mutant]:
    rows = text.encode().split(b"\n")

    def changed(node: ast.expr, wrong: str) -> Mutant:
        right = rows[node.lineno - 1][node.col_offset : node.end_col_offset].decode()
        return Mutant(path, node.lineno, node.col_offset, node.end_col_offset or 0, right, wrong.format(right))

    for node in _statements(ast.parse(text)):
        if isinstance(node, ast.Compare | ast.BoolOp | ast.BinOp):
            yield from _operators(path, rows, node)
        elif isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
            value = node.value
            wrong = (
                not value if isinstance(value, bool) else value + 1 if isinstance(value, int) else 1.25 * value or 1.0
            )
            yield changed(node, repr(wrong))
        elif isinstance(node, ast.If | ast.IfExp | ast.While) and node.test.lineno == node.test.end_lineno:
            yield changed(node.test, "(not ({}))")


def _statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Walk what is run: no annotations, no decorators, no texts of errors."""
    besides = {"annotation", "returns", "decorator_list"}
    for name, value in ast.iter_fields(tree):
        for node in value if isinstance(value, list) else [value]:
            if isinstance(node, ast.AST) and name not in besides and not isinstance(node, ast.Raise | ast.JoinedStr):
                yield node
                yield from _statements(node)


def _operators(path: str, rows: list[bytes], node: ast.Compare | ast.BoolOp | ast.BinOp) -> Iterator[Mutant]:
    if isinstance(node, ast.Compare):
        operands, operators = [node.left, *node.comparators], node.ops
    elif isinstance(node, ast.BoolOp):
        operands, operators = node.values, [node.op] * (len(node.values) - 1)  # type: ignore[assignment]
    else:
        operands, operators = [node.left, node.right], [node.op]  # type: ignore[list-item]
    for left, right, operator in zip(operands, operands[1:], operators, strict=False):
        symbol = SYMBOL.get(type(operator))
        if symbol and left.end_lineno == right.lineno:
            between = rows[right.lineno - 1][left.end_col_offset : right.col_offset].decode()
            if re.fullmatch(rf"\)*\s*{re.escape(symbol)}\s*\(*", between):
                begin = (left.end_col_offset or 0) + between.index(symbol)
                yield Mutant(path, right.lineno, begin, begin + len(symbol), symbol, OPERATORS[symbol])


# --- testing

QUICK, THOROUGH = "not slow and not thorough", "thorough and not slow"
NEAR = (
    ("kernels/rbfmu_kernels/{0}/", ("tests/kernels/{0}", "tests/kernels", "tests/library", "tests/fmu")),
    ("kernels/", ("tests/kernels", "tests/library", "tests/fmu", "tests/project")),
    ("fmu_build/", ("tests/fmu", "tests/project/command_line")),
    ("rbfmu/{0}/", ("tests/library/{0}", "tests/project/command_line")),
    ("rbfmu/", ("tests/project/command_line", "tests/library")),
)
"""The tests of a line that no test was seen to reach, by the folder of the line, the nearest first."""
FAILED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)
SEE_ANY_CHANGE = (
    "tests/project/test_figures.py::test_figures_are_not_older_than_their_sources",
    "tests/project/test_mutants.py::test_text_to_be_changed_is_there_once",
)
"""Tests that compare sources with what was kept of them: they would find anything."""


class Found(NamedTuple):
    """What became of a mutant: which of both kinds of tests found it, by which test, after how much CPU time."""

    kind: str
    test: str
    seconds: float


class Slot:
    """A copy of the tree in which one mutant after the other is planted; it keeps its compiled code."""

    def __init__(self, number: int) -> None:
        self.folder, self.cache = PLACE / f"tree{number}", PLACE / f"numba{number}"
        shutil.rmtree(self.folder, ignore_errors=True)
        ignored = shutil.ignore_patterns(".git", ".venv*", "__pycache__", ".*_cache", "*.egg-info")
        shutil.copytree(ROOT, self.folder, ignore=ignored)
        self._stamp_kernels_by_what_they_import()

    def _stamp_kernels_by_what_they_import(self) -> None:
        """Let compiled code be kept where a change cannot reach it; the product's stamp is one for all kernels."""
        with (self.folder / STAMPING).open("a") as file:
            file.write(STAMP_OF_IMPORTS)

    def run(self, marks: str, tests: list[str], *options: str) -> subprocess.CompletedProcess[str]:
        """Run tests in the order given."""
        paths = [self.folder, self.folder / "kernels", self.folder / "fmu_build"]
        environment = of_a_session(
            PYTHONPATH=os.pathsep.join(map(str, paths)),
            NUMBA_CACHE_DIR=str(self.cache),
            COVERAGE_FILE=str(PLACE / "reach" / "data"),
        )
        listed = self.folder / "tests.txt"
        listed.write_text("\n".join(tests))
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", marks, *options]
        try:
            return subprocess.run(
                [*command, f"@{listed}"], cwd=self.folder, env=environment, capture_output=True, text=True,
                timeout=MOST_SECONDS,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return subprocess.CompletedProcess(command, 1, stdout=f"FAILED no end in {MOST_SECONDS} s", stderr="")

    def tested(self, mutant: Mutant, quick: bool = False) -> Found:
        """Plant a mutant, run its tests, or those of `make test` alone, and take it back."""
        path = self.folder / mutant.path
        right = path.read_text()
        besides = [f"--deselect={name}" for name in _fail_anyway()]
        begin = _cpu()
        try:
            path.write_text(mutant.planted(right))
            for kind, marks in (("make test", QUICK), ("thorough", THOROUGH))[: 1 if quick else 2]:
                for tests in _tests_of(mutant, kind):
                    done = self.run(marks, tests, *besides, "-x", "--no-header", "--tb=no")
                    if done.returncode not in (0, 5):  # 5: no test is left of these
                        failed = FAILED.findall(done.stdout)
                        said = failed[0] if failed else f"exit {done.returncode}"
                        return Found(kind, said, _cpu() - begin)
            return Found("-", "-", _cpu() - begin)
        finally:
            path.write_text(right)


STAMPING = Path("kernels/rbfmu_kernels/compile/code_cache.py")
"""The module that defines `stamp_of`."""
STAMP_OF_IMPORTS = '''

_of_all_kernels = stamp_of


def stamp_of(function):
    """Return a hash of a kernel's module and of all that it imports; of other functions the product's stamp."""
    import ast

    module = function.__module__
    if not module.startswith("rbfmu_kernels"):
        return _of_all_kernels(function)
    package, seen, left = Path(__file__).parents[1], {}, [module]
    while left:
        name = left.pop()
        path = package.joinpath(*name.split(".")[1:])
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        if name in seen or not name.startswith("rbfmu_kernels") or not path.exists():
            continue
        seen[name] = path.read_bytes()
        if path.name == "__init__.py" and name != module:
            continue
        for node in ast.walk(ast.parse(seen[name])):
            if isinstance(node, ast.ImportFrom):
                base = name.split(".")[: len(name.split(".")) - node.level] if node.level else []
                origin = ".".join([*base, *([node.module] if node.module else [])])
                left += [origin, *(f"{origin}.{one.name}" for one in node.names)]
    return hashlib.sha256(b"".join(seen[name] for name in sorted(seen))).hexdigest()[:16]
'''


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


# --- who reaches what


def reach() -> None:
    """Run all tests but slow ones, and keep which fail without a mutant, and which reach which line."""
    import coverage

    shutil.rmtree(PLACE / "reach", ignore_errors=True)
    (PLACE / "reach").mkdir(parents=True)
    slot = Slot(0)
    done = slot.run("not slow", ["tests"], "-n", "2", "--dist", "loadfile", "-p", "tests.support.reach")
    print(done.stdout[-3000:])
    failed = FAILED.findall(done.stdout)
    data = coverage.CoverageData(str(PLACE / "reach" / "data"))
    for part in (PLACE / "reach").glob("data.*"):
        other = coverage.CoverageData(str(part))
        other.read()
        data.update(other)
    lines = {
        str(Path(path).relative_to(slot.folder)): {
            str(line): sorted(set(filter(None, tests))) for line, tests in data.contexts_by_lineno(path).items()
        }
        for path in data.measured_files()
    }
    (PLACE / "reach.json").write_text(json.dumps({"failed": failed, "lines": lines}))


@cache
def _reached() -> Any:
    """Return what `reach` has found; else which tests of `make test` fail in a copy without a mutant, and no lines."""
    path = PLACE / "reach.json"
    if not path.exists():
        done = Slot(0).run(QUICK, ["tests"], "-n", "2", "--dist", "loadfile")
        return {"failed": FAILED.findall(done.stdout), "lines": {}}
    return json.loads(path.read_text())


def _fail_anyway() -> list[str]:
    return [*SEE_ANY_CHANGE, *_reached()["failed"]]


def _tests_of(mutant: Mutant, kind: str) -> Iterator[list[str]]:
    """Return the tests of a mutant in the order of nearness, a list for each run of pytest."""
    seen = _reached()["lines"].get(mutant.path, {}).get(str(mutant.line), [])
    if seen and not mutant.path.startswith("kernels"):
        yield sorted(seen, key=lambda test: not _is_near(test, mutant.path))
        return
    for pattern, folders in NEAR:
        if found := re.match(pattern.replace("{0}", "(\\w+)"), mutant.path):
            places = [folder.format(*found.groups()) for folder in folders]
            places = [place for place in places if (ROOT / place).exists()]
            taken: set[str] = set()
            for place in places:
                files = {str(p.relative_to(ROOT)) for p in (ROOT / place).rglob("test_*.py")} - taken
                taken |= files
                if files:
                    yield sorted(files)
            return


def _is_near(test: str, path: str) -> bool:
    return Path(path).parent.name in Path(test).parts or Path(path).stem in test


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["reach", "draw", "run"])
    parser.add_argument("seed", type=int, nargs="?", default=1)
    parser.add_argument("count", type=int, nargs="?", default=60)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="only the tests of `make test`")
    chosen = parser.parse_args()
    if chosen.what == "reach":
        reach()
        return
    mutants = drawn(chosen.seed, chosen.count)
    if chosen.what == "draw":
        print(*mutants, sep="\n")
        return
    print(f"fail without a mutant: {_reached()['failed']}", flush=True)
    slots: queue.Queue[Slot] = queue.Queue()
    for number in range(chosen.workers):
        slots.put(Slot(number))

    def one(mutant: Mutant) -> Found:
        slot = slots.get()
        try:
            found = slot.tested(mutant, chosen.quick)
        finally:
            slots.put(slot)
        print(f"{found.kind:10} {found.seconds:6.0f} s {mutant} by {found.test}", flush=True)
        return found

    with ThreadPoolExecutor(chosen.workers) as pool:
        kinds = Counter(found.kind for found in pool.map(one, mutants))
    print(f"of {len(mutants)} mutants: {dict(kinds)}")


if __name__ == "__main__":
    main()
