"""FMUs built in a process of their own."""

import subprocess
import sys

from tests.support.paths import with_sources

KILLED = [
    "os.replace = lambda *paths: os.kill(os.getpid(), 9)",
    "import zipfile; zipfile.ZipFile.writestr = lambda *args, **options: os.kill(os.getpid(), 9)",
]
BUILD = """
import hashlib, os, sys
{before}
from pathlib import Path
from tests.support.fmu import fmus
import rbfmu_fmu
path = rbfmu_fmu.build(fmus.scene("{name}"), Path(sys.argv[1]), "{kind}")
print(hashlib.sha256(path.read_bytes()).hexdigest())
"""


def build_elsewhere(path, before="", kind="python", name="prescribed", **environment):
    """Build in a process of its own; its hash, or what it ended with."""
    command = [sys.executable, "-c", BUILD.format(before=before, kind=kind, name=name), str(path)]
    done = subprocess.run(command, env=with_sources(**environment), capture_output=True, text=True, timeout=1200)
    return done.stdout.strip() or done.returncode
