"""FMUs in every importer on this machine: `interop.py [FOLDER]` writes interop.csv and interop.md there.

The FMUs are both kinds by FMI 2.0, and native ones by FMI 3.0 with arrays and without.

Importers: FMPy; libcosimpy, ecospy and tbb from PyPI (`pip install .[interop]`); PyFMI, CoFMuPy and CasADi where they
are installed; the programs fmuCheck.linux64, fmusim and OMSimulator where they are on the path. Values are set before
initialisation, and the outputs of 100 steps compared with direct calls of the kernels. An importer whose packages do
not go with these may have a Python of its own: RBFMU_INTEROP_PYTHONS="PyFMI=/path/to/python CoFMuPy=/path/to/python".
"""

import csv
import json
import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import rbfmu
import rbfmu_fmu
from examples.interop import importers
from examples.interop.importers import IMPORTERS, Importer
from rbfmu.extras import remedy
from rbfmu.runs.plan import filled_buffer, initialize
from rbfmu_fmu.description import describe

SCENE = Path(__file__).parents[1] / "scenes" / "controlled_satellite.toml"
VALUES = {"torque_b[1]": 0.01, "torque_b[2]": -0.02, "torque_b[3]": 0.03, "omega_b_0[1]": 0.25}
STEP, STEPS = 0.125, 100
"""s: exact in binary, so that every importer's clock says the same."""
LISTED = ("omega_b_0",)
"""Parameters among them: only what a scene lists may be set."""
KINDS = ("python", "native")
FMUS: dict[str, dict[str, Any]] = {
    **{kind: {"kind": kind} for kind in KINDS},
    "fmi3": {"kind": "native", "fmi": 3},
    "fmi3_scalars": {"kind": "native", "fmi": 3, "scalars": True},
}
"""Arguments of `rbfmu_fmu.build` for what is tried, by its name in the figures."""
COLUMNS = ("importer", "version", "FMU", "result")
INSTALLED = ("fmpy", "libcosimpy", "ecospy")
"""Packages of importers that rbfmu with its extra brings along."""
PATIENCE = 60.0
"""Seconds that an importer gets."""


def scene_to_try() -> rbfmu.Scene:
    """Return the satellite, whose first rates may be set."""
    return rbfmu.load_scene(SCENE).replace({"inputs.parameters": LISTED})


def by_kernels(scene: rbfmu.Scene, values: dict[str, float]) -> np.ndarray:
    """Return outputs (STEPS, n) by direct calls."""
    plan = rbfmu.plan(scene)
    variables, z = describe(scene, plan).variables, filled_buffer(scene, plan)
    for v in variables:
        z[v.offset] = values.get(v.name, z[v.offset])
    initialize(scene, plan.kernels, z)
    wanted, rows = [v.offset for v in variables if v.causality == "output"], []
    for _ in range(STEPS):
        assert plan.kernels.step(z, STEP) == 0
        rows.append(z[wanted])
    return np.array(rows)


def python_of(name: str) -> str:
    """Return the Python in which an importer runs."""
    own = dict(pair.split("=", 1) for pair in shlex.split(os.environ.get("RBFMU_INTEROP_PYTHONS", "")))
    return own.get(name.partition(",")[0], sys.executable)


