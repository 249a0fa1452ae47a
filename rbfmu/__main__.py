"""`python -m rbfmu`."""

from rbfmu.cli import main

main(prog_name="rbfmu")
