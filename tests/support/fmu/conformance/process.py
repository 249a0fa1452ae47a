"""The child process that makes the calls of machine.py, and how many of them were refused."""

import pickle
import select
import subprocess
import sys
import tempfile
from collections import Counter

from tests.support.fmu.elsewhere import copy_modules
from tests.support.fmu.fmus import workshop

PATIENCE = 60.0
"""Seconds for one call."""
MODULE = "tests.support.fmu.conformance.child"


class Process:
    """The child; started anew after a crash."""

    def __init__(self, kind, folders):
        self.kind, self.folders, self.process = kind, folders, None
        self.calls, self.refused = Counter(), Counter()

    def ask(self, operation, *arguments):
        """(status, result, log) of a call; AssertionError where it ends the process or does not end."""
        if self.process is None:
            self._start()
        pickle.dump((operation, *arguments), self.process.stdin)
        self.process.stdin.flush()
        answered = select.select([self.process.stdout], [], [], PATIENCE)[0]
        try:
            if answered:
                return pickle.load(self.process.stdout)
        except EOFError:
            pass
        what = f"{operation}{arguments} ended the process" if answered else f"{operation}{arguments} does not end"
        raise AssertionError(f"{what}: {self.end()}")

    def end(self):
        """How it ended, and what it printed last."""
        if self.process.poll() is None:
            self.process.kill()
        status = self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()
        self.process = None
        with self.stderr as file:
            file.seek(0)
            return f"{status}\n{file.read()[-3000:]}"

    def _start(self):
        self.stderr = tempfile.TemporaryFile("w+", errors="replace")  # noqa: SIM115
        place = workshop() / "children"
        copy_modules(place, "conformance/__init__", "conformance/child", "fmu_importer", "fmu_importer3")
        command = [sys.executable, "-E", "-s", "-X", "faulthandler", "-m", MODULE, *map(str, self.folders)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.stderr, cwd=place
        )

    def stop(self):
        if self.process:
            self.process.stdin.close()
            assert self.process.wait(PATIENCE) == 0
            self.end()

    def report(self):
        table = [f"{self.kind}: {sum(self.calls.values())} calls, {sum(self.refused.values())} refused"]
        table += [f"  {name}: {n}, {self.refused[name]} refused" for name, n in sorted(self.calls.items())]
        return "\n".join(table)
