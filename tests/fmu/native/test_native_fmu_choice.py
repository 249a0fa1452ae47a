"""A model's step with and without AVX2: which one runs, and that both give the kernels' bits."""

import ctypes
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rbfmu.runs.plan import filled_buffer, initialize
from rbfmu_fmu.description import describe
from rbfmu_fmu.native import platforms
from rbfmu_fmu.native.object_code import object_files
from rbfmu_fmu.native.platforms import PLATFORMS, link, this_platform
from tests.support.compilers import c_compiler
from tests.support.fmu.fmus import planned, scene, signal

pytestmark = pytest.mark.skipif(
    "avx2" not in this_platform().features or not c_compiler() or sys.platform != "linux",
    reason="one kind of code only, no C compiler, or no Linux",
)
ALLOWED = 1 << 27 | 1 << 28, 1 << 5, 0b111
"""ecx of leaf 1, ebx of leaf 7, XCR0."""
CPU = Path("/proc/cpuinfo").read_text().split() if Path("/proc/cpuinfo").exists() else []


def loaded(layer, objects, folder, monkeypatch, choice=None):
    """The library of a C layer, of which tests may say what it uses."""
    said = "" if choice is None else f"#define USES_AVX2 {choice}\n"
    with monkeypatch.context() as patch:
        own = platforms.source
        patch.setattr(platforms, "source", lambda name: layer if name == "layer.c" else own(name))
        content = link(["layer.c"], objects, this_platform(), "model", {"model.h": said + own("model.h").decode()})
    path = folder / f"model {len(list(folder.iterdir()))}.so"
    path.write_bytes(content)
    return ctypes.CDLL(str(path))


LAYER = b"""#include "model.h"
#define EXPORTED __attribute__((visibility("default")))
EXPORTED int allows(unsigned a, unsigned b, unsigned c) { return avx2_in(a, b, c); }
EXPORTED int has(void) { return has_avx2(); }
EXPORTED int64_t chosen(void) { return chosen_step()(0, 0.0); }
int64_t step(double *z, double h) { (void)z, (void)h; return 10; }
int64_t step_avx2(double *z, double h) { (void)z, (void)h; return 20; }
"""


@pytest.fixture
def chooser(tmp_path, monkeypatch):
    return lambda choice=None: loaded(LAYER, {}, tmp_path, monkeypatch, choice)


def test_avx2_needs_the_processors_word_and_the_systems(chooser):
    allows = chooser().allows
    assert allows(*ALLOWED)
    assert allows(*[2**32 - 1] * 3)
    for word, bit in ((0, 27), (0, 28), (1, 5), (2, 1), (2, 2)):
        words = [2**32 - 1] * 3
        words[word] ^= 1 << bit
        assert not allows(*words), (word, bit)


def test_the_choice_is_what_linux_says_of_the_processor(chooser):
    expected = "avx2" in CPU
    assert bool(chooser().has()) == expected
    assert chooser().chosen() == (20 if expected else 10)
    assert [chooser(choice).chosen() for choice in (0, 1)] == [10, 20]


CASES = {
    "closed form": "brick", "exact rotation": "prescribed", "Taylor series": "driven", "pendulum": "pendulum",
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("choice", [0, 1])
def test_either_step_gives_the_kernels_bits(choice, case, tmp_path, monkeypatch):
    name = CASES[case]
    plan = planned(name)
    layer = platforms.source("exports.c")
    library = loaded(layer, object_files(plan.kernels, this_platform()), tmp_path, monkeypatch, choice)
    if choice and "avx2" not in CPU:
        pytest.skip("no AVX2 here")
    library.model_chosen_step.restype = ctypes.c_void_p
    of_buffer = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_double)
    step = of_buffer(library.model_chosen_step())
    z = filled_buffer(scene(name), plan)
    initialize(scene(name), plan.kernels, z)
    own, places = z.copy(), {v.name: v.offset for v in describe(scene(name), plan).variables}
    for inputs in signal(name, 500):
        for variable, value in inputs.items():
            z[places[variable]] = own[places[variable]] = value
        assert step(z.ctypes.data, 0.01) == plan.kernels.step(own, 0.01) == 0
        assert z.tobytes() == own.tobytes()


def instructions(code, folder):
    """Their names and operands."""
    (folder / "model.o").write_bytes(code)
    command = [shutil.which("objdump") or pytest.skip("no objdump"), "-d", "--no-show-raw-insn", folder / "model.o"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("platform", ["linux64", "win64"])
@pytest.mark.parametrize("case", ["exact rotation", "Taylor series"])
def test_neither_step_has_fused_products_and_one_has_vectors_of_four(case, platform, tmp_path):
    objects = object_files(planned(CASES[case]).kernels, PLATFORMS[platform])
    assert set(objects) == {"model.o", "step_avx2.o"}
    texts = {file: instructions(code, tmp_path) for file, code in objects.items()}
    assert not re.search(r"\bvfn?m(add|sub)", "".join(texts.values()))
    assert "gather" not in texts["step_avx2.o"]  # slow on some processors
    assert "%ymm" in texts["step_avx2.o"]
    assert not re.search(r"%ymm|\sv[a-z]+[ps]d\b", texts["model.o"])
