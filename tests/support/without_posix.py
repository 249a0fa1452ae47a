"""Run commands of `rbfmu`, one line of words each, without what Python has on POSIX alone; `-c CODE` is run as Python.

What says which encoding it reads or writes does so itself: on Windows the default is another. The status is that of
the first command that fails.
"""

import os
import shlex
import signal
import sys
import time
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


def forget() -> None:
    """Take away what Windows does not have."""
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
    for name in MODULES:
        sys.modules[name] = None  # type: ignore[assignment]
    for module, names in NAMES.items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)


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
