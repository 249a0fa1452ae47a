"""The pages: their code runs, their links lead somewhere, their tables are today's, and the README is short."""

import inspect
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import rbfmu_kernels
from examples import pages
from examples.figures import record
from examples.gallery import page as gallery
from rbfmu import arrays
from rbfmu.cli import main
from rbfmu.models.registry import MODELS
from rbfmu.studies.chart.cases import CASES
from tests.support.compilers import needs_compiler
from tests.support.paths import ROOT

NAMES = [path.relative_to(ROOT).as_posix() for path in pages.PAGES]
ELSEWHERE = {
    "examples/scenes/README.md",
    "NOTATION.md",
    "GLOSSARY.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
}
MOST_WORDS = 900
NOT_RUN = ("make ", "python3 -m venv ", "pip install ", "rbfmu chart", "rbfmu stability", "python 0")
"""Commands that install or take minutes, and examples (`test_examples` runs them); what they name is looked for."""
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def joined(text: str) -> str:
    """Return a text whose lines follow each other with a blank between."""
    return " ".join(text.split())


class Block(NamedTuple):
    page: str
    number: int
    language: str
    code: str

    def __str__(self) -> str:
        return f"{self.page}-{self.number}-{self.language}"


def blocks(name: str) -> list[Block]:
    return [Block(name, i, *found) for i, found in enumerate(FENCE.findall(text_of(name)))]


PYTHON = [block for name in NAMES for block in blocks(name) if block.language == "python"]


# --- the README


def words(text: str) -> list[str]:
    """Of prose and tables as a reader sees them: no code, no addresses of links."""
    text = re.sub(r"<!--.*?-->", "", FENCE.sub("", text), flags=re.DOTALL)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return [word for word in text.split() if re.search(r"\w", word)]


def test_words_are_counted_as_a_reader_sees_them() -> None:
    text = "One [two three](four.md) `five`\n```sh\nno no\n```\n| six | --- |\n<!-- no -->\n![seven](no.png) - 8.0\n"
    assert len(words(text)) == 7


def test_the_readme_is_short() -> None:
    assert len(words(text_of("README.md"))) <= MOST_WORDS


def test_the_readme_has_two_commands_to_install_and_an_example_of_each_way_in() -> None:
    languages = [block.language for block in blocks("README.md")]
    assert languages == ["toml", "console", "sh", "python", "toml", "sh", "sh"]
    install, check = blocks("README.md")[2].code.splitlines()
    assert install == "python3 -m venv .venv && .venv/bin/pip install --quiet . && .venv/bin/rbfmu demo"
    assert check == "make setup check test"


# --- code


