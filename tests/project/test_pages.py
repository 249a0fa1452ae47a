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
from PIL import Image

import rbfmu
import rbfmu_kernels
from examples import pages
from examples.benchmarks import plans
from examples.figures import measure, record
from examples.gallery import page as gallery
from examples.interop import run as interop
from rbfmu import arrays
from rbfmu.cli import main
from rbfmu.models.registry import MODELS
from rbfmu.studies.chart.cases import CASES
from tests.support.covering import some_of
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
needs_compiler = pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler")
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
    assert languages == ["sh", "python", "toml", "sh", "sh"]
    install, check = blocks("README.md")[0].code.splitlines()
    assert install == "python3 -m venv .venv && .venv/bin/pip install --quiet . && .venv/bin/rbfmu demo"
    assert check == "make setup check test"


# --- code


@needs_compiler
@pytest.mark.parametrize("block", some_of([pytest.param(b, id=str(b)) for b in PYTHON], 4))
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
    shutil.copytree(gallery.SCENES, folder / "scenes")
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


# --- tables and figures


@pytest.mark.parametrize("name", NAMES)
def test_tables_are_those_of_todays_code_and_figures(name: str) -> None:
    assert text_of(name) == pages.filled(text_of(name)), "renew by: python -m examples.pages"


def test_every_table_stands_on_a_page() -> None:
    found = [name for page in NAMES for _, name, _ in pages.PLACE.findall(text_of(page))]
    assert sorted(found) == sorted(pages.TABLES)


@pytest.mark.parametrize("name", record.SOURCES)
def test_figures_are_not_older_than_their_sources(name: str) -> None:
    assert record.is_up_to_date(name), f"renew by: python -m examples.pages --measure {name}"


