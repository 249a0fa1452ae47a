"""Builds on a machine that is not kind: full and read-only disks, a kill at any moment."""

import errno
import io
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rbfmu import on_disk
from tests.support.command_line import call, refused
from tests.support.fmu.fmus import built
from tests.support.paths import with_sources

SCENE = '[inputs]\nports = ["omega_b"]\n[run]\nstop = 100.0\nstep = 0.01\naccuracy = 1e-3\n'
KINDS = pytest.mark.parametrize("kind", ["python", "native"])
REASONS = {"size=4k": "No space left on device", "ro": "Read-only file system"}
MOUNT = """
mount -t tmpfs -o size=1m none "$1" && mount -o remount,$2 none "$1" || exit 99
shift 2
"$@"
status=$?
ls -A "$FOLDER"
exit $status
"""


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "prescribed.toml"
    path.write_text(SCENE)
    return path


def command(scene_file, target, kind):
    build = [sys.executable, "-m", "rbfmu", "build", str(scene_file), "-o", str(target)]
    return build + ["--native"] * (kind == "native")


@pytest.mark.thorough
@KINDS
@pytest.mark.parametrize("option", REASONS)
def test_a_disk_that_takes_nothing_is_one_message_and_status_2(option, kind, scene_file, tmp_path):
    """A small file system of its own, where this machine lets its users mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    unshare = shutil.which("unshare") or pytest.skip("no unshare")
    mounted = [unshare, "-rm", "sh", "-c", MOUNT, "sh", str(folder), option]
    done = subprocess.run(mounted + command(scene_file, folder / "it.fmu", kind), capture_output=True, text=True,
                          env=with_sources(FOLDER=str(folder)), timeout=1200)  # fmt: skip
    if "unshare" in done.stderr or done.returncode == 99:
        pytest.skip(f"no mount: {done.stderr}")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr == f"Error: {folder / 'it.fmu'}: {REASONS[option]}\n"
    assert done.stdout == ""  # no message, and nothing left in the folder


def test_a_file_that_cannot_be_begun_is_named_itself(tmp_path):
    """And not the part that is written first, whose name nobody gave."""
    with pytest.raises(FileNotFoundError) as refused:
        on_disk.write_whole(tmp_path / "none" / "it.fmu", b"")
    assert refused.value.filename == str(tmp_path / "none" / "it.fmu")


def test_what_is_no_file_stays_where_it_is(tmp_path):
    (link := tmp_path / "it.fmu").symlink_to(os.devnull)
    on_disk.write_whole(link, b"some")
    assert os.readlink(link) == os.devnull
    assert [*tmp_path.iterdir()] == [link]


class FullDisk(io.FileIO):
    """A file of which so many bytes fit."""

    room = 0

    def write(self, content):
        super().write(content[: FullDisk.room])
        if len(content) > FullDisk.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return len(content)


@pytest.mark.thorough
@KINDS
def test_a_disk_full_at_any_byte_leaves_what_was_there(kind, scene_file, tmp_path, monkeypatch):
    target, whole = tmp_path / "it.fmu", built("prescribed", kind).read_bytes()
    opened = Path.open

    def opened_when_full(path, *of, **text):
        return FullDisk(path, *of) if path.suffix == ".part" else opened(path, *of, **text)

    monkeypatch.setattr(Path, "open", opened_when_full)
    target.write_bytes(b"what was there")
    for FullDisk.room in (0, 1, len(whole) - 1):
        assert refused(*command(scene_file, target, kind)[3:]) == f"Error: {target}: No space left on device\n"
        assert target.read_bytes() == b"what was there"
        assert sorted(p.name for p in tmp_path.iterdir()) == ["it.fmu", "prescribed.toml"]
    FullDisk.room = len(whole)
    assert call(*command(scene_file, target, kind)[3:]).exit_code == 0
    assert target.read_bytes() == whole


@pytest.mark.slow
@KINDS
def test_a_build_killed_at_any_moment_leaves_no_half_fmu(kind, scene_file, tmp_path):
    """Twenty moments spread over a build, most of them late; what stands there in the end is whole, or nothing."""
    target, whole, begun = tmp_path / "it.fmu", built("prescribed", kind).read_bytes(), time.monotonic()
    build = command(scene_file, target, kind)
    subprocess.run(build, check=True, capture_output=True, env=with_sources())
    duration, endings = time.monotonic() - begun, []
    assert target.read_bytes() == whole
    for delay in duration * (1.0 - np.geomspace(0.01, 1.0, 20)):
        target.unlink(missing_ok=True)
        process = subprocess.Popen(build, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=with_sources())
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        endings.append(process.wait())
        assert not target.exists() or target.read_bytes() == whole
    assert -signal.SIGKILL in endings
    subprocess.run(build, check=True, capture_output=True, env=with_sources())
    assert target.read_bytes() == whole
