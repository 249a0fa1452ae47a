"""FMUs of both kinds and versions in every importer on this machine; a system of three units in libcosim."""

import importlib.util
import re
import shlex
import shutil
import subprocess
import sys
from functools import cache

import fmpy
import pytest

from examples.interop import elsewhere, importers, omsimulator, pyfmi_master, run as interop
from tests.support.compilers import can_link
from tests.support.fmu.fmus import workshop
from tests.support.paths import ROOT

WITHOUT_PYTHON = {"ecos", "fmuCheck", "fmusim", "OMSimulator"}
"""Hosts in which a pythonfmu FMU cannot be loaded."""
FMI3 = ("fmi3", "fmi3_scalars")
REFUSE = {
    "CoFMuPy": dict.fromkeys(interop.KINDS, "fmi2GetReal failed")
    | {"fmi3": "Float64 not supported", "fmi3_scalars": "fmi3GetFloat64 failed"},
    "CasADi": dict.fromkeys(interop.FMUS, "must be of ModelExchange type"),
    "libcosimpy": dict.fromkeys(FMI3, "Unsupported FMI version"),
    "fmuCheck": dict.fromkeys(FMI3, "version of FMI standard is not supported"),
    "PyFMI": dict.fromkeys(FMI3, "FMI3 Co-Simulation FMUs is not yet supported"),
    "ecospy": {"fmi3": "Illegal value type"},
    "ecos": {"fmi3": "3 numbers a step of 10"},
    "OMSimulator": {"fmi3": "1 values: expected 9"},
}
"""What importers say of FMUs that they do not run: CoFMuPy reads each output as a floating-point number, CasADi imports
model exchange alone, others know no FMI 3.0, or no arrays.
"""


@cache
def built(kind):
    return interop.build(interop.scene_to_try(), workshop(), kind)


@pytest.mark.parametrize("kind", interop.FMUS)
@pytest.mark.parametrize("name", importers.IMPORTERS)
def test_importer_gets_the_kernels_bits(name, kind):
    if interop.version_of(name) is None:
        pytest.skip(f"{name} is not on this machine")
    if kind != "python" and not can_link():
        pytest.skip("no C compiler")
    importer, refusal = importers.IMPORTERS[name], REFUSE.get(name.partition(",")[0], {}).get(kind)
    result = interop.try_importer(name, built(kind), interop.scene_to_try(), kind == "fmi3")
    if refusal:
        assert result.startswith("failed: ")
        assert refusal in result
    elif kind == "python" and name in WITHOUT_PYTHON:
        assert result.startswith("failed: "), result
    elif importer.array_digits and kind == "fmi3":
        assert result == f"same to the {importer.array_digits} digits it writes"
    elif importer.decimals or importer.digits:
        written = f"{importer.decimals} decimals" if importer.decimals else f"{importer.digits} digits"
        assert result == f"same to the {written} it writes"
    else:
        assert result == "same bits"


def test_with_arrays_an_importer_sets_and_reads_whole_vectors():
    job = interop.job_of(interop.scene_to_try(), interop.VALUES, arrays=True)
    assert job["values"] == {"torque_b": [0.01, -0.02, 0.03], "omega_b_0": [0.25, -0.2, 0.15]}
    assert job["outputs"] == ["quaternion", "rpy", "omega_b"]
    assert importers.texts(job["values"])[1] == ("omega_b_0", "0.25 -0.2 0.15")
    plain = interop.job_of(interop.scene_to_try(), interop.VALUES, arrays=False)
    assert plain["values"] == interop.VALUES
    assert plain["outputs"][:5] == [*(f"quaternion[{k}]" for k in (1, 2, 3, 4)), "rpy[1]"]


def test_an_array_in_a_file_is_as_many_columns(tmp_path):
    file = tmp_path / "out.csv"
    file.write_text('"time","v","status"\n0,1 2,0\n0.5,3.5 -4e-3,0\n')
    assert importers.table(file, ["v", "time"]) == [[3.5, -4e-3, 0.5]]


def test_an_importer_may_have_a_python_of_its_own(monkeypatch):
    monkeypatch.setenv("RBFMU_INTEROP_PYTHONS", f"FMPy={shlex.quote(sys.executable)} PyFMI=/no/python")
    assert interop.python_of("FMPy") == interop.python_of("ecospy") == sys.executable
    assert interop.version_of("FMPy") == fmpy.__version__
    assert interop.version_of("PyFMI") is None


def test_an_importer_that_fails_says_how(tmp_path):
    """The table's verdicts can be bad."""
    no_fmu = tmp_path / "no.fmu"
    no_fmu.write_bytes(b"no archive")
    result = interop.try_importer("fmpy simulate", no_fmu, interop.scene_to_try())
    assert result.startswith("failed: exit status 1: ")
    assert "zip" in result


