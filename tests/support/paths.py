"""Where things stand in the checkout."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "examples" / "scenes"
C_SOURCES = Path(__file__).parent / "fmu"
SOURCE_ROOTS = [str(ROOT / part) for part in (".", "kernels", "fmu_build")]
SHARED = ROOT.parent / "shared" / "reference"
"""Data that a clone does not have; tests of it skip."""
