"""Ctrl-C on the command line: exit status 130 and no traceback, wherever it strikes."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rbfmu import EnsembleResult
from rbfmu.ensembles.result import kept_runs
from rbfmu.ensembles.store import Checkpoint
from tests.support.command_line import call
from tests.support.covering import some_of
from tests.support.ensembles.satellite import FILE, assert_same
from tests.support.paths import SCENES

SCENE = SCENES / "top_precessing.toml"
DRIVER = """
import os, signal, sys, time

def strike(*args, **kwargs):
    signal.raise_signal(signal.SIGINT)
    while True:
        pass

{stage}
from rbfmu.__main__ import main
sys.argv = ["rbfmu", *{arguments!r}]
main()
"""
FINDER = """
class Finder:
    def find_spec(name, path, target=None):
        if name == "{module}":
            {then}
sys.meta_path.insert(0, Finder)
"""
STAGES = {
    "imports": FINDER.format(module="rbfmu.cli", then="strike()"),
    "parsing": "import click; click.Command.parse_args = strike",
    "imports of a command": FINDER.format(module="rbfmu.planning.select", then="strike()"),
    "an exec that lets it through": FINDER.format(
        module="rbfmu.planning.select", then="exec('strike()', {'strike': strike})"
    ),
    "planning": "import rbfmu.planning.select; rbfmu.planning.select.plan = strike",
    "compiling": "import numba.core.typeinfer as t; t.TypeInferer.propagate = strike",
    "linking": """
import llvmlite.binding.module as m
link = m.link_modules
def linked(into, module):
    module.detach = strike  # which notes that it is freed
    link(into, module)
m.link_modules = linked
""",
    "running": "import rbfmu.simulation; rbfmu.simulation.drive_of = strike",
    "drawing": "import rbfmu.plot; rbfmu.plot.plot_result = strike",
    "where it is caught": """
def caught(*args, **kwargs):
    try:
        strike()
    except BaseException as error:
        raise RuntimeError("the unit failed") from error
import rbfmu.simulation; rbfmu.simulation.drive_of = caught
""",
    "where it is only reported": """
class Finalised:
    def __del__(self):
        strike()
def finalise(*args):
    Finalised()
    time.sleep(600)
import rbfmu.simulation; rbfmu.simulation.drive_of = finalise
""",
    "where it is forgotten": """
def forgotten(progress=None):
    try:
        strike()
    except BaseException:
        pass
import rbfmu.cli_output; rbfmu.cli_output.progress_bar = forgotten
import rbfmu.cli; rbfmu.cli.progress_bar = forgotten
""",
}


def start(folder: Path, arguments: list[str], stage: str, **environment: str) -> subprocess.Popen[str]:
    """A process that hears SIGINT even where the tests run in the background; a module, as in `python -m rbfmu`."""
    (folder / "driver.py").write_text(DRIVER.format(stage=stage, arguments=arguments))
    return subprocess.Popen(
        [sys.executable, "-m", "driver"], cwd=folder, env=os.environ | {"PYTHONSAFEPATH": ""} | environment,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


def check_interrupted(process: subprocess.Popen[str], before: str = "") -> None:
    try:
        _, said = process.communicate(timeout=120)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130, said
    assert re.fullmatch(f"{before}(\nAborted!\n)?", said)


@pytest.mark.parametrize("stage", some_of([*STAGES], 2))
def test_an_interrupt_ends_with_status_130_and_no_traceback(stage: str, tmp_path: Path) -> None:
    planned_anew = stage in ("imports of a command", "an exec that lets it through", "planning", "compiling", "linking")
    environment = {"NUMBA_CACHE_DIR": str(tmp_path)} if planned_anew else {}
    arguments = ["run", str(SCENE), "-o", str(tmp_path / "it.csv"), "--plot", str(tmp_path / "it.png")]
    check_interrupted(start(tmp_path, arguments, STAGES[stage], **environment))


@pytest.mark.parametrize("command", ["demo", "build", "chart", "new"])
def test_every_command_can_be_interrupted(command: str, tmp_path: Path) -> None:
    arguments = [command, str(tmp_path / "any")] if command in ("build", "new") else [command]
    check_interrupted(start(tmp_path, arguments, "import click; click.Command.invoke = strike"))


def test_an_interrupt_from_outside_ends_a_run(tmp_path: Path) -> None:
    stage = """
def wait(*args):
    print("running", flush=True)
    while True:
        time.sleep(0.1)  # a signal that Python has noted, but not yet handled, wakes nobody up
import rbfmu.simulation; rbfmu.simulation.drive_of = wait
"""
    process = start(tmp_path, ["run", str(SCENE)], stage)
    assert process.stdout is not None
    assert process.stdout.readline() == "running\n"
    process.send_signal(signal.SIGINT)
    check_interrupted(process)


@pytest.mark.thorough
def test_an_interrupted_ensemble_is_kept_and_goes_on(tmp_path: Path) -> None:
    stage = """
from rbfmu.ensembles.store import Store
add = Store.add
def struck(self, chunk):
    add(self, chunk)
    if self.progress.chunks == 3:
        strike()
Store.add = struck
"""
    arguments = ["ensemble", str(FILE), "--runs", "40000", "-o"]
    process = start(tmp_path, [*arguments, str(tmp_path / "it.npz")], stage)
    doubt, kept = "Warning: .* varies without effect on any output\n", r"\n\S*it\.npz: [\d,]+ of 40,000 runs are kept"
    check_interrupted(process, doubt + kept + "; --resume goes on with them\n")
    known = Checkpoint.read(tmp_path / "it.npz")
    assert kept_runs(tmp_path / "it.npz") == (3 * known.identity["members of a chunk"], 40_000)
    assert known.progress.chunks == 3
    assert call(*arguments, tmp_path / "it.npz", "--resume").exit_code == 0
    assert call(*arguments, tmp_path / "whole.npz").exit_code == 0
    assert_same(EnsembleResult.load(tmp_path / "whole.npz"), EnsembleResult.load(tmp_path / "it.npz"))
