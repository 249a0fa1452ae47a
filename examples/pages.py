"""The tables of the pages that are made from code and figures.

They stand between `<!-- made by examples.pages: NAME -->` and `<!-- end -->`. `python -m examples.pages` writes them;
with `--measure stale` it first takes anew all figures whose sources have changed, with `--measure NAME ...` some.
Times want a machine with nothing else to do.
"""

import argparse
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from typing import Any

import rbfmu
import rbfmu_kernels
from examples.figures import record
from examples.gallery import page as gallery
from rbfmu import arrays
from rbfmu.formulas.check import given_to, unit_numbers
from rbfmu.formulas.motion import Motion
from rbfmu.scene.keys import scene_keys
from rbfmu.studies import short
from rbfmu_kernels.types import python_function

PAGES = tuple(
    record.ROOT / name
    for name in (
        "README.md", "kernels/README.md", "rbfmu/README.md", "fmu_build/README.md", "examples/README.md",
        "examples/site/choosing.md", *(f"examples/site/tours/{name}.md" for name in ("couple", "fly", "teach")),
    )
)  # fmt: skip
PLACE = re.compile(r"(<!-- made by examples\.pages: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


SURE = 2.0
"""The factor up to which ratios of times hold, as the page says, that were measured on a machine with other work."""


def two_digits(number: float) -> str:
    """Return a number to two digits, without an exponent."""
    return f"{float(f'{number:.2g}'):,.12g}"


def accuracy_and_cost() -> str:
    """Return what plans and the best peers take for each accuracy, and the machine."""
    head, rows = record.read("peers")
    accuracies = list(dict.fromkeys(row["accuracy"] for row in rows))
    table = [
        [motion, f"{int(outputs):,}", *map(times, group)]
        for (motion, outputs), group in groupby(rows, lambda row: (row["motion"], row["outputs"]))
    ]
    titles = ["motion", "outputs", *(f"error {short(float(accuracy))}" for accuracy in accuracies)]
    measured = (
        "An unnamed program is heyoka.py; LSODA and DOP853 are numbalsoda's. "
        f"Bold marks a cost lower by more than a factor of {SURE:g}."
    )
    return f"{markdown(titles, table)}\n{measured} {machine(head)}\n"


def times(row: dict[str, str]) -> str:
    """Return both times in microseconds, the lesser bold if that is sure; heyoka.py, the usual peer, is not named."""
    own, other = (two_digits(1e6 * float(row[who])) for who in ("seconds", "peer_seconds"))
    if (ratio := float(row["peer_seconds"]) / float(row["seconds"])) > SURE:
        own = f"**{own}**"
    elif ratio < 1.0 / SURE:
        other = f"**{other}**"
    return f"{own} / {other}" + (f" {row['peer'].removeprefix('numbalsoda ')}" if row["peer"] != "heyoka.py" else "")


def machine(head: Sequence[str]) -> str:
    """Return on what figures were measured, without what was not installed."""
    found = [line for line in head if "not installed" not in line]
    processor = found[0].split(",")[0].replace("(R)", "")
    return f"Measured on: {processor}, two shared cores; {', '.join(found[1:])}."


def keys() -> str:
    """Return all keys of a scene, table by table."""
    parts = []
    for table, group in groupby(scene_keys(), lambda key: key.table):
        rows = [[f"`{key.name}`", key.unit, key.default and f"`{key.default}`", key.meaning] for key in group]
        title = f"`[{table}]`" if table else "before all tables"
        parts.append(f"**{title}**\n\n" + markdown(["key", "unit", "default", "meaning"], rows))
    return "\n".join(parts).replace("`required`", "required").replace("`all there are`", "all there are")


STATED = (
    "compose_quaternions", "rotate", "matrix_from_quaternion", "quaternion_from_matrix", "compose_matrices",
    "quaternion_from_euler", "quaternion_from_rotvec", "rotvec_from_quaternion", "angle_between",
)  # fmt: skip
"""Functions whose docstrings the page on kernels quotes."""


def errors() -> str:
    """Return what some docstrings say of the error and of places without a value."""
    rows = []
    for name in STATED:
        text = " ".join((getattr(rbfmu, name).__doc__ or "").split("\n"))
        (error, singular) = re.findall(r"Error <= (.*?)\.\s{2,}Singular: (.*?)\.(?:\s|$)", text)[0]
        rows.append([f"`{name}`", error.replace("|", "\\|"), singular.replace("|", "\\|")])
    return markdown(["function", "error at most", "singular"], rows)


PARTS = {
    "rotations.vec3": "Vectors", "rotations.matrix": "Rotation matrices",
    "rotations.quaternion": "Euler parameters (quaternions), and the error of an attitude",
    "rotations.euler_angles": "Euler angles",
    "rotations.rotation_vector": "Rotation vectors, axis and angle",
    "rotations.rodrigues": "Gibbs (Rodrigues) parameters and modified ones (MRP)",
    "mechanics.kinematics": "Velocities and accelerations", "mechanics.inertia": "Inertia",
    "mechanics.newton_euler": "Newton and Euler", "mechanics.spatial": "Homogeneous transforms, twists, wrenches",
    "exact.free_rotation": "Motion without torque", "numerics.elementary": "Elementary functions",
}  # fmt: skip
"""Modules of functions, in the page's order, and what they are about."""


def functions() -> str:
    """Return all functions, part by part, with the first lines of their docstrings."""
    rows: dict[str, list[list[str]]] = {part: [] for part in PARTS}
    for name in rbfmu_kernels.__all__:
        if callable(getattr(rbfmu_kernels, name)) and name not in ("Matrix", "Quaternion", "Vec3"):
            kernel = getattr(rbfmu_kernels, name)
            summary, _, _ = (getattr(arrays, name, python_function(kernel)).__doc__ or "").partition("\n")
            where = "both" if name in arrays.__all__ else "`rbfmu_kernels`"
            part = python_function(kernel).__module__.removeprefix("rbfmu_kernels.")
            rows[part].append([f"`{name}`", where, summary.replace("|", "\\|")])
    head = ["function", "in", "what it does"]
    return "\n".join(f"**{title}**\n\n{markdown(head, rows[part])}" for part, title in PARTS.items())


def formulas() -> str:
    """Return the functions that formulas know."""
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]})
    known = Motion(given_to(scene, unit_numbers())).functions
    rows = [[f"`{name}({function.takes})`", function.meaning] for name, function in known.items()]
    return markdown(["function", "what it gives"], rows)


