"""What is not installed is named in one line, with the extra that installs it; the main job needs no extra."""

import subprocess
import sys
import tomllib

import pytest

from examples.benchmarks.support import array_tasks
from examples.interop import importers, run as interop
from rbfmu.extras import remedy
from tests.support.ensembles.satellite import FILE as ENSEMBLE
from tests.support.fmu.fmus import bench
from tests.support.paths import ROOT, SCENES

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
NEEDED = {
    ("examples.benchmarks.costs", "scipy"): "bench", ("examples.benchmarks.kernels", "scipy"): "bench",
    ("examples.benchmarks.gallery", "mpmath"): "bench", ("examples.benchmarks.events", "scipy"): "bench",
    ("examples.references.reference_motions", "mpmath"): "bench", ("examples.05_system", "libcosimpy"): "interop",
    ("examples.06_joined_satellites", "libcosimpy"): "interop",
}  # fmt: skip
"""By module and the package that it cannot do without: the extra that installs it."""
MAIN_JOB = """
import sys
class Absent:
    def find_spec(name, path, target=None):
        if name.partition(".")[0] in {absent}:
            raise ModuleNotFoundError(f"no {{name}}", name=name)
sys.meta_path.insert(0, Absent)
sys.modules["ziglang"] = None  # it is not imported but looked for, which must find none
{then}
"""


def without(absent, then):
    program = MAIN_JOB.format(absent=absent, then=then)
    return subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)


@pytest.mark.thorough
@pytest.mark.parametrize(("program", "package"), NEEDED)
def test_a_program_without_its_package_ends_with_the_extra_s_name(program, package):
    done = without([package], f"import importlib; importlib.import_module({program!r})")
    extra = NEEDED[program, package]
    assert done.stderr.strip().endswith(f'is not installed: pip install "rbfmu[{extra}]"')
    assert done.stderr.count("\n") == 1
    assert any(line.startswith(package) for line in EXTRAS[extra])


def test_the_kernels_benchmark_names_peers_that_are_absent(monkeypatch):
    monkeypatch.setattr(array_tasks, "PEERS", {"Nobody's": ("no_such_module", None)})
    assert array_tasks.absent() == ['Nobody\'s: not installed (pip install "rbfmu[bench]")\n']


@pytest.mark.parametrize("name", ["derivatives", "events"])
def test_a_benchmark_without_heyoka_ends_with_the_extra_s_name(name, monkeypatch):
    monkeypatch.setitem(sys.modules, "heyoka", None)
    with pytest.raises(SystemExit, match=r'^heyoka is not installed: pip install "rbfmu\[bench\]"$'):
        bench(name).of_heyoka(None)


def test_importers_that_are_absent_name_the_extra_or_the_program():
    package, program = importers.IMPORTERS["ecospy"], importers.IMPORTERS["fmuCheck"]
    assert interop.absent(package) == 'not installed: pip install "rbfmu[interop]"'
    assert interop.absent(program) == "no fmuCheck.linux64 on PATH"


@pytest.mark.parametrize("name", ["FMPy", "libcosimpy", "ecospy", "PyFMI", "CoFMuPy", "CasADi"])
def test_an_extra_is_named_only_for_an_importer_that_it_installs(name):
    importer = importers.IMPORTERS[name]
    provided = any(line.startswith(str(importer.package)) for line in PROJECT["dependencies"] + EXTRAS["interop"])
    assert (remedy("interop") in interop.absent(importer)) == provided


def test_a_view_without_viser_is_one_message(tmp_path):
    scene = str(SCENES / "tumbling_brick.toml")
    done = without(["viser"], f"from rbfmu.cli import main\nmain(['view', {scene!r}, '-o', '{tmp_path}/it.html'])")
    assert done.returncode == 2
    assert done.stderr.endswith('Error: viser is not installed: pip install "rbfmu[view]"\n')
    assert not list(tmp_path.iterdir())


def test_a_spline_without_scipy_is_one_message():
    done = without(["scipy"], "import numpy, rbfmu\nrbfmu.attitude_spline(numpy.arange(4.0), numpy.ones((4, 4)))")
    assert done.stderr.endswith('ModuleNotFoundError: scipy is not installed: pip install "rbfmu[ensemble]"\n')


@pytest.mark.parametrize(("method", "package"), [("to_dataframe", "pandas"), ("to_xarray", "xarray")])
def test_a_table_without_its_package_is_one_message(method, package):
    made = "import numpy, rbfmu\nit = rbfmu.Result(numpy.arange(2.0), {'kinetic_energy': numpy.arange(2.0)})"
    done = without([package], f"{made}\nit.{method}()")
    assert done.stderr.endswith(f'ModuleNotFoundError: {package} is not installed: pip install "rbfmu[tables]"\n')


@pytest.mark.parametrize("extra", ["native", "bench", "interop", "view", "tables", "notebook"])
def test_an_extra_that_is_named_exists(extra):
    assert remedy(extra) == f'pip install "rbfmu[{extra}]"'
    assert EXTRAS[extra]


@pytest.mark.thorough
def test_the_main_job_needs_no_extra(tmp_path):
    """Scenes are run, planned, built into FMUs and verified, and the demonstration is loaded."""
    extras = (
        "viser", "pandas", "xarray", "ipywidgets", "IPython", "scipy", "mpmath", "ziglang", "libcosimpy", "ecospy",
        "tbb", "heyoka", "quaternion", "mujoco", "numbalsoda",
    )  # fmt: skip
    scene, fmu = str(SCENES / "gyro_attitude.toml"), str(tmp_path / "it.fmu")
    commands = (
        ["plan", scene], ["run", scene, "-o", str(tmp_path / "it.csv")], ["build", scene, "-o", fmu], ["verify", fmu],
    )  # fmt: skip
    calls = "".join(f"main({command}, standalone_mode=False)\n" for command in commands)
    done = without(extras, f"from rbfmu.cli import main\nimport rbfmu_fmu.demo\n{calls}")
    assert done.returncode == 0, done.stderr


OF_ENSEMBLES = ["scipy", "zarr", "xarray", "distributed"]


@pytest.mark.thorough
def test_an_ensemble_needs_no_extra_in_one_file_and_a_picture(tmp_path):
    store, picture = tmp_path / "store.npz", tmp_path / "picture.png"
    arguments = ["rbfmu", "ensemble", str(ENSEMBLE), "-o", str(store), "--plot", str(picture)]
    done = without(OF_ENSEMBLES, f"from rbfmu.cli import main; sys.argv = {arguments!r}; main()")
    assert done.returncode == 0, done.stderr
    assert {*tmp_path.iterdir()} == {store, picture}


@pytest.mark.thorough
@pytest.mark.parametrize(("options", "package", "extra"), [
    (["-o", "store.zarr"], "zarr", "ensemble"),
    (["--scheduler", "tcp://127.0.0.1:9"], "distributed", "cluster"),
])  # fmt: skip
def test_what_of_an_ensemble_needs_an_extra_says_so_before_it_runs(options, package, extra, tmp_path):
    options = [str(tmp_path / text) if "." in text and ":" not in text else text for text in options]
    arguments = ["rbfmu", "ensemble", str(ENSEMBLE), *options]
    done = without(OF_ENSEMBLES, f"from rbfmu.cli import main; sys.argv = {arguments!r}; main()")
    assert done.returncode == 2
    assert done.stderr.endswith(f'Error: {package} is not installed: pip install "rbfmu[{extra}]"\n')
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []
