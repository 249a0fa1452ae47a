"""What NOTATION, README and `help` say of functions is so: names, places, order of angles, units, frames, errors."""

import inspect
import pydoc
import re

import numpy as np
import pytest
from numba import config

import rbfmu
import rbfmu_kernels
from rbfmu import arrays
from rbfmu_kernels.rotations import matrix
from rbfmu_kernels.types import Matrix, Matrix6, Quaternion, Transform, Vec3, Vec6, python_function
from tests.support.paths import ROOT

TEXT = (ROOT / "NOTATION.md").read_text(encoding="utf-8")
TABLE = TEXT.partition("## The textbook's formulas and their functions")[2]
FUNCTIONS = sorted({name for row in TABLE.splitlines() if row[:1] == "|" for name in re.findall(r"`([a-z]\w*)", row)})
EPS = 2.0**-52


def test_the_table_has_the_lecture_s_functions():
    """The parser finds them: a few from its beginning, middle and end."""
    assert len(FUNCTIONS) > 50
    assert {"transform", "normalize", "inertia_of_points", "inverse_newton_euler_o", "kinetic_energy"} <= {*FUNCTIONS}


@pytest.mark.parametrize("name", sorted({*FUNCTIONS, *arrays.__all__} - {"set_threads"}))
def test_every_function_is_an_array_function_and_a_kernel(name):
    """Those of NOTATION, and all other array functions."""
    assert name in arrays.__all__
    assert callable(getattr(rbfmu, name))
    assert name in rbfmu_kernels.__all__
    assert config.DISABLE_JIT or hasattr(getattr(rbfmu_kernels, name), "py_func")  # `@njit` code may call it


@pytest.mark.parametrize(
    "document", ["README.md", "NOTATION.md", "kernels/README.md", "rbfmu/README.md", "fmu_build/README.md"]
)
def test_functions_named_as_attributes_exist(document):
    """Such as `rbfmu.rotate` and `rbfmu_kernels.ZYX`."""
    named = re.findall(
        r"\b(rbfmu|rbfmu_kernels|rbfmu_fmu)\.([A-Za-z_]\w*)", (ROOT / document).read_text(encoding="utf-8")
    )
    assert named
    for package, name in named:
        if name not in ("cli", "py", "md", "toml"):
            assert hasattr(__import__(package), name), f"{document}: {package}.{name}"


RPY = np.array([[0.3, -0.5, 1.9], [-2.0, 1.1, 0.4]])


def test_roll_pitch_yaw_is_the_extrinsic_xyz_and_zyx_reversed():
    """R = R_z(psi) R_y(theta) R_x(phi)."""
    phi, theta, psi = RPY.T
    yaw_pitch = rbfmu.compose_matrices(rbfmu.rotation_z(psi), rbfmu.rotation_y(theta))
    R = rbfmu.compose_matrices(yaw_pitch, rbfmu.rotation_x(phi))
    np.testing.assert_allclose(rbfmu.matrix_from_euler("xyz", RPY), R, atol=4 * EPS)
    np.testing.assert_allclose(rbfmu.matrix_from_euler("ZYX", RPY[..., ::-1]), R, atol=4 * EPS)
    np.testing.assert_allclose(rbfmu.euler_from_matrix("xyz", R), RPY, atol=8 * EPS)


def test_roll_pitch_yaw_given_to_zyx_as_it_stands_is_another_rotation():
    """The trap of which NOTATION warns: R_z(phi) R_y(theta) R_x(psi)."""
    phi, theta, psi = RPY[0].tolist()
    other = matrix.compose_matrices(
        matrix.compose_matrices(matrix.rotation_z(phi), matrix.rotation_y(theta)), matrix.rotation_x(psi)
    )
    trapped = rbfmu.matrix_from_euler("ZYX", RPY[0])
    np.testing.assert_allclose(trapped, other, atol=4 * EPS)
    assert np.abs(trapped - rbfmu.matrix_from_euler("xyz", RPY[0])).max() > 0.5


