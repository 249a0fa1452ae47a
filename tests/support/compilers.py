"""The machine's C compiler, where it serves."""

import os
import shutil
import subprocess
from functools import cache
from importlib.util import find_spec

import pytest


@cache
def c_compiler() -> str | None:
    """The command that compiles C here; None where there is none, or none with C's headers, as Debian's gcc alone."""
    command = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if command is None:
        return None
    given = [command, "-xc", "-c", "-", "-o", os.devnull]
    done = subprocess.run(given, input="#include <math.h>\n#include <stdint.h>\n", text=True, capture_output=True)
    return None if done.returncode else command


def can_link() -> bool:
    """Whether native FMUs can be built here."""
    return bool(find_spec("ziglang") or c_compiler())


needs_compiler = pytest.mark.skipif(not c_compiler(), reason="no C compiler with its headers")
needs_linker = pytest.mark.skipif(not can_link(), reason="no ziglang, and no C compiler with its headers")
