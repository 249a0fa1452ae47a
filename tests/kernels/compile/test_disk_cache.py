import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from rbfmu_kernels.compile.reduced import made_once


def test_one_process_at_a_time_compiles_what_others_need_too(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    kept = SimpleNamespace(_cache_file=SimpleNamespace(_index_path=str(tmp_path / "kernel.nbi")))
    beside, entered = tmp_path / "kernel.nbi.lock", threading.Event()

    def compile_here() -> None:
        with made_once(kept):
            entered.set()

    with beside.open("w") as held_by_another:
        fcntl.flock(held_by_another, fcntl.LOCK_EX)
        thread = threading.Thread(target=compile_here, daemon=True)
        thread.start()
        assert not entered.wait(0.05)
    thread.join(60.0)
    assert entered.is_set()
    assert not beside.exists()


def test_where_nothing_is_kept_each_compiles() -> None:
    with made_once(None):
        pass