@pytest.mark.parametrize("seq", ["ZYX", "XZY", "xyz", "ZXZ", "yzy"])
def test_the_determinant_of_e_is_that_of_the_middle_angle(seq):
    """Plus or minus its cosine, for proper Euler angles its sine."""
    angles = (0.3, 0.8, -1.9)
    expected = np.sin(0.8) if seq[0] == seq[2] else np.cos(0.8)
    for kernel in (rbfmu_kernels.euler_rate_matrix_a, rbfmu_kernels.euler_rate_matrix_b):
        E = np.array(kernel(getattr(rbfmu_kernels, seq), angles))
        assert abs(np.linalg.det(E)) == pytest.approx(expected, rel=1e-14)


def test_about_a_pivot_euler_s_equation_takes_inertia_and_torque_about_it():
    """As the equations about o, with the force that holds o at rest."""
    mass, M_c, r_oc, omega = 2.0, np.diag([1.0, 2.0, 2.5]), np.array([0.1, -0.2, 0.4]), np.array([0.3, 1.0, -0.5])
    M_o, torque_o = rbfmu.parallel_axis(M_c, mass, r_oc), np.array([0.5, 0.2, -0.7])
    alpha = rbfmu.euler_equation(M_o, omega, torque_o)
    a_c = np.cross(alpha, r_oc) + np.cross(omega, np.cross(omega, r_oc))
    force, torque_c = rbfmu.inverse_newton_euler_c(mass, M_c, omega, a_c, alpha)
    np.testing.assert_allclose(torque_c + np.cross(r_oc, force), torque_o, rtol=1e-13)


def free_body(**initial):
    """A second of its motion."""
    body, outputs = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, {"quantities": ["quaternion", "rpy"]}
    return rbfmu.simulate(rbfmu.Scene(body=body, initial=initial, outputs=outputs, run={"stop": 1.0, "step": 0.5}))


def test_the_output_rpy_is_of_that_order():
    result = free_body(omega_b=[0.3, -0.2, 0.5], attitude={"rotvec": [0.4, 0.2, -1.0]})
    R = rbfmu.matrix_from_quaternion(result.quaternion)
    np.testing.assert_allclose(rbfmu.matrix_from_euler("xyz", result.rpy), R, atol=8 * EPS)


def test_roll_of_the_output_rpy_is_0_at_a_pole_and_yaw_of_the_extrinsic_angles():
    result = free_body(attitude={"euler": "ZYX", "angles_deg": [30.0, 90.0, 10.0]})
    np.testing.assert_allclose(np.degrees(result.rpy[0]), [0.0, 90.0, 20.0], atol=1e-12)
    with pytest.warns(RuntimeWarning, match="third angle"):
        extrinsic = rbfmu.euler_from_quaternion("xyz", result.quaternion[0])
    np.testing.assert_allclose(np.degrees(extrinsic), [-20.0, 90.0, 0.0], atol=1e-12)


# What help says of array functions


DOCUMENTED = sorted({*arrays.__all__} - {"set_threads"})
SHAPE = {
    float: "()", Vec3: "(3)", Quaternion: "(4)", Vec6: "(6)", Matrix: "(3, 3)", Transform: "(4, 4)", Matrix6: "(6, 6)"
}  # fmt: skip
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


@pytest.mark.parametrize("name", DOCUMENTED)
def test_an_array_function_says_all_that_its_user_needs(name):
    text = inspect.getdoc(getattr(arrays, name))
    assert missing(text) == []
    (said,) = re.findall(r"^Shapes: (.*)\.$", text, re.MULTILINE)
    assert said == (NOT_FROM_A_KERNEL.get(name) or shapes_of(getattr(arrays, name).__wrapped__))
    assert max(map(len, text.splitlines())) <= 120


def test_help_of_the_package_shows_every_function():
    text = pydoc.plain(pydoc.render_doc(rbfmu))
    shown = set(re.findall(r"^    (\w+)\(", text, re.MULTILINE))
    assert {*DOCUMENTED, "load_scene", "plan", "simulate"} <= shown


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("name", ["rotate", "skew", "newton_euler_o", "rotvec_rate_a", "check_inertia"])
def test_what_is_left_out_is_found(name, part):
    text = inspect.getdoc(getattr(arrays, name))
    cut = re.sub(PARTS[part], "", text, flags=re.MULTILINE)
    assert missing(cut) == [part]
