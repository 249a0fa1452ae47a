"""Importers of FMUs, each made to run one FMU: `importers.py NAME FMU JOB` prints the outputs that it saw.

JOB is JSON: values to set before initialisation (lists where a variable is an array), outputs wanted, communication
step and number of steps. run.py runs each of these in a process of its own: a wrong FMU ends some of them with a
segmentation fault. `importers.py NAME` prints a version, or nothing where the importer is not there. This file needs
the importer alone.
"""

import importlib.metadata
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

Rows = list[list[float]]
"""The outputs wanted, after each communication step; elements of arrays one by one."""


class Importer(NamedTuple):
    """How to run an FMU; what the importer must find; whether it can set values; how many digits it writes.

    decimals, digits: behind the point, or in all; array_digits: of arrays. Without them, it shows full doubles.
    """

    run: Callable[[str, dict[str, Any]], Rows]
    package: str | None = None
    program: str | None = None
    sets_values: bool = True
    decimals: int | None = None
    digits: int | None = None
    array_digits: int | None = None


def fmpy_api(fmu: str, job: dict[str, Any]) -> Rows:
    """`fmpy.simulate_fmu`."""
    import fmpy
    import numpy as np

    result = fmpy.simulate_fmu(fmu, start_values=job["values"], output=job["outputs"], output_interval=job["step"],
                               stop_time=job["step"] * job["steps"])  # fmt: skip
    return [np.hstack(list(row)[1:]).tolist() for row in result[1:]]


def fmpy_command(fmu: str, job: dict[str, Any]) -> Rows:
    """`fmpy simulate`."""
    values = [text for pair in texts(job["values"]) for text in pair]
    run(Path(sys.executable).with_name("fmpy"), "simulate", fmu, "--output-interval", job["step"], "--stop-time",
        job["step"] * job["steps"], *(["--start-values", *values] if values else []), "--output-variables",
        *job["outputs"], "--output-file", "out.csv")  # fmt: skip
    return table("out.csv", job["outputs"])


def libcosim(fmu: str, job: dict[str, Any]) -> Rows:
    """Run the FMU in the Open Simulation Platform's library, through libcosimpy."""
    from libcosimpy._internal import get_last_error_message
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(round(job["step"] * 1e9))
    slave = CosimLocalSlave(fmu, "it")
    if not slave.ptr():  # with which libcosimpy would end in a segmentation fault
        raise RuntimeError(get_last_error_message())
    one = execution.add_local_slave(slave)
    reference = {v.name.decode(): v.reference for v in execution.slave_variables(one)}
    for name, value in job["values"].items():
        execution.real_initial_value(one, reference[name], value)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    rows = []
    for _ in range(job["steps"]):
        if not execution.step():
            raise RuntimeError(f"stopped: {execution.status()}")
        rows.append(list(observer.last_real_values(one, [reference[name] for name in job["outputs"]])))
    return rows


def ecos(fmu: str, job: dict[str, Any]) -> Rows:
    """Ecos, through ecospy."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("it", fmu)
    structure.add_parameter_set("values", {f"it::{name}": value for name, value in job["values"].items()})
    simulation, rows = EcosSimulation(structure=structure, step_size=job["step"]), []
    simulation.init(parameter_set="values")
    for _ in range(job["steps"]):
        simulation.step()
        rows.append([simulation.get_real(f"it::{name}") for name in job["outputs"]])
    simulation.terminate()
    return rows


def ecos_command(fmu: str, job: dict[str, Any], **environment: str) -> Rows:
    """Ecos' own program, which comes with ecospy: a host without Python."""
    wheel = importlib.metadata.distribution("ecospy")
    program = shutil.copy(str(wheel.locate_file("ecospy/binaries/ecos")), "ecos")  # the wheel's is not executable
    os.chmod(program, 0o755)
    run("./ecos", "simulate", "--path", fmu, "--stepSize", job["step"], "--stopTime", job["step"] * job["steps"],
        **environment)  # fmt: skip
    (written,) = Path.cwd().glob("*.csv")
    return table(written, [f"instance::{name}[REAL]" for name in job["outputs"]], ", ")


