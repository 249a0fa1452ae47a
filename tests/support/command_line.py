"""The command line as tests call it: in this process, with what it prints on stderr apart."""

import inspect
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from rbfmu.cli import main
from tests.support.paths import ROOT

_APART = {"mix_stderr": False} if "mix_stderr" in inspect.signature(CliRunner).parameters else {}  # Click before 8.2


def call(*arguments: object, **options: Any) -> Result:
    """Run a command of rbfmu's."""
    return CliRunner(**_APART).invoke(main, [str(a) for a in arguments], **options)


def refused(*arguments: object) -> str:
    """Run a command that is to end with status 2, a message and nothing else; return the message."""
    result = call(*arguments)
    assert (result.exit_code, type(result.exception)) == (2, SystemExit), result.output
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    return result.stderr


BY_COUNT = """
import itertools
from rbfmu_kernels.compile import tiered
tiered.process_time = lambda ticks=itertools.count(): 2e-5 * next(ticks)
"""
"""Python where each call of a kernel in plain Python takes 20 us, on any machine: what is compiled hangs on counts."""


def call_by_count(folder: Path, *arguments: object) -> None:
    """Run a command by count, in a process of its own that keeps in a folder what it compiles; it must succeed."""
    command = [sys.executable, "-c", f"{BY_COUNT}from rbfmu.__main__ import main; main()", *map(str, arguments)]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    subprocess.run(command, env=environment, check=True, capture_output=True, cwd=ROOT)
