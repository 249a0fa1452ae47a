"""How each file of figures is measured anew, and each picture drawn."""

import importlib.util
import runpy
import sys
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
    "own_chart": ("heyoka", "numbalsoda", "mujoco", "scipy"),
    "view": ("viser", "playwright"),
}
"""Packages without which figures would miss a peer."""
EARLIER = " (an earlier FMU)"
"""What is added to what an importer did that is not on the machine on which FMUs are tried now."""
PEERS_CASES = ("a", "c", "c'", "d", "f")


def peers() -> Rows:
    """Return plans beside the best peers."""
    from examples.benchmarks import plans
    from rbfmu.studies.chart import verdicts

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
    """Return importers and what came of them; one that is not on this machine keeps what came of an earlier FMU."""
    from examples.interop import run

    before = {(row["importer"], row["FMU"]): row for row in record.read("interop")[1]}
    return [row if row["version"] else _earlier(before.get((row["importer"], row["FMU"]), row)) for row in run.main()]


def _earlier(row: dict[str, Any]) -> dict[str, Any]:
    said = row["result"].removesuffix(EARLIER)
    return row | {"result": said + EARLIER} if row["version"] else row


def own_chart(path: Path) -> None:
    """Draw the chart of a falling top."""
    from examples.gallery.page import scene_file
    from rbfmu import chart

    chart(scene_file("top_falling")).figure().savefig(path)


def ensembles(path: Path) -> None:
    """Draw what ensembles cost by the number of runs."""
    from examples.benchmarks import ensembles as bench

    bench.draw(bench.costs(), path)


def tumbling_brick(path: Path) -> None:
    """Draw the picture of the demonstration."""
    from rbfmu import simulate
    from rbfmu_fmu.demo import draw, scene_file

    draw(simulate(scene_file("tumbling_brick.toml")), path)


def detumbling(path: Path) -> None:
    """Draw ten thousand releases of a satellite."""
    from rbfmu import run_ensemble

    run_ensemble(record.ROOT / "examples" / "detumbling.toml", progress=False).plot(path)


def b_dot(path: Path) -> None:
    """Draw ten thousand releases of a satellite that brakes its spin by coils."""
    from rbfmu import run_ensemble

    example = runpy.run_path(str(record.ROOT / "examples" / "09_detumbling.py"))
    run_ensemble(example["SCENE"], controller=example["CONTROLLER"], progress=False).plot(path)


def view(path: Path) -> None:
    """Photograph the page of a tumbling brick; needs a headless browser."""
    from examples.gallery.page import scene_file
    from rbfmu import view as view_of
    from tests.support.browser import photographed

    with tempfile.TemporaryDirectory() as folder:
        view_of(scene_file("tumbling_brick"), page := Path(folder) / "motion.html")
        photographed(page, path)


DRAWN: dict[str, Callable[[Path], None]] = {
    "own_chart": own_chart, "ensembles": ensembles, "tumbling_brick": tumbling_brick, "detumbling": detumbling,
    "b_dot": b_dot, "view": view,
}  # fmt: skip
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
    if name in DRAWN:
        DRAWN[name](record.place(name))
        record.stamp_picture(name)
    else:
        record.write(name, MEASURED[name]())


if __name__ == "__main__":
    measure(*sys.argv[1:])
