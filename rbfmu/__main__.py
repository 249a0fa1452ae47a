"""`python -m rbfmu` and the command `rbfmu`."""

from rbfmu._interrupt import leave


def main() -> None:
    """The command line; its imports take long enough for a Ctrl-C."""
    try:
        from rbfmu.cli import main as command
    except KeyboardInterrupt:
        leave()
    command(prog_name="rbfmu")


if __name__ == "__main__":
    main()