@pytest.mark.thorough
@needs_compiler
@pytest.mark.parametrize("block", PYTHON, ids=str)
def test_python_can_be_pasted(block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each block by itself, in a folder that has the page's scene."""
    scenes_of(block.page, tmp_path)
    monkeypatch.chdir(tmp_path)
    exec(compile(block.code, str(block), "exec"), {"__name__": "__main__"})


@pytest.mark.thorough
@needs_compiler
@pytest.mark.parametrize("name", [name for name in NAMES if any(b.language == "sh" for b in blocks(name))])
def test_commands_run_one_after_the_other(name: str, tmp_path: Path) -> None:
    scenes_of(name, tmp_path)
    for command in commands(name):
        if not command.startswith(NOT_RUN):
            done = ran(command, tmp_path)
            assert done.returncode == 0, f"{command}\n{done.stderr}"


@pytest.mark.thorough
@needs_compiler
@pytest.mark.parametrize("block", [b for name in NAMES for b in blocks(name) if b.language == "console"], ids=str)
def test_what_a_command_prints_is_what_the_page_says(block: Block, tmp_path: Path) -> None:
    scenes_of(block.page, tmp_path)
    command, _, said = block.code.partition("\n")
    assert command.startswith("$ ")
    assert ran(command[2:], tmp_path).stdout.rstrip() == said.rstrip()


def test_there_are_commands_of_every_kind() -> None:
    assert {b.language for name in NAMES for b in blocks(name)} == {"sh", "python", "toml", "console"}


def commands(name: str) -> list[str]:
    lines = [line for block in blocks(name) if block.language == "sh" for line in block.code.splitlines()]
    return [line.split(" #")[0].strip() for line in lines if line.strip()]


@pytest.mark.parametrize("command", [c for name in NAMES for c in commands(name) if c.startswith(NOT_RUN)])
def test_what_is_not_run_here_exists(command: str) -> None:
    for target in re.findall(r"^make (.*)$", command):
        assert set(target.split()) <= set(re.findall(r"^(\w+):", text_of("Makefile"), re.MULTILINE))
    for script in re.findall(r"^python (\S+)$", command):
        assert (ROOT / "examples" / script).exists()
    for extra in re.findall(r"(?:rbfmu|\.)\[(\S+?)\]", command):
        assert re.search(rf"^{extra} = \[", text_of("pyproject.toml"), re.MULTILINE)


@pytest.mark.parametrize("name", NAMES)
def test_commands_named_in_the_text_exist(name: str) -> None:
    for code in re.findall(r"`([^`]+)`", joined(FENCE.sub("", text_of(name)))):
        if found := re.match(r"python -m (examples\.\S+)", code):
            assert (ROOT / f"{found[1].replace('.', '/')}.py").exists(), code
        if found := re.match(r"make (\w+)", code):
            assert re.search(rf"^{found[1]}:", text_of("Makefile"), re.MULTILINE), code
        if found := re.match(r"rbfmu (\w+)", code):
            assert found[1] in main.commands, code
        if found := re.search(r"(?:rbfmu|\.)\[(\S+?)\]", code):
            assert re.search(rf"^{found[1]} = \[", text_of("pyproject.toml"), re.MULTILINE), code


def scenes_of(name: str, folder: Path) -> None:
    """Write the page's TOML, each block to the file that its first line names; the gallery's scenes beside it."""
    for place in ("scenes", "examples/scenes"):  # as from examples, and from the top
        shutil.copytree(gallery.SCENES, folder / place)
    for block in blocks(name):
        if block.language == "toml":
            first, _, _ = block.code.partition("\n")
            (folder / first.removeprefix("# ")).write_text(block.code)


def ran(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Return what became of a shell's line, with the commands of this environment."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "MPLBACKEND": "agg", "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(["sh", "-c", command], cwd=folder, env=environment, capture_output=True, text=True)


# --- links


@pytest.mark.parametrize("name", [*NAMES, *sorted(ELSEWHERE)])
def test_links_lead_to_files_and_headings(name: str) -> None:
    here = (ROOT / name).parent
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", text_of(name))):
        if "://" in target:
            continue
        place, _, heading = target.partition("#")
        file = here / place if place else ROOT / name
        assert file.exists(), target
        assert not heading or heading in anchors(file.read_text(encoding="utf-8")), target


def anchors(text: str) -> set[str]:
    """As GitHub makes them of headings, and those that stand in the text."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    made = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
    return made | set(re.findall(r'<a id="([^"]+)"', text))


@pytest.mark.parametrize("name", [*NAMES, *sorted(ELSEWHERE)])
def test_every_table_has_a_head(name: str) -> None:
    """2026-11-30: where rows had been taken out, blank lines were left, and the rows beyond were no table."""
    for table in re.findall(r"(?:^\|.*\n)+", FENCE.sub("", text_of(name)), re.MULTILINE):
        assert re.fullmatch(r"[|:\- ]+", table.splitlines()[1]), table


def test_every_page_is_linked_from_the_readme() -> None:
    linked = set(re.findall(r"\]\(([^)#\s]+)", text_of("README.md")))
    assert {
        *NAMES[1:],
        "examples/scenes/README.md",
        "NOTATION.md",
        "GLOSSARY.md",
        "ARCHITECTURE.md",
        "CONTRIBUTING.md",
    } <= linked


def test_numbers_in_words_are_those_of_the_code() -> None:
    assert len(gallery.PICTURES) == 15
    assert "fifteen scenes" in joined(text_of("rbfmu/README.md"))
    assert "fifteen scenes" in joined(text_of("examples/README.md"))
    assert len(CASES) == 8
    assert "on eight motions" in joined(text_of("rbfmu/README.md"))


# --- functions


def test_the_page_on_kernels_lists_every_function_once() -> None:
    listed = re.findall(r"^\| `(\w+)` \| (both|`rbfmu_kernels`) \|", text_of("kernels/README.md"), re.MULTILINE)
    kernels = [name for name in rbfmu_kernels.__all__ if inspect.isroutine(python_function_of(name))]
    assert sorted(name for name, _ in listed) == sorted(kernels)
    assert {name for name, where in listed if where == "both"} == {*arrays.__all__} - {"set_threads"}


def python_function_of(name: str) -> object:
    value = getattr(rbfmu_kernels, name)
    return getattr(value, "py_func", value)


# --- scenes and plans


def test_the_page_on_plans_names_every_model_in_its_order() -> None:
    table = text_of("rbfmu/README.md").partition("## Models")[2].partition("\n##")[0]
    named = re.findall(r"^\| ([^|`]+?) \|", table, re.MULTILINE)[1:]
    assert [name for name in named if name in MODELS] == [name for name in MODELS if name in named]
    assert set(named) - {"---"} == set(MODELS)


def test_the_glossary_has_words_that_plans_use() -> None:
    glossary = text_of("rbfmu/README.md").partition("## Words that a plan uses")[2].partition("\n## ")[0]
    words_of_plans = re.findall(r"^\| ([^|]+?) \|", glossary, re.MULTILINE)[2:]
    said = " ".join(re.findall(r"^```\n(.*?)^```$", text_of("examples/scenes/README.md"), re.DOTALL | re.MULTILINE))
    said += " ".join(row["plan"] for row in record.read("peers")[1])
    assert len(words_of_plans) >= 12
    assert [word for term in words_of_plans for word in term.split(", ") if word not in said] == []
