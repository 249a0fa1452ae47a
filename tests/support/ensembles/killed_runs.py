"""Run the satellite's ensemble in processes of its own, which are killed at an operation on their store.

`python -m tests.support.ensembles.killed_runs STORE MOMENTS`: the operations (files opened, renamed, made) are counted,
and as many runs as MOMENTS are killed by SIGKILL at moments evenly spread over them, each on the store of the one
before it, until one gets through. It prints at which operations runs were killed. In all runs chunks are committed at
once.
"""

import os
import shutil
import signal
import sys
from pathlib import Path

from rbfmu.ensembles import store as stores
from tests.support.ensembles.satellite import run, satellite

EVENTS = ("open", "os.rename", "os.mkdir", "os.remove")


def in_child(store: Path, kill_at: int = 0, resume: bool = False) -> tuple[int, int]:
    """Run in a fork; return its exit status, negative for a signal, and the operations on the store."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            count = _counted(store, kill_at)
            run(satellite(), store, executor=2, resume=resume)
            os.write(writer, str(count[0]).encode())
            status = 0
        finally:
            os._exit(status)
    os.close(writer)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with os.fdopen(reader) as file:
        return status, int(file.read() or 0)


def _counted(store: Path, kill_at: int) -> list[int]:
    """Count the operations on the store from now on; die before the one with this number."""
    count = [0]

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event in EVENTS and str(arguments[0]).startswith(str(store)):
            count[0] += 1
            if count[0] == kill_at:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
    return count


def main(store: Path, moments: int) -> None:
    """Kill runs at so many moments, each on a store of its own and once more while it is resumed."""
    stores.OFTEN, stores.SHARE = 0.0, 1e9
    run(satellite(), executor=1)  # compiled before the forks
    whole = store.with_name(f"whole{store.suffix}")
    status, total = in_child(whole)
    assert status == 0
    for k in range(moments):
        moment = 1 + k * (total - 1) // max(moments - 1, 1)
        place = store.with_name(f"{store.stem}_{k}{store.suffix}")
        first, _ = in_child(place, moment)
        second, _ = in_child(place, 1 + moment // 2, resume=True)
        last, _ = in_child(place, resume=True)
        print(place, moment, total, first, second, last, flush=True)
        assert (first, last) == (-signal.SIGKILL, 0)
    shutil.rmtree(whole, ignore_errors=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