def version_of(name: str) -> str | None:
    """Return an importer's version; None where it is not there."""
    try:
        done = subprocess.run([python_of(name), importers.__file__, name], capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() or None


def job_of(scene: rbfmu.Scene, values: dict[str, float], arrays: bool) -> dict[str, Any]:
    """Return what an importer is to do; arrays: a vector is one variable, of which an element is set with the others.

    Values must be those of vectors or scalars: a symmetric matrix has fewer variables than elements.
    """
    variables = describe(scene, rbfmu.plan(scene)).variables
    outputs = [v.block if arrays else v.name for v in variables if v.causality == "output"]
    given: dict[str, Any] = values
    if arrays:
        blocks = {v.block: [u for u in variables if u.block == v.block] for v in variables if v.name in values}
        given = {block: [values.get(v.name, v.start) for v in of] for block, of in blocks.items()}
    return {"values": given, "outputs": list(dict.fromkeys(outputs)), "step": STEP, "steps": STEPS}


def try_importer(name: str, fmu: Path, scene: rbfmu.Scene, arrays: bool = False) -> str:
    """Return what came of it, in words."""
    importer = IMPORTERS[name]
    values = VALUES if importer.sets_values else {}
    job = job_of(scene, values, arrays)
    command = [python_of(name), "-X", "faulthandler", importers.__file__, name, str(fmu), json.dumps(job)]
    environment = {"LD_LIBRARY_PATH": f"{Path(python_of(name)).parents[1]}/lib"} | os.environ
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, env=environment)
    except subprocess.TimeoutExpired:
        return f"failed: nothing within {PATIENCE:.0f} s"
    if done.returncode:
        return "failed: " + importers.ending(done.returncode, done.stderr).removeprefix("exit status 1: error: ")
    digits = importer.array_digits or importer.digits if arrays else importer.digits
    found = np.array(json.loads(done.stdout.splitlines()[-1]))
    return comparison(importer._replace(digits=digits), found, by_kernels(scene, values))


def comparison(importer: Importer, found: np.ndarray, expected: np.ndarray) -> str:
    """Return `same bits`, `same to the digits it writes`, or how far off."""
    if len(found) != len(expected):
        return f"failed: {len(found)} steps of {len(expected)}"
    if found.shape != expected.shape:
        return f"failed: {found.shape[1]} numbers a step of {expected.shape[1]}"
    difference = float(np.max(np.abs(found - expected)))
    if np.array_equal(found, expected):
        return "same bits"
    if importer.digits and np.array_equal(found, to_digits(expected, importer.digits)):
        return f"same to the {importer.digits} digits it writes"
    if importer.decimals and difference <= 0.5000001 * 10.0**-importer.decimals:
        return f"same to the {importer.decimals} decimals it writes"
    return f"failed: off by {difference:.1e}"


def to_digits(numbers: np.ndarray, digits: int) -> np.ndarray:
    """Return numbers as they are read from a file that has so many digits of them."""
    return np.array([float(f"{x:.{digits}g}") for x in numbers.ravel()]).reshape(numbers.shape)


def build(scene: rbfmu.Scene, folder: Path, kind: str) -> Path | str:
    """Return the FMU, or why there is none."""
    try:
        return rbfmu_fmu.build(scene, folder / f"{kind}.fmu", **FMUS[kind])
    except (ValueError, RuntimeError, OSError) as error:
        return f"not built: {error}"


def rows_of(scene: rbfmu.Scene, folder: Path) -> list[dict[str, str]]:
    """Return a row for every importer and FMU."""
    fmus, rows = {kind: build(scene, folder, kind) for kind in FMUS}, []
    for name, importer in IMPORTERS.items():
        version = version_of(name)
        for kind, fmu in fmus.items():
            if version is None:
                result = absent(importer)
            else:
                result = fmu if isinstance(fmu, str) else try_importer(name, fmu, scene, kind == "fmi3")
            rows.append(dict(zip(COLUMNS, (name, version or "", kind, result), strict=True)))
    return rows


def absent(importer: Importer) -> str:
    """Return what an importer that is not here needs."""
    if importer.package is None:
        return f"no {importer.program} on PATH"
    if importer.package in INSTALLED:
        return f"not installed: {remedy('interop')}"
    return f"not installed: no extra has {importer.package}, which may have a Python of its own (RBFMU_INTEROP_PYTHONS)"


def markdown(rows: list[dict[str, str]]) -> str:
    """Return a table of them."""
    lines = [COLUMNS, ("---",) * len(COLUMNS), *(tuple(row.values()) for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def main(folder: str | None = None) -> list[dict[str, Any]]:
    """Print the table; write it where a folder is named."""
    with tempfile.TemporaryDirectory() as place:
        rows = rows_of(scene_to_try(), Path(place))
    print(markdown(rows), end="")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        Path(folder, "interop.md").write_text(markdown(rows))
        with open(Path(folder, "interop.csv"), "w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)
    return rows


if __name__ == "__main__":
    main(*sys.argv[1:])