def kernels() -> str:
    """Return ns an item of array functions, and of others as multiples."""
    head, rows = record.read("kernels")
    others = ("SciPy", "numpy-quaternion", "quaternionic", "copy")
    table = [
        [row["operation"], two_digits(float(row["rbfmu"])), *(ratio(row, other, "rbfmu") for other in others)]
        for row in rows
    ]
    titles = ["a million items, one thread", "ns an item", *(f"{other}, times" for other in others)]
    return f"{markdown(titles, table)}\n{machine(head)}\n"


def ratio(row: dict[str, str], one: str, other: str) -> str:
    """Return how many times one figure is another."""
    return two_digits(float(row[one]) / float(row[other])) if row[one] else ""


def native() -> str:
    """Return ratios of what a step of native FMUs takes."""
    head, rows = record.read("native")
    titles = ["model", "over the same kernel in a Numba loop", "over C by hand, -O3", "over the pythonfmu kind"]
    who = ("numba loop", "by hand", "pythonfmu")
    table = [[row["scene"], *(two_digits(float(row[x])) if row[x] else "" for x in who)] for row in rows]
    start = float(next(row["first step"] for row in rows if row["first step"]))
    first = f"The first step of a process takes {start:.2f} times as long as with an FMU that does nothing."
    return f"{markdown(titles, table)}\n{first} {machine(head)}\n"