def test_a_wrong_value_is_seen(monkeypatch):
    expected = interop.by_kernels(interop.scene_to_try(), {})
    wrong = expected.copy()
    wrong[50, 3] += 1e-15
    full, short = importers.IMPORTERS["FMPy"], importers.IMPORTERS["ecos"]
    assert interop.comparison(full, expected, expected) == "same bits"
    assert interop.comparison(full, wrong, expected) == "failed: off by 1.0e-15"
    assert interop.comparison(short, expected.round(6), expected) == "same to the 6 decimals it writes"
    assert interop.comparison(short, expected + 1e-6, expected) == "failed: off by 1.0e-06"
    assert interop.comparison(full, expected[:-1], expected) == "failed: 99 steps of 100"
    assert interop.comparison(full, expected[:, :3], expected) == "failed: 3 numbers a step of 10"
    digits = importers.IMPORTERS["OMSimulator"]
    assert interop.comparison(digits, interop.to_digits(expected, 12), expected) == "same to the 12 digits it writes"
    assert interop.comparison(digits, interop.to_digits(wrong, 11), expected).startswith("failed: off by")


@pytest.mark.thorough
@pytest.mark.parametrize("kind", interop.KINDS)
def test_a_system_of_three_units_in_libcosim_is_the_loop_of_direct_calls(kind, capsys):
    pytest.importorskip("libcosimpy")
    spec = importlib.util.spec_from_file_location("system", ROOT / "examples" / "05_system.py")
    system = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(system)
    assert system.main(kind) == 0.0
    last = capsys.readouterr().out.splitlines()[-2]
    # held rates make the navigator's attitude drift by a degree, which the controller then holds
    assert 0.5 < float(last.split(": ")[1].split()[0]) < 1.5


@pytest.mark.thorough
@pytest.mark.parametrize("kind", interop.KINDS)
def test_two_joined_satellites_in_libcosim_are_two_simulators(kind):
    pytest.importorskip("libcosimpy")
    example = ROOT / "examples" / "06_joined_satellites.py"
    done = subprocess.run([sys.executable, example, kind], capture_output=True, text=True, check=True, timeout=1200)
    distances = [float(x) for x in re.findall(r"(\S+) m apart", done.stdout)]
    assert distances == sorted(distances, reverse=True)
    assert float(re.search(r"moved by (\S+) m", done.stdout)[1]) < 1e-13
    assert done.stdout.endswith("largest difference to libcosim: 0.0\n")


@pytest.mark.thorough
@pytest.mark.parametrize("kind", interop.KINDS)
def test_a_group_of_variables_connects_two_fmus_in_libcosim(kind):
    pytest.importorskip("libcosimpy")
    example = ROOT / "examples" / "07_groups.py"
    done = subprocess.run([sys.executable, example, kind], capture_output=True, text=True, check=True, timeout=1200)
    assert 0.1 < float(re.search(r"off by (\S+) deg", done.stdout)[1]) < 2.0  # the navigator has rates at all
    assert done.stdout.endswith("largest difference to libcosim: 0.0\n")


@pytest.mark.thorough
def test_what_is_run_elsewhere_is_compared_here(tmp_path, capsys):
    """Simulink and Dymola are not here: their result is, as a file."""
    elsewhere.prepare(tmp_path)
    made = {"native.fmu", "expected.csv", "interop_simulink.m", "interop_dymola.mos", "FORM.md"}
    assert {path.name for path in tmp_path.iterdir()} == made
    head, *rows = (tmp_path / "expected.csv").read_text().splitlines()
    start = ",".join(["0.0", *["0"] * head.count(",")])
    result = tmp_path / "result.csv"
    result.write_text("\n".join([head, start, *rows]))
    assert elsewhere.compare(tmp_path) == 0.0
    wrong = rows[50].rpartition(",")[0] + ",0.7"
    result.write_text("\n".join([head, start, *rows[:50], wrong, *rows[51:]]))
    assert elsewhere.compare(tmp_path) > 0.01
    assert "of omega_b[3]" in capsys.readouterr().out
    result.write_text("\n".join([head, start, *rows[:50]]))
    with pytest.raises(SystemExit, match=r"no row for t = 6\.375 s"):
        elsewhere.compare(tmp_path)


def test_two_fmus_in_omsimulator_are_two_simulators():
    if not shutil.which("OMSimulator"):
        pytest.skip("OMSimulator is not on this machine")
    assert omsimulator.main() == 0.0


def test_pyfmi_s_master_holds_inputs_goes_back_and_solves_a_loop(tmp_path):
    if interop.version_of("PyFMI") is None:
        pytest.skip("PyFMI is not on this machine")
    pyfmi_master.build(tmp_path)
    script = [interop.python_of("PyFMI"), pyfmi_master.__file__, tmp_path, "run"]
    subprocess.run(script, check=True, timeout=1200, cwd=tmp_path, capture_output=True)
    found = pyfmi_master.compare(tmp_path)
    assert found["held inputs, to two simulators"] == 0.0
    assert found["algebraic loop, to its exact solution (rad/s)"] < 1e-9
    errors = {name: found[f"{name} steps, error relative to the largest rate"] for name in ("fixed", "controlled")}
    assert errors["controlled"] < 0.1 * errors["fixed"]