def with_python(host: Callable[..., Rows]) -> Callable[[str, dict[str, Any]], Rows]:
    """Return the same host with Python's shared library loaded into it."""
    return lambda fmu, job: host(fmu, job, **python_preloaded())


def python_preloaded() -> dict[str, str]:
    """Return variables of the environment that give a host without Python this Python."""
    folders = [sysconfig.get_config_var("LIBDIR"), f"/usr/lib/{sysconfig.get_config_var('MULTIARCH')}"]
    name = sysconfig.get_config_var("INSTSONAME")
    found = [Path(f, name) for f in folders if Path(f, name).suffix != ".a" and Path(f, name).exists()]
    if not found:
        raise RuntimeError(f"no shared {name} in {folders}")
    home = sys.base_prefix if str(found[0]).startswith(sys.base_prefix) else "/usr"
    packages = os.pathsep.join({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")})
    return {"LD_PRELOAD": str(found[0]), "PYTHONHOME": home, "PYTHONPATH": packages}


def compliance_checker(fmu: str, job: dict[str, Any], **environment: str) -> Rows:
    """FMUComplianceChecker: a host without Python."""
    run("fmuCheck.linux64", "-h", job["step"], "-s", job["step"] * job["steps"], "-o", "out.csv", fmu, **environment)
    return table("out.csv", job["outputs"])


def fmusim(fmu: str, job: dict[str, Any], **environment: str) -> Rows:
    """Fmusim of the Reference FMUs: a host without Python."""
    values = [text for pair in texts(job["values"]) for text in ("--start-value", *pair)]
    run("fmusim", *values, "--output-interval", job["step"], "--stop-time", job["step"] * job["steps"],
        "--output-file", "out.csv", fmu, **environment)  # fmt: skip
    return table("out.csv", job["outputs"])


def omsimulator(fmu: str, job: dict[str, Any], **environment: str) -> Rows:
    """OMSimulator's own program: a host without Python. It writes a time twice where something may have changed."""
    printed = run("OMSimulator", fmu, f"--stopTime={job['step'] * job['steps']}", f"--stepSize={job['step']}",
                  f"--intervals={job['steps']}", "--stripRoot=true", "--resultFile=out.csv", **environment)  # fmt: skip
    if "error:" in printed:
        raise RuntimeError(ending(1, printed))
    rows = {time: row for time, *row in table("out.csv", ["time", *job["outputs"]])}
    return [row for time, row in rows.items() if time > 0.0]


def pyfmi(fmu: str, job: dict[str, Any]) -> Rows:
    """PyFMI, with FMI Library."""
    from pyfmi import load_fmu

    model = load_fmu(fmu, log_level=0)
    model.setup_experiment(start_time=0.0, stop_time=job["step"] * job["steps"])
    for name, value in job["values"].items():
        model.set(name, value)
    model.initialize(0.0, job["step"] * job["steps"])
    rows = []
    for k in range(job["steps"]):
        if model.do_step(k * job["step"], job["step"]) != 0:
            raise RuntimeError(f"step {k} was refused")
        rows.append([float(model.get(name)[0]) for name in job["outputs"]])
    return rows


def cofmupy(fmu: str, job: dict[str, Any]) -> Rows:
    """CoFMuPy's coordinator, of one unit."""
    from cofmupy import Coordinator

    unit = {"id": "it", "name": "it", "path": fmu, "initialization": job["values"]}
    system = {"fmus": [unit], "connections": [], "cosim_method": "jacobi", "edge_sep": " -> ", "root": "/"}
    coordinator, rows = Coordinator(), []
    coordinator.start(system)
    for _ in range(job["steps"]):
        coordinator.do_step(job["step"])
        found = coordinator.master.get_outputs()["it"]
        rows.append([float(found[name][0]) for name in job["outputs"]])
    return rows


def casadi(fmu: str, job: dict[str, Any]) -> Rows:
    """CasADi's DaeBuilder, which imports model exchange alone."""
    from casadi import DaeBuilder

    shutil.unpack_archive(fmu, "unzipped", "zip")
    try:
        DaeBuilder("it", "unzipped")
    except RuntimeError as error:
        raise RuntimeError(str(error).splitlines()[-1]) from None
    raise RuntimeError("imported, but nothing is known here of how it steps")


IMPORTERS = {
    "FMPy": Importer(fmpy_api, "fmpy"),
    "fmpy simulate": Importer(fmpy_command, "fmpy", array_digits=16),
    "libcosimpy": Importer(libcosim, "libcosimpy"),
    "ecospy": Importer(ecos, "ecospy"),
    "ecos": Importer(ecos_command, "ecospy", sets_values=False, decimals=6),
    "ecos, libpython preloaded": Importer(with_python(ecos_command), "ecospy", sets_values=False, decimals=6),
    "fmuCheck": Importer(compliance_checker, program="fmuCheck.linux64", sets_values=False),
    "fmuCheck, libpython preloaded": Importer(
        with_python(compliance_checker), program="fmuCheck.linux64", sets_values=False
    ),
    "fmusim": Importer(fmusim, program="fmusim", digits=16),
    "fmusim, libpython preloaded": Importer(with_python(fmusim), program="fmusim", digits=16),
    "OMSimulator": Importer(omsimulator, program="OMSimulator", sets_values=False, digits=12),
    "OMSimulator, libpython preloaded": Importer(
        with_python(omsimulator), program="OMSimulator", sets_values=False, digits=12
    ),
    "PyFMI": Importer(pyfmi, "pyfmi"),
    "CoFMuPy": Importer(cofmupy, "cofmupy"),
    "CasADi": Importer(casadi, "casadi"),
}


def version(importer: Importer) -> str | None:
    """Of its package or its program, as far as that says one; None where it is not on this machine."""
    if importer.package is not None:
        try:
            return importlib.metadata.version(importer.package)
        except importlib.metadata.PackageNotFoundError:
            return None
    if not shutil.which(str(importer.program)):
        return None
    said = subprocess.run([str(importer.program), "--version"], capture_output=True, text=True, errors="replace")
    found = re.search(r"\d+(\.\w+)+", said.stdout + said.stderr)
    return found[0] if found else "own build"


def table(path: str | Path, names: list[str], separator: str = ",") -> Rows:
    """Columns of a text file, without the row of the start; blanks stand between elements of an array."""
    head, _, *lines = Path(path).read_text().splitlines()
    heads = [text.strip('"') for text in head.split(separator)]
    places = [heads.index(name) for name in names]
    return [[float(x) for k in places for x in line.split(separator)[k].split()] for line in lines]


def texts(values: dict[str, Any]) -> list[tuple[str, str]]:
    """Return names and values as programs take them; blanks stand between elements of an array."""
    return [(name, " ".join(map(str, x)) if isinstance(x, list) else str(x)) for name, x in values.items()]


def run(*command: object, **environment: str) -> str:
    """Return what a program printed; RuntimeError with its last line where it fails."""
    libraries = f"{sys.prefix}/lib"  # where pip puts the `tbb` that Ecos needs
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, errors="replace",
                          env={"LD_LIBRARY_PATH": libraries} | os.environ | environment)  # fmt: skip
    if done.returncode:
        raise RuntimeError(ending(done.returncode, done.stdout + done.stderr))
    return done.stdout + done.stderr


def ending(status: int, printed: str) -> str:
    """Return how a process ended, in words, with the line of what it printed that says most."""
    lines = [line.strip() for line in printed.splitlines() if line.strip()]
    errors = [line for line in lines if re.search(r"\berror\b|fatal", line, re.IGNORECASE)]
    how = str(signal.strsignal(-status)) if status < 0 else f"exit status {status}"
    said = [re.sub(r"(/[^\s/]+)+/", "", line) for line in errors[:1] or lines[-1:]]  # files without their folders
    return ": ".join([how, *said])


def main(name: str, fmu: str = "", job: str = "") -> None:
    """Run it in an empty folder; without an FMU, print its version."""
    if not fmu:
        print(version(IMPORTERS[name]) or "")
        return
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            rows = IMPORTERS[name].run(fmu, json.loads(job))
        except RuntimeError as error:
            sys.exit(f"error: {error}")
    print(json.dumps(rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