_NATIVE_KIND = "take the native kind"
_OR_PRELOADED = "take the native kind, or `LD_PRELOAD=libpython3.x.so`"
IMPORTERS = {
    "FMPy": ("FMPy", "`fmpy.simulate_fmu`, as below"),
    "fmpy simulate": ("FMPy, as a command", "`fmpy simulate native.fmu`"),
    "libcosimpy": ("libcosim (Open Simulation Platform)", "`pip install libcosimpy`, then as "
                   "[05_system.py](../examples/05_system.py): two FMUs and a controller in a system file"),
    "ecospy": ("Ecos in Python (ecospy)", "`pip install ecospy tbb`, then "
               "`export LD_LIBRARY_PATH=$(python -c 'import sys; print(sys.prefix)')/lib`, where Ecos finds tbb"),
    "ecos": ("Ecos, the program", _OR_PRELOADED),
    "fmuCheck": ("fmuCheck, the FMU Compliance Checker", _OR_PRELOADED),
    "fmusim": ("fmusim, of the Reference FMUs", _OR_PRELOADED),
    "OMSimulator": ("OMSimulator, the program", _OR_PRELOADED),
    "PyFMI": ("PyFMI", "`pyfmi.load_fmu`"),
    "CoFMuPy": ("CoFMuPy", "it reads every output as a floating-point number, and `status` is an integer"),
    "CasADi": ("CasADi", "it imports model exchange alone"),
}  # fmt: skip
"""By the name in the figures: the importer's name on the page, and how an FMU runs there."""
NEVER_TRIED = ("Simulink", "Dymola")
TRIED = {
    "native": "FMI 2.0, native",
    "python": "FMI 2.0, pythonfmu",
    "fmi3": "FMI 3.0, arrays",
    "fmi3_scalars": "FMI 3.0, scalars",
}
"""By the name of an FMU in the figures: its column on the page."""


def importers() -> str:
    """Return how an FMU runs in each importer, and what came of each FMU there."""
    _, rows = record.read("interop")
    table = []
    for name, (title, how) in IMPORTERS.items():
        of = [row for row in rows if row["importer"].partition(",")[0] == name]
        table.append([title, of[0]["version"], *(tried(of, fmu) for fmu in TRIED), how])
    table += [[name, "", *["not tried"] * len(TRIED), _NATIVE_KIND] for name in NEVER_TRIED]
    return markdown(["importer", "version", *TRIED.values(), "how"], table)


def tried(rows: Sequence[dict[str, str]], fmu: str) -> str:
    """Return what came of an FMU in an importer, and with libpython loaded into it, where that is something else."""
    plain, *preloaded = (row["result"] if row["version"] else "not tried" for row in rows if row["FMU"] == fmu)
    return "; ".join([plain.rstrip("."), *(f"with libpython: {result}" for result in preloaded if result != plain)])


TABLES: dict[str, Callable[[], str]] = {
    "accuracy-and-cost": accuracy_and_cost,
    "scene-keys": keys,
    "errors": errors,
    "functions": functions,
    "formulas": formulas,
    "kernels": kernels,
    "native": native,
    "importers": importers,
}


def filled(text: str) -> str:
    """Return a page's text with its tables as they should be. Raises KeyError for one that nothing makes."""
    return PLACE.sub(lambda found: found[1] + TABLES[found[2]]() + found[3], text)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure what is asked for, and write the pages."""
    parser: Any = argparse.ArgumentParser(description="Write the tables of the pages.")
    names = ("stale", *record.SOURCES)
    parser.add_argument("--measure", nargs="+", default=[], choices=names, help="figures to take anew")
    asked = parser.parse_args(arguments).measure
    for name in record.SOURCES:
        if name in asked or ("stale" in asked and not record.is_up_to_date(name)):
            # In a process of its own: the memory of a process, which a figure shows, has all that it did before.
            subprocess.run((sys.executable, "-m", "examples.figures.measure", name), check=True)
            if name == "gallery_cost":
                gallery.PAGE.write_text(gallery.page(), encoding="utf-8")
    for page in PAGES:
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
