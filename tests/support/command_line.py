"""The command line as tests call it: in this process, with what it prints on stderr apart."""

import inspect
from typing import Any

from click.testing import CliRunner, Result

from rbfmu.cli import main

_APART = {"mix_stderr": False} if "mix_stderr" in inspect.signature(CliRunner).parameters else {}  # Click before 8.2


def call(*arguments: object, **options: Any) -> Result:
    """Run a command of rbfmu's."""
    return CliRunner(**_APART).invoke(main, [str(a) for a in arguments], **options)
