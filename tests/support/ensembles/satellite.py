"""A small ensemble: a hundred runs in chunks of eight, of which some fail."""

from pathlib import Path

from rbfmu import EnsembleResult, Scene, load_scene
from rbfmu.ensembles.running import run_ensemble
from rbfmu.runs.plan import Plan

FILE = Path(__file__).with_name("satellite.toml")
PLAN = Plan("body under loads, by series", "series", 7, tolerance=1e-9, order=12, cost=7.5e6)
"""A plan whose stated cost makes chunks of 8 members."""
STORES = ["store.npz", "store.zarr"]
"""A name for each kind of store."""


def satellite() -> Scene:
    """Return the scene."""
    return load_scene(FILE)


def run(scene, *arguments, **options) -> EnsembleResult:
    """Run its ensemble."""
    return run_ensemble(scene, *arguments, planned=PLAN, progress=False, **options)


def assert_same(a: EnsembleResult, b: EnsembleResult) -> None:
    """All numbers have the same bits, and what is said of them is the same."""
    assert a.failed == b.failed
    mine, theirs = a.to_xarray(), b.to_xarray()
    assert set(mine.variables) == set(theirs.variables)
    for name in mine.variables:
        assert mine[name].values.tobytes() == theirs[name].values.tobytes(), name
        assert mine[name].attrs == theirs[name].attrs
