"""`verify` passes what is right and finds what is wrong: a changed kernel, parameter, step or description."""

import gc
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import rbfmu
import rbfmu_fmu
from rbfmu_fmu import VerificationError, verification, verify
from tests.support.command_line import call_by_count

SCENE = {
    "body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.1, 0.2, -0.1]},
    "initial": {"omega_b": [0.3, 1.0, 0.2]},
    "inputs": {"ports": ["torque_b", "force_a"]},
    "run": {"stop": 2.0, "step": 0.1},
}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rbfmu_fmu.build(rbfmu.Scene.from_dict(SCENE), tmp_path_factory.mktemp("fmu") / "body.fmu")


def changed(fmu: Path, target: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A copy of an FMU with its files changed; a file for which `change` gives None is left out."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = change(name, old.read(name))
            if content is not None:
                new.writestr(name, content)
    return target


def test_an_fmu_equals_its_kernels_to_the_bit(fmu: Path) -> None:
    found = verify(fmu, seed=3)
    assert found.passed
    assert found.steps_done == found.steps_asked == 20
    assert set(found.differences.values()) == {0.0}
    assert len(found.differences) == 29
    assert not replace(found, steps_done=19).passed


def test_what_is_no_number_differs(fmu: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verification, "_run_by_kernels", lambda d, time, inputs: np.full((len(time), 29), np.nan))
    monkeypatch.setattr(verification, "_distance_to_full", lambda *_: 0.0)
    found = verify(fmu)
    assert set(found.differences.values()) == {np.inf}
    assert not found.passed


def test_later_messages_do_not_go_to_a_unit_that_is_gone(fmu: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """FMPy would send them to the last logger it was given, which `verify` has freed: the process crashed."""
    with verification.unit_of(fmu, verification._read_scene(fmu)[0]) as unit:
        pass
    unit.messages.clear()
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(str(fmu), start_values={"torque_b[1]": np.nan}, debug_logging=True, output=["status"])
    assert not unit.messages
    assert "torque_b[1] = nan" in capsys.readouterr().out


@pytest.mark.parametrize("seed", [-1, 1.5, True, "x"])
def test_a_seed_is_a_whole_number(seed: Any, fmu: Path) -> None:
    with pytest.raises(ValueError, match=r"seed = .*: expected a whole number from 0 to"):
        verify(fmu, seed=seed)


@pytest.mark.slow
def test_few_steps_are_verified_without_compiling_them(fmu: Path, tmp_path: Path) -> None:
    """Compiling the step took five seconds, and twenty steps in plain Python take a hundredth of one."""
    call_by_count(tmp_path, "verify", fmu)
    assert not [*tmp_path.rglob("*.step-*.nbi")]


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["python", "native"])
def test_an_fmu_equals_its_kernels_at_a_unix_clocks_times(kind: str, tmp_path: Path) -> None:
    run = {"start": 1e9, "stop": 1e9 + 1.0, "step": 0.3}
    scene = rbfmu.Scene.from_dict({"body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, "run": run})
    found = verify(rbfmu_fmu.build(scene, tmp_path / "late.fmu", kind=kind))
    assert found.passed
    assert found.steps_done == found.steps_asked == 4
    assert rbfmu.simulate(scene).time.tolist() == [1e9, 1e9 + 0.3, 1e9 + 0.6, 1e9 + 0.9, 1e9 + 1.0]


def _told(change: Callable[[Any], Any]) -> Callable[[str, bytes], bytes]:
    """What changes what an FMU has of its scene and plan."""
    return lambda name, content: (
        json.dumps(change(json.loads(content))).encode() if name == "resources/scene.json" else content
    )


def test_a_scene_that_differs_from_the_fmu_is_found(fmu: Path, tmp_path: Path) -> None:
    def heavier(data: Any) -> Any:
        data["scene"]["body"]["mass"] *= 1.0 + 2.0**-50
        return data

    found = verify(changed(fmu, tmp_path / "changed.fmu", _told(heavier)))
    assert not found.passed
    assert 0.0 < max(found.differences.values()) < 1e-9


def test_an_fmu_of_other_kernels_is_named(fmu: Path, tmp_path: Path) -> None:
    found = verify(changed(fmu, tmp_path / "changed.fmu", _told(lambda data: data | {"kernels": "0"})))
    assert not found.passed
    assert any("other kernels" in p for p in found.problems)


def test_an_fmu_without_the_name_of_its_script_is_refused_before_it_crashes(fmu: Path, tmp_path: Path) -> None:
    poorer = changed(fmu, tmp_path / "it.fmu", lambda name, content: None if "slavemodule" in name else content)
    with pytest.raises(VerificationError, match=r"has no resources/slavemodule\.txt, without which pythonfmu crashes"):
        verify(poorer)


def _poorer(renamed: str) -> Callable[[str, bytes], bytes]:
    """What leaves units and dependencies out of a description, and gives variables another name and reference."""

    def change(name: str, content: bytes) -> bytes:
        if name != "modelDescription.xml":
            return content
        content = content.replace(b' unit="m/s2"', b"").replace(b' dependencies=""', b"")
        reference = content.partition(b'name="kinetic_energy" valueReference="')[2].partition(b'"')[0]
        content = content.replace(b'Reference="%s"' % reference, b'Reference="9%s"' % reference)
        return content.replace(f'name="{renamed}"'.encode(), b'name="rate"')

    return change


VERSIONS = {"2": ({}, "[1]"), "3": ({"kind": "native", "fmi": 3}, ""),
            "3, scalars": ({"kind": "native", "fmi": 3, "scalars": True}, "[1]")}  # fmt: skip


@pytest.mark.parametrize("version", ["2", *(pytest.param(v, marks=pytest.mark.thorough) for v in [*VERSIONS][1:])])
def test_missing_variables_units_and_dependencies_are_found(version: str, tmp_path: Path) -> None:
    options, element = VERSIONS[version]
    fmu = rbfmu_fmu.build(rbfmu.Scene.from_dict(SCENE), tmp_path / "it.fmu", **options)
    found = verify(changed(fmu, tmp_path / "changed.fmu", _poorer(f"omega_b{element}")))
    assert f"variable acceleration{element} has no unit" in found.problems
    assert f"position{element} is not among the outputs with dependencies" in found.problems
    assert f"variable omega_b{element} is missing" in found.problems
    assert any(text.startswith("variable kinetic_energy has the value reference 9") for text in found.problems)
    assert not found.passed
    assert version == "2" or verify(fmu).passed


def test_an_fmu_of_another_maker_is_refused(fmu: Path, tmp_path: Path) -> None:
    other = changed(fmu, tmp_path / "other.fmu", lambda name, content: None if "scene.json" in name else content)
    with pytest.raises(VerificationError, match="not an FMU that rbfmu built"):
        verify(other)


def _planned(**entries: object) -> Callable[[str, bytes], bytes]:
    return _told(lambda data: data | {"plan": data["plan"] | entries})


def _replaced(end: str, new: bytes | None) -> Callable[[str, bytes], bytes | None]:
    return lambda name, content: new if name.endswith(end) else content


@pytest.mark.parametrize(("change", "said"), [
    (_replaced("modelDescription.xml", None), "FMPy cannot import it: KeyError"),
    (_replaced("modelDescription.xml", b"<x"), "FMPy cannot import it: XMLSyntaxError"),
    (_replaced("scene.json", b"[]"), "of another version"), (_replaced("scene.json", b"{}"), "of another version"),
    (_planned(new=1), "of another version"), (_planned(model="DOP853"), "another version of rbfmu planned it"),
    (_planned(model=[]), "another version of rbfmu planned it"), (_planned(span=""), "version of rbfmu planned it"),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_what_cannot_be_read_or_run_is_told(
    change: Callable[[str, bytes], bytes | None], said: str, fmu: Path, tmp_path: Path
) -> None:
    with pytest.raises(VerificationError, match=said):
        verify(changed(fmu, tmp_path / "changed.fmu", change))
    gc.collect()  # closes here, and not in another test, the file that FMPy leaves open


def _rooted(start: float, tmp_path: Path) -> Path:
    tables = SCENE | {"inputs": {"ports": [{"name": "u", "size": 1, "start": start}]}}
    scene = rbfmu.Scene.from_dict(tables | {"outputs": {"quantities": ["omega_b"], "root": "sqrt(u)"}})
    return rbfmu_fmu.build(scene, tmp_path / "root.fmu")


@pytest.mark.slow
def test_inputs_of_ones_own_are_about_their_start(tmp_path: Path) -> None:
    assert verify(_rooted(9.0, tmp_path)).passed


@pytest.mark.thorough
def test_inputs_that_an_fmu_refuses_are_told_at_the_start_and_later(tmp_path: Path) -> None:
    fmu = _rooted(1.0, tmp_path)
    with pytest.raises(VerificationError, match=r"refuses to start, perhaps not with another seed: .* finite"):
        verify(fmu, seed=8)
    found = verify(fmu, seed=3)
    assert 0 < found.steps_done < found.steps_asked
    assert set(found.differences.values()) == {0.0}
    assert any("refused" in problem for problem in found.problems)
