"""The entry point of `python -m rbfmu` and of the command `rbfmu`."""

from rbfmu._interrupt import leave


def main() -> None:
    """Run the command line, whose imports take long enough for a Ctrl-C."""
    try:
        from rbfmu.cli import main as command
    except KeyboardInterrupt:
        leave()
    command(prog_name="rbfmu")


if __name__ == "__main__":
    main()