def test_figures_grow_old_with_code_but_not_with_words(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    source = tmp_path / "it.py"
    monkeypatch.setattr(record, "sources", lambda name: [(source, [])])
    seen = []
    for text in ('"""Words."""\nx = 1.0\n', '"""Other\nwords."""\n\nx = 1.0  # and more\n', "x = 2.0\n"):
        source.write_text(text)
        seen.append(record.digest("peers"))
    assert seen[0] == seen[1] != seen[2]


def test_a_picture_grows_old_with_its_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(record, "place", lambda name: tmp_path / f"{name}.png")
    monkeypatch.setitem(measure.NEEDED, "own_chart", ())
    monkeypatch.setitem(measure.DRAWN, "own_chart", lambda path: Image.new("RGB", (2, 2)).save(path))
    measure.measure("own_chart")
    assert record.is_up_to_date("own_chart")
    monkeypatch.setattr(record, "digest", lambda name: "other")
    assert not record.is_up_to_date("own_chart")


def test_pictures_that_pages_show_have_sources() -> None:
    """Those that are made otherwise are of the gallery, whose tests draw them, or of laws, which a command tests."""
    shown = {Path(path).stem for name in NAMES for path in re.findall(r"!\[[^\]]*\]\((\S+\.png)\)", text_of(name))}
    assert shown - {"stability_maps"} == set(record.PICTURES)


def test_of_some_sources_only_the_functions_named_count(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    source = tmp_path / "it.py"
    seen = []
    monkeypatch.setattr(record, "sources", lambda name: [(source, ["one"])])
    for text in (
        "def one():\n    return 1\n",
        "import os\n\n\ndef one():\n    return 1\n",
        "def one():\n    return 2\n",
    ):
        source.write_text(text)
        seen.append(record.digest("peers"))
    assert seen[0] == seen[1] != seen[2]
    monkeypatch.setattr(record, "sources", lambda name: [(source, ["two"])])
    with pytest.raises(KeyError, match="two"):
        record.digest("peers")


@pytest.mark.parametrize("name", record.SOURCES)
def test_every_pattern_of_sources_finds_some(name: str) -> None:
    assert all(list(ROOT.glob(entry.partition(":")[0])) for entry in record.SOURCES[name])
    assert name in (measure.DRAWN if name in record.PICTURES else measure.MEASURED)


def test_one_command_takes_stale_figures_anew_and_writes_the_tables(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    taken: list[str] = []
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- made by examples.pages: importers -->\nold\n<!-- end -->\nb\n")
    monkeypatch.setattr(pages, "PAGES", [page])
    monkeypatch.setattr(pages.subprocess, "run", lambda command, check: taken.append(command[-1]))
    monkeypatch.setattr(record, "is_up_to_date", lambda name: name != "interop")
    pages.main(["--measure", "stale"])
    assert taken == ["interop"]
    assert page.read_text() == f"a\n<!-- made by examples.pages: importers -->\n{pages.importers()}<!-- end -->\nb\n"


def test_what_came_of_every_fmu_stands_in_its_importer_s_row() -> None:
    lines = pages.importers().splitlines()
    assert len(lines) == 2 + len(pages.IMPORTERS) + len(pages.NEVER_TRIED)
    titles = dict(zip((cell.strip() for cell in lines[0].split("|")), range(99), strict=False))
    for row in record.read("interop")[1]:
        title = pages.IMPORTERS[row["importer"].partition(",")[0]][0]
        (line,) = (line for line in lines if line.startswith(f"| {title} | "))
        cell = line.split(" | ")[titles[pages.TRIED[row["FMU"]]] - 1]
        assert row["result"].rstrip(".") in cell


def test_an_importer_s_cell_says_what_another_one_with_libpython_does() -> None:
    rows = [
        {"importer": name, "version": version, "FMU": fmu, "result": result}
        for name, version, fmu, result in (
            ("it", "1.0", "python", "failed: no Python."), ("it", "1.0", "native", "same bits"),
            ("it, libpython preloaded", "1.0", "python", "same bits"),
            ("it, libpython preloaded", "1.0", "native", "same bits"),
        )
    ]  # fmt: skip
    assert pages.tried(rows, "python") == "failed: no Python; with libpython: same bits"
    assert pages.tried(rows, "native") == "same bits"
    assert pages.tried([row | {"version": ""} for row in rows], "python") == "not tried"


def test_an_importer_that_is_not_here_keeps_what_an_earlier_fmu_did(monkeypatch: pytest.MonkeyPatch) -> None:
    def row(name: str, version: str, result: str) -> dict[str, str]:
        return {"importer": name, "version": version, "FMU": "native", "result": result}

    before = [row("here", "1", "failed"), row("elsewhere", "2", "same bits"), row("nowhere", "", "not on this machine")]
    now = [row("here", "3", "same bits"), row("elsewhere", "", "none"), row("nowhere", "", "none")]
    for _ in range(2):
        monkeypatch.setattr(record, "read", lambda name, rows=before: ([], rows))
        monkeypatch.setattr(interop, "main", lambda: now)
        before = measure.interop()
        kept = row("elsewhere", "2", "same bits (an earlier FMU)")
        assert before[:2] == [now[0], kept]
        assert not before[2]["version"]


def test_figures_are_kept_with_the_digest_of_their_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(record, "place", lambda name: tmp_path / f"{name}.csv")
    monkeypatch.setitem(measure.MEASURED, "native", lambda: [{"scene": "one", "by hand": 0.5}])
    measure.measure("native")
    head, rows = record.read("native")
    assert rows == [{"scene": "one", "by hand": "0.5"}]
    assert head[0]
    assert not any(line.startswith("sources") for line in head)
    assert record.is_up_to_date("native")
    monkeypatch.setattr(record, "digest", lambda name: "other")
    assert not record.is_up_to_date("native")


def test_measuring_without_a_peer_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(measure.NEEDED, "peers", ("no_such_package",))
    with pytest.raises(SystemExit, match="no_such_package"):
        measure.measure("peers")


@pytest.mark.thorough
@pytest.mark.parametrize("case", some_of(measure.PEERS_CASES, 2))
def test_plans_are_those_whose_cost_is_quoted(case: str) -> None:
    """What is planned has no digest: plans are made again."""
    for row in record.read("peers")[1]:
        if row["case"] == case:
            asked = CASES[case] if int(row["outputs"]) == CASES[case].outputs else CASES[case].with_many_outputs()
            assert rbfmu.plan(asked.asking(float(row["accuracy"]))).method == row["plan"]


@pytest.mark.thorough
@pytest.mark.parametrize("name", gallery.PICTURES)
def test_the_gallery_s_plans_are_those_whose_cost_is_quoted(name: str) -> None:
    (row,) = (r for r in record.read("gallery_cost")[1] if (r["scene"], r["who"]) == (name, "planned"))
    planned = rbfmu.plan(gallery.scene_file(name))
    assert f"{planned.model}: {planned.method}" == row["what"]


def test_the_faster_one_is_bold_where_ratios_hold_to_less() -> None:
    row = {"seconds": "1e-6", "peer_seconds": "3e-6", "even": "False", "peer": "heyoka.py"}
    assert pages.times(row) == "**1** / 3"
    assert pages.times(row | {"peer_seconds": "0.4e-6", "peer": "other"}) == "1 / **0.4** other"
    assert pages.times(row | {"peer_seconds": "1.9e-6"}) == "1 / 1.9"
    assert pages.times(row | {"peer_seconds": "0.6e-6"}) == "1 / 0.6"
    assert pages.SURE == 2.0
    assert "only ratios hold, and only to a factor of two" in joined(text_of("README.md"))


def test_rows_of_peers_are_quoted_with_every_accuracy() -> None:
    rows = record.read("peers")[1]
    assert {row["case"] for row in rows} == set(measure.PEERS_CASES)
    assert len(rows) == 2 * 4 * len(measure.PEERS_CASES)
    assert all(float(row["error"]) <= float(row["accuracy"]) for row in rows)
    assert set(plans.FASTEST) >= {row["peer"] for row in rows}


def test_who_is_ahead_where_is_what_the_readme_says() -> None:
    """With few outputs nobody is ahead of plans; with many some at 1e-3, and heyoka.py with the thruster."""
    behind = [row for row in record.read("peers")[1] if row["even"] == "False"]
    behind = [row for row in behind if not float(row["seconds"]) < float(row["peer_seconds"])]
    assert all(int(row["outputs"]) > CASES[row["case"]].outputs for row in behind)
    coarse = [row for row in behind if float(row["accuracy"]) == 1e-3]
    assert {(row["case"], row["peer"]) for row in coarse if row["peer"] != "numbalsoda LSODA"} == {("c'", "heyoka.py")}
    assert all(float(row["peer_seconds"]) >= 0.66 * float(row["seconds"]) for row in coarse)
    others = [row for row in behind if float(row["accuracy"]) != 1e-3]
    assert {(row["case"], row["peer"]) for row in others} == {("f", "heyoka.py")}
    assert all(float(row["peer_seconds"]) >= 0.8 * float(row["seconds"]) for row in others)
    many = [row for row in record.read("peers")[1] if int(row["outputs"]) > CASES[row["case"]].outputs]
    sure = [row for row in many if "**" in pages.times(row)]
    assert [(row["case"], float(row["accuracy"])) for row in sure] == [("c", 1e-12)]


@pytest.mark.thorough
def test_round_off_limits_what_can_be_asked_as_the_readme_says() -> None:
    assert "1e-13 of a fast top that turns by 500 rad; 1e-15 is refused" in joined(text_of("README.md"))
    fast = rbfmu.load_scene(gallery.scene_file("top_sleeping")).replace({"run.stop": 2.5})
    assert fast.initial.omega_b[2] * fast.run.stop == pytest.approx(500.0)
    assert rbfmu.plan(fast.replace({"run.accuracy": 1e-13})).error < 1e-13
    with pytest.raises(rbfmu.SceneError, match="reach"):
        rbfmu.plan(fast.replace({"run.accuracy": 1e-15}))


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
    table = text_of("rbfmu/README.md").partition("## Models")[2].partition("\n## ")[0]
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
