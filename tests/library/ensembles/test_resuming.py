"""Stores of ensembles: resumed after any stop with the same bits, refused where they are of something else."""

import os
import platform
import shutil
import subprocess
import sys
import threading
from contextlib import nullcontext
from unittest.mock import Mock

import numpy as np
import pytest
import zarr

from rbfmu import EnsembleResult, run_ensemble
from rbfmu.ensembles import lock, planning, running, store as stores, zarr_store
from rbfmu.ensembles.chunks import origin, run_chunk
from rbfmu.ensembles.lock import store_lock
from rbfmu.runs.plan import Plan
from tests.support.ensembles.satellite import PLAN, STORES, assert_same, run, satellite


class StopError(Exception):
    pass


def stopped_after(monkeypatch, count, error=StopError):
    """Let the chunk with this number fail, and all commits be made at once."""

    def run_some(work, index):
        if index >= count:
            raise error
        return run_chunk(work, index)

    monkeypatch.setattr(running, "run_chunk", run_some)
    monkeypatch.setattr(stores, "OFTEN", 0.0)
    monkeypatch.setattr(stores, "SHARE", 1e9)


@pytest.mark.parametrize("store", STORES)
@pytest.mark.parametrize("error", [StopError, KeyboardInterrupt])
def test_what_was_stopped_goes_on_with_the_same_bits(scene, whole, tmp_path, monkeypatch, store, error):
    for count in (0, 1, 5, 12):
        with monkeypatch.context() as patch:
            stopped_after(patch, count, error)
            with pytest.raises(error):
                run(scene, tmp_path / store, executor=2, resume=count > 0)
    done = []

    def counted(work, index):
        done.append(index)
        return run_chunk(work, index)

    monkeypatch.setattr(running, "run_chunk", counted)
    found = run(scene, tmp_path / store, executor=2, resume=True)
    assert sorted(done) == [12]  # nothing that is in the store is run again
    assert_same(whole, found)
    assert_same(whole, EnsembleResult.load(tmp_path / store))


