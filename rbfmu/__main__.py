"""The entry point of `python -m rbfmu` and of the command `rbfmu`."""

import atexit
import gc
import os

from rbfmu._interrupt import leave

YOUNG = 200_000
"""Objects between two searches for garbage: a command imports and compiles a million that stay until its end."""


def main() -> None:
    """Run the command line, whose imports take long enough for a Ctrl-C."""
    gc.set_threshold(YOUNG)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # or NumPy starts threads that no command needs
    atexit.register(gc.freeze)  # at the end all goes anyway
    try:
        from rbfmu.cli import main as command
    except KeyboardInterrupt:
        leave()
    command(prog_name="rbfmu")


if __name__ == "__main__":
    main()
