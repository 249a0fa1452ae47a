"""Run commands of `rbfmu`, one line of words each, without what Python has on POSIX alone; `-c CODE` is run as Python.

Files obey Windows' rules: of names, of letters' case, and that what is open is neither removed nor renamed; `msvcrt`
locks them. What says which encoding it reads or writes does so itself: on Windows the default is another. The status is
that of the first command that fails.
"""

import errno
import os
import pathlib
import shlex
import signal
import sys
import time
import types
import warnings

MODULES = ("fcntl", "grp", "posix_ipc", "pty", "pwd", "resource", "syslog", "termios", "tty")
NAMES = {
    os: (
        "chown", "fork", "forkpty", "getegid", "geteuid", "getgid", "getgroups", "getloadavg", "getpgid", "getpgrp",
        "getpriority", "getsid", "getuid", "initgroups", "killpg", "mkfifo", "nice", "O_CLOEXEC", "O_NOFOLLOW",
        "O_NONBLOCK", "pread", "pwrite", "register_at_fork", "sched_getaffinity", "setsid", "statvfs", "sysconf",
        "uname", "wait", "wait3", "wait4", "WNOHANG",
    ),
    signal: (
        "alarm", "getitimer", "pause", "pthread_kill", "pthread_sigmask", "setitimer", "SIGALRM", "SIGCHLD", "SIGHUP",
        "SIGKILL", "siginterrupt", "SIGPIPE", "SIGQUIT", "SIGUSR1", "SIGUSR2", "sigpending", "sigwait",
    ),
    time: ("clock_gettime", "pthread_getcpuclockid", "tzset"),
}  # fmt: skip


RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10))}


def windows_name(path: str) -> None:
    """Raise OSError where Windows makes no file of this name, or has another there that differs in case alone."""
    folder, name = os.path.split(os.path.abspath(path))
    if set(name) & set('<>:"|?*\\') or name != name.rstrip(" .") or name.partition(".")[0].lower() in RESERVED:
        raise OSError(errno.EINVAL, "no name of a file on Windows", path)
    if not os.path.lexists(path) and os.path.isdir(folder) and name.lower() in map(str.lower, os.listdir(folder)):
        raise OSError(errno.EEXIST, "on Windows the same file as one that is there", path)


def closed(path: str) -> None:
    """Raise PermissionError where this process has a file open, or mapped as a library is."""
    real = os.path.realpath(path)
    opened = [f"/proc/self/fd/{fd}" for fd in os.listdir("/proc/self/fd")]
    mapped = pathlib.Path("/proc/self/maps").read_text()
    if any(os.path.realpath(fd) == real for fd in opened) or f" {real}\n" in mapped:
        raise PermissionError(errno.EACCES, "is open, and Windows neither removes nor renames it", path)


def windows_files(event: str, args: tuple[object, ...]) -> None:
    """Audit what is done with files."""
    if event == "open" and isinstance(args[0], str | os.PathLike):
        if int(args[2]) & os.O_CREAT:
            windows_name(os.fspath(args[0]))
    elif event == "os.mkdir":
        windows_name(os.fspath(args[0]))
    elif event == "os.remove":
        closed(in_folder(*args))
    elif event == "os.rename":
        closed(in_folder(args[0], args[2]))
        closed(in_folder(args[1], args[3]))


def in_folder(path: object, fd: object) -> str:
    """Return the path of a name in an open folder, or the path where there is none."""
    return os.fspath(path) if fd == -1 else os.path.join(os.readlink(f"/proc/self/fd/{fd}"), os.fspath(path))


def locks_of_windows() -> types.ModuleType:
    """Return `msvcrt` with its locks alone."""
    import fcntl

    module = types.ModuleType("msvcrt")
    lockf, exclusive = fcntl.lockf, fcntl.LOCK_EX | fcntl.LOCK_NB
    module.LK_NBLCK = 2
    module.locking = lambda fd, mode, size: lockf(fd, exclusive, size, os.lseek(fd, 0, os.SEEK_CUR))
    return module


def forget() -> None:
    """Take away what Windows does not have, and give what it has."""
    import logging.handlers
    import multiprocessing.util
    import random
    import subprocess
    import uuid

    import fmpy
    import matplotlib.pyplot
    import numba

    loaded = logging.handlers, multiprocessing.util, random, subprocess, uuid, fmpy, matplotlib.pyplot, numba
    assert all(loaded)  # these ask what Linux has as they are loaded
    sys.modules["msvcrt"] = locks_of_windows()
    for name in MODULES:
        sys.modules[name] = None  # type: ignore[assignment]
    for module, names in NAMES.items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    sys.addaudithook(windows_files)


def main(lines: list[str]) -> int:
    """Run them in turn."""
    forget()
    warnings.filterwarnings("error", category=EncodingWarning, module="rbfmu")
    from rbfmu.cli import main as command

    for line in lines:
        words = shlex.split(line)
        if words[0] == "-c":
            exec(words[1], {})
            continue
        status = command(words, standalone_mode=False)
        if status:
            return int(status)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