def test_a_folder_has_the_rows_of_more_runs_than_one_of_its_chunks(scene, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(zarr_store, "ROWS", 16)  # two of the ensemble's
    with monkeypatch.context() as patch:
        stopped_after(patch, 5)
        with pytest.raises(StopError):
            run(scene, tmp_path / "store.zarr", executor=1)
    assert_same(whole, run(scene, tmp_path / "store.zarr", resume=True))
    zarr.open_group(tmp_path / "store.zarr", mode="a")["redrawn"].attrs["note"] = "mine"  # anybody may add some
    assert_same(whole, EnsembleResult.load(tmp_path / "store.zarr"))


@pytest.mark.parametrize("store", STORES)
def test_a_finished_store_is_read_and_not_touched_without_resume(scene, whole, tmp_path, monkeypatch, store):
    run(scene, tmp_path / store)
    monkeypatch.delattr(running, "run_chunk")
    with pytest.raises(FileExistsError, match="exists already, and stays as it is"):
        run(scene, tmp_path / store)
    assert_same(whole, run(scene, tmp_path / store, resume=True))


@pytest.mark.parametrize("store", STORES)
def test_who_failed_in_a_last_chunk_that_is_not_full_is_known_of_a_store(scene, tmp_path, store):
    found = run(scene, tmp_path / store, runs=17)
    assert [*EnsembleResult.load(tmp_path / store).failed] == [*found.failed] == [16]


def test_a_last_chunk_that_is_not_full_is_kept_with_the_results_alone(scene, tmp_path, monkeypatch):
    """Of a program that is killed between the two more runs go on where it begins."""
    with monkeypatch.context() as patch:
        stopped_after(patch, 13)
        patch.setattr(stores.Store, "finish", Mock(side_effect=StopError))
        with pytest.raises(StopError):
            run(scene, tmp_path / "store.npz", executor=1)
    assert_same(run(scene, runs=110), run(scene, tmp_path / "store.npz", runs=110, resume=True))


@pytest.mark.thorough
@pytest.mark.parametrize("chunks", [2, None], ids=["what was stopped", "what was done"])
@pytest.mark.parametrize("store", STORES)
def test_more_runs_may_follow(scene, tmp_path, monkeypatch, store, chunks):
    more = run(scene, runs=163)
    with monkeypatch.context() as patch, pytest.raises(StopError) if chunks else nullcontext():
        stopped_after(patch, chunks or 999)
        run(scene, tmp_path / store, executor=1)
    assert_same(more, run(scene, tmp_path / store, runs=163, resume=True))
    assert_same(more, EnsembleResult.load(tmp_path / store))
    with pytest.raises(ValueError, match=r"ensemble.runs = 100: expected 163"):
        run(scene, tmp_path / store, resume=True)


@pytest.mark.thorough
def test_a_store_that_is_made_longer_is_no_result_until_it_is_done(scene, tmp_path):
    """A program that is killed right after that leaves rows of runs that were not done."""
    run(scene, tmp_path / "store.zarr")
    longer = scene.replace({"ensemble.runs": 163})
    zarr_store.ZarrStore(running.Work(longer, PLAN, 8), tmp_path / "store.zarr").begin(resume=True)
    with pytest.raises(ValueError, match="has 96 of 163 runs"):
        EnsembleResult.load(tmp_path / "store.zarr")
    assert_same(run(longer), run(longer, tmp_path / "store.zarr", resume=True))


def test_a_folder_of_something_else_is_not_touched(scene, tmp_path):
    (tmp_path / "store.zarr").mkdir()
    (tmp_path / "store.zarr" / "notes.txt").write_text("mine")
    for resume in (False, True):
        with pytest.raises(FileExistsError, match="stays as it is"):
            run(scene, tmp_path / "store.zarr", resume=resume)
    assert [path.name for path in (tmp_path / "store.zarr").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(("change", "said"), [
    ({"ensemble.seed": 4}, "ensemble.seed = 4: expected 3"),
    ({"body.mass": 51.0}, "body.mass = 51.0: expected 50.0"),
    ({"ensemble.vary": {"body.mass": {"normal": [50.0, 1.0]}}}, "ensemble.vary"),
    ({"run.stop": 3.0}, "run.stop = 3.0: expected 2.0"),
    ({"ensemble.keep": ["final"]}, "ensemble.keep"),
])  # fmt: skip
@pytest.mark.parametrize("store", STORES)
def test_a_store_of_another_ensemble_is_refused(scene, tmp_path, store, change, said):
    run(scene, tmp_path / store)
    with pytest.raises(ValueError, match="of another ensemble") as caught:
        run(scene.replace(change), tmp_path / store, resume=True)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["rbfmu", "rbfmu_kernels", "numpy"])
def test_a_store_of_another_origin_is_refused(scene, tmp_path, monkeypatch, name):
    run(scene, tmp_path / "store.npz")
    monkeypatch.setattr(stores, "origin", lambda: origin() | {name: "other"})
    with pytest.raises(ValueError, match=f'origin.{name} = "other": expected'):
        run(scene, tmp_path / "store.npz", resume=True)


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="there are no links")
def test_a_link_to_a_store_stays_and_its_store_has_one_lock(scene, tmp_path):
    link, there = tmp_path / "link.npz", tmp_path / "far" / "store.npz"
    there.parent.mkdir()
    link.symlink_to(there)
    with store_lock(there), pytest.raises(BlockingIOError, match=f"is being written by process {os.getpid()} on "):
        run(scene, link)
    run(scene, link)
    assert link.is_symlink()
    assert EnsembleResult.load(there).runs == scene.ensemble.runs
    assert {path.name for path in (*tmp_path.iterdir(), *there.parent.iterdir())} == {"link.npz", "far", "store.npz"}


@pytest.mark.parametrize("store", STORES)
def test_what_is_said_about_a_scene_may_change(scene, whole, tmp_path, store):
    run(scene, tmp_path / store)
    said = scene.replace({"about.description": "Other words."})
    assert_same(whole, run(said, tmp_path / store, resume=True))
    assert_same(whole, EnsembleResult.load(tmp_path / store))


def test_a_store_of_another_plan_is_refused(scene, tmp_path):
    run(scene, tmp_path / "store.npz")
    other = Plan(**{**vars(PLAN), "order": 14})
    with pytest.raises(ValueError, match="plan"):
        run_ensemble(scene, tmp_path / "store.npz", resume=True, planned=other, progress=False)


