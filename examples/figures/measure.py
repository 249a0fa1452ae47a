"""How each file of figures is measured anew."""

import importlib.util
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from examples.figures import record

Rows = list[dict[str, Any]]
NEEDED = {
    "peers": ("heyoka", "numbalsoda", "scipy"),
    "gallery_cost": ("mujoco",),
    "kernels": ("scipy", "quaternion", "quaternionic"),
    "interop": ("libcosimpy", "ecospy"),
}
"""Packages without which figures would miss a peer."""
PEERS_CASES = ("a", "c", "c'", "d", "f")


def peers() -> Rows:
    """Return plans beside the best peers."""
    from examples.benchmarks import plans
    from rbfmu.studies.work_precision.plans import verdicts

    return plans.rows(verdicts(plans.collected(PEERS_CASES, plans.FASTEST)))


def gallery_cost() -> Rows:
    """Return what the gallery's scenes cost; the picture is drawn too."""
    from dataclasses import asdict

    from examples.benchmarks import gallery

    return list(map(asdict, gallery.main(record.place("gallery_cost").parent)))


def kernels() -> Rows:
    """Return array functions beside others, ns an item."""
    from examples.benchmarks import kernels as bench

    with tempfile.TemporaryDirectory() as folder:
        return bench.main(Path(folder))


def native() -> Rows:
    """Return ratios of what a native step costs, medians."""
    from examples.benchmarks import native as bench

    return [{"scene": scene, **{who: figures.get(who, "") for who in bench.GOALS}} for scene, figures in
            bench.main().items()]  # fmt: skip


def interop() -> Rows:
    """Return importers and what came of them."""
    from examples.interop import run

    return run.main()


MEASURED: dict[str, Callable[[], Rows]] = {
    "peers": peers, "gallery_cost": gallery_cost, "kernels": kernels, "native": native, "interop": interop,
}  # fmt: skip


def missing(name: str) -> list[str]:
    """Return what is not installed of that which these figures need."""
    if name == "interop":  # where each may have a Python of its own
        from examples.interop.run import version_of

        return [importer for importer in NEEDED[name] if version_of(importer) is None]
    return [package for package in NEEDED.get(name, ()) if importlib.util.find_spec(package) is None]


def measure(name: str) -> None:
    """Measure and keep these figures. Raises SystemExit where a peer is not installed."""
    if lacking := missing(name):
        raise SystemExit(f"{name}: measured only with {', '.join(lacking)} installed (extras bench, interop)")
    record.write(name, MEASURED[name]())
