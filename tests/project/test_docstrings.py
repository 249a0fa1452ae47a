"""What `help` says of every array function: shapes, units, frames, error, singularities and source."""

import inspect
import pydoc
import re

import pytest

import rbfmu
from rbfmu import arrays
from rbfmu_kernels.compile.shapes import python_function
from rbfmu_kernels.types import Matrix, Quaternion, Vec3

FUNCTIONS = sorted({*arrays.__all__} - {"set_threads"})
SHAPE = {float: "()", Vec3: "(3)", Quaternion: "(4)", Matrix: "(3, 3)"}
NOT_FROM_A_KERNEL = {
    "check_inertia": "M (3, 3), with any leading axes",
    "inertia_of_points": "masses (n), positions (n, 3) -> (), (3), (3, 3); leading axes broadcast",
}
PARTS = {
    "a summary": r"\A(Return|Raise) [^\n]*\.\n\n",
    "shapes": r"^Shapes: \S",
    "units": r"^Units: [^.]*\b(rad|kg|m|N|J|s|any|dimensionless)\b",
    "frames": r"(^|  )Frames: \S",
    "an error": r"^(Error <= [\d.]+ eps|Error: \S|Error (in|as) \S|Exact (for every|where) )",
    "singularities": r"(^|  )Singular: \S",
    "a source": r"(^|  )Source: \S",
}


def missing(text):
    return [part for part, pattern in PARTS.items() if not re.search(pattern, text, re.MULTILINE)]


def shapes_of(kernel):
    """From the annotations themselves, not by what made the docstring."""
    signature = inspect.signature(python_function(kernel))
    arguments = [f"{n} {SHAPE[p.annotation]}" for n, p in signature.parameters.items() if p.annotation is not int]
    result = signature.return_annotation
    results = [SHAPE[result]] if result in SHAPE else [SHAPE[part] for part in result.__args__]
    return f"{', '.join(arguments)} -> {', '.join(results)}; leading axes broadcast"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_an_array_function_says_all_that_its_user_needs(name):
    text = inspect.getdoc(getattr(arrays, name))
    assert missing(text) == []
    (said,) = re.findall(r"^Shapes: (.*)\.$", text, re.MULTILINE)
    assert said == (NOT_FROM_A_KERNEL.get(name) or shapes_of(getattr(arrays, name).__wrapped__))
    assert max(map(len, text.splitlines())) <= 120


def test_help_of_the_package_shows_every_function():
    text = pydoc.plain(pydoc.render_doc(rbfmu))
    shown = set(re.findall(r"^    (\w+)\(", text, re.MULTILINE))
    assert {*FUNCTIONS, "load_scene", "plan", "simulate"} <= shown


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("name", ["rotate", "skew", "newton_euler_o", "rotvec_rate_a", "check_inertia"])
def test_what_is_left_out_is_found(name, part):
    text = inspect.getdoc(getattr(arrays, name))
    cut = re.sub(PARTS[part], "", text, flags=re.MULTILINE)
    assert missing(cut) == [part]