@pytest.fixture
def unplanned(monkeypatch):
    """Nothing may be planned."""

    def planned(*_):
        raise AssertionError

    monkeypatch.setattr(planning, "plan_once", planned)


def test_what_cannot_run_is_refused_before_it_is_planned(scene, tmp_path, monkeypatch, unplanned):
    (tmp_path / "store.npz").touch()
    with pytest.raises(FileExistsError, match="exists already"):
        run_ensemble(scene, tmp_path / "store.npz")
    for name in ("store", "store.csv"):
        with pytest.raises(ValueError, match=r"expected a name that ends in .npz or .zarr"):
            run_ensemble(scene, tmp_path / name)
    with pytest.raises(ValueError, match="resume = True: expected a store"):
        run_ensemble(scene, resume=True)
    for name in ("store.npz", "store.zarr"):
        with pytest.raises(FileNotFoundError, match=r"there is no such folder: .*missing'"):
            run_ensemble(scene, tmp_path / "missing" / name)
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ModuleNotFoundError, match="zarr is not installed"):
        run_ensemble(scene, tmp_path / "store.zarr")


@pytest.mark.parametrize("read", [EnsembleResult.load, lambda path: run(satellite(), path, resume=True)])
def test_a_store_with_statistics_of_before_is_refused(tmp_path, read):
    path = tmp_path / "store.npz"
    run(satellite(), path)
    with np.load(path) as file:
        arrays = {name.replace("/counted", "/counts"): file[name] for name in file.files}
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match=r"store.npz: cannot be read \(an older rbfmu made its statistics"):
        read(path)


def test_an_unfinished_store_is_no_result(scene, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        stopped_after(patch, 3)
        with pytest.raises(StopError):
            run(scene, tmp_path / "store.npz", executor=1)
    with pytest.raises(ValueError, match=r"has 24 of 100 runs: expected all, resume it"):
        EnsembleResult.load(tmp_path / "store.npz")
    (tmp_path / "text.npz").write_text("text")
    with pytest.raises(ValueError, match=r"cannot be read \(File is not a zip file\)"):
        EnsembleResult.load(tmp_path / "text.npz")


def damaged(data):
    """Yield what may have become of a file: a byte differs, the rest was not copied, nothing was."""
    middle = len(data) // 2
    yield data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]
    yield data[:middle]
    yield b""
    yield None


@pytest.mark.parametrize("name", ["body.mass/c/0", "quaternion_mean/c/0/0", "redrawn/c/0"])
def test_damage_of_a_folder_s_numbers_is_said(scene, tmp_path, name):
    run(scene, tmp_path / "store.zarr")
    file = tmp_path / "store.zarr" / name
    for data in damaged(file.read_bytes()):
        file.unlink() if data is None else file.write_bytes(data)
        with pytest.raises(ValueError, match=rf"store.zarr: cannot be read \({name.partition('/')[0]}: "):
            EnsembleResult.load(tmp_path / "store.zarr")._arrays[name.partition("/")[0]][...]


def test_damage_of_what_a_folder_says_of_its_numbers_is_said(scene, tmp_path):
    run(scene, tmp_path / "store.zarr")
    file = tmp_path / "store.zarr" / "redrawn" / "zarr.json"
    text = file.read_bytes()
    for data in (text.replace(b"100", b"10", 1), *damaged(text)):
        shutil.rmtree(file.parent) if data is None else file.parent.mkdir(exist_ok=True)
        if data is not None:
            file.write_bytes(data)
        with pytest.raises(ValueError, match=r"store.zarr: cannot be read"):
            EnsembleResult.load(tmp_path / "store.zarr")


@pytest.mark.filterwarnings("ignore:Object at .* is not recognized")
@pytest.mark.parametrize("damage", ["zarr_formot", ""])
def test_who_goes_on_without_an_array_is_told_before_a_chunk_is_run(scene, tmp_path, monkeypatch, damage):
    """2026-12-01: a KeyError of zarr's, once rows were to be written; zarr leaves out such arrays without an error."""
    with monkeypatch.context() as patch:
        stopped_after(patch, 3)
        with pytest.raises(StopError):
            run(scene, tmp_path / "store.zarr", executor=1)
    monkeypatch.setattr(running, "run_chunk", Mock(side_effect=AssertionError))
    file = tmp_path / "store.zarr" / "body.mass" / "zarr.json"
    text = file.read_text()
    file.write_text(text.replace("zarr_format", damage)) if damage else file.unlink()
    with pytest.raises(ValueError, match=r"store.zarr: cannot be read \(body.mass: is missing, or is no array"):
        run(scene, tmp_path / "store.zarr", resume=True)


@pytest.mark.parametrize("name", ["zarr.json", "redrawn/zarr.json"])
def test_who_goes_on_with_a_damaged_folder_is_told_so(scene, tmp_path, name):
    """2026-11-28: said was "Extra data: line 244 column 2 (char 5714)" without a name, or a TypeError of zarr's."""
    run(scene, tmp_path / "store.zarr")
    file = tmp_path / "store.zarr" / name
    text = file.read_bytes()
    for data in (text + b"x", text.replace(b"node_type", b"node_tipe", 1)):
        file.write_bytes(data)
        with pytest.raises(ValueError, match=r"store.zarr: cannot be read \("):
            run(scene, tmp_path / "store.zarr", resume=True, runs=200)


HELD = """
import sys
import threading
from pathlib import Path
from rbfmu.ensembles.lock import store_lock
with store_lock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_store_that_another_program_writes_to_is_refused_with_who_it_is(scene, whole, tmp_path):
    path, pipe = tmp_path / "store.npz", subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", HELD, path], stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout.readline() == "held\n"
        for resume in (False, True):
            with pytest.raises(BlockingIOError, match=f"is being written by process {other.pid} on .*store.npz"):
                run(scene, path, resume=resume)
        other.kill()  # and so leaves its file
    assert_same(whole, run(scene, path))
    assert [file.name for file in tmp_path.iterdir()] == ["store.npz"]


@pytest.mark.skipif(lock.fcntl is None, reason="a file that is open cannot be removed")
@pytest.mark.parametrize(("is_removed", "text"), [(False, ""), (True, ""), (True, "another's")])
def test_a_lock_is_that_of_the_file_that_stands_there_and_says_who_has_it(tmp_path, monkeypatch, is_removed, text):
    """Who was killed left a long text; who ends removes the file, perhaps when another has opened it already."""
    beside, tried, original = tmp_path / "store.npz.lock", [], lock._try_lock
    beside.write_text("of a process that was killed " * 9)

    def removed_meanwhile(handle):
        original(handle)
        if is_removed and not tried:
            beside.unlink()
            if text:
                beside.write_text(text)
        tried.append(handle)

    monkeypatch.setattr(lock, "_try_lock", removed_meanwhile)
    with store_lock(tmp_path / "store.npz"):
        assert beside.read_text() == f"process {os.getpid()} on {platform.node()}"
    assert len(tried) == 1 + is_removed
    assert [*tmp_path.iterdir()] == []


def test_an_interrupt_between_two_lines_keeps_nothing_that_is_half_done(scene, whole, tmp_path, monkeypatch):
    """A chunk is counted, but its statistics are not in yet: such a state is not kept."""
    monkeypatch.setattr(stores, "OFTEN", 0.0)
    original, count = stores.Progress.add, [0]

    def struck(self, chunk, work):
        count[0] += 1
        if count[0] == 4:
            self.chunks += 1
            raise KeyboardInterrupt
        original(self, chunk, work)

    with monkeypatch.context() as patch:
        patch.setattr(stores.Progress, "add", struck)
        with pytest.raises(KeyboardInterrupt):
            run(scene, tmp_path / "store.npz", executor=1)
    assert_same(whole, run(scene, tmp_path / "store.npz", resume=True))


def test_threads_stop_with_the_run(scene, monkeypatch):
    stopped_after(monkeypatch, 2)
    with pytest.raises(StopError):
        run(scene, executor=2)
    names = {thread.name for thread in threading.enumerate()}
    assert not any(name.startswith("rbfmu_") for name in names)
