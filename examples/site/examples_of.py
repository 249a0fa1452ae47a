"""An example of each public name, run when the reference is made: what it prints stands on the page.

Functions of arrays are called with `VALUES` of their arguments, which are named by what they mean, so that one table
serves them all. The rest have a few lines each.
"""

import contextlib
import inspect
import io
import os
from pathlib import Path

import numpy as np

import rbfmu

_TURN, _TURN_ON = "[0.8, 0.0, 0.6, 0.0]", "[0.6, 0.8, 0.0, 0.0]"
_MATRIX, _INERTIA = "[[0, -1, 0], [1, 0, 0], [0, 0, 1]]", "[[1, 0, 0], [0, 2, 0], [0, 0, 2.5]]"
_POSE = "[[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]"
_VECTOR, _OTHER = "[1.0, 2.0, 3.0]", "[0.1, 2.0, 0.3]"
VALUES = {
    **dict.fromkeys(("q_ab", "q", "q1", "q_ad"), _TURN),
    **dict.fromkeys(("q_bc", "q_db"), _TURN_ON),
    **dict.fromkeys(("q0", "q_0"), "[1, 0, 0, 0]"),
    **dict.fromkeys(("R_ab", "R"), _MATRIX),
    "R_bc": "[[1, 0, 0], [0, 0, -1], [0, 1, 0]]",
    **dict.fromkeys(("T_ab", "T_bc"), _POSE),
    **dict.fromkeys(("M_c", "M_o", "M_b", "M"), _INERTIA),
    **dict.fromkeys(("omega", "omega_ab_a", "omega_ab_b", "omega_b_0"), _OTHER),
    **dict.fromkeys(("omega_bc_b", "omega_ad_d", "k"), "[0, 0, 1]"),
    **dict.fromkeys(("u", "u_b", "v", "v_b", "v_c", "v_o", "a", "a_c", "a_o", "p_b", "r", "r_op", "r_ab_a"), _VECTOR),
    **dict.fromkeys(("b", "r_oc", "dr", "ddr", "du_b", "g", "sigma"), "[0.1, 0.2, 0.3]"),
    **dict.fromkeys(("force", "torque_c", "torque_o"), "[0, 0, 4]"),
    **dict.fromkeys(("twist_o", "wrench_o"), "[0, 0, 1, 2, 0, 0]"),
    "alpha": "[0.0, 0.5, 0.0]",
    "S": "[[0, -3, 2], [3, 0, -1], [-2, 1, 0]]",
    "dR": "[[-1, 0, 0], [0, -1, 0], [0, 0, 0]]",
    "dq": "[0.0, 0.0, 0.0, 0.5]",
    "moments": _VECTOR,
    "mass": "2.0",
    "masses": "[1.0, 1.0, 2.0]",
    "positions": "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
    **dict.fromkeys(("sides", "semiaxes"), "[0.1, 0.2, 0.4]"),
    **dict.fromkeys(("length", "n"), "2"),
    **dict.fromkeys(("radius", "angle", "theta", "s"), "0.5"),
    "angles": "[0.3, 0.2, 0.1]",
    "seq": '"ZYX"',
    "t": "[0.0, 10.0]",
}
"""What an example writes for an argument of this name."""

_BODY = """body={"mass": 2.0, "inertia": [1.0, 2.0, 2.5]},
    initial={"omega_b": [0.1, 2.0, 0.3]}"""
_SCENE = f"scene = rbfmu.Scene(\n    {_BODY},\n)\n"
_DRIVEN = f'scene = rbfmu.Scene(\n    {_BODY},\n    inputs={{"ports": ["torque_b"]}},\n)\n'
_VARIED = f"""scene = rbfmu.Scene(
    {_BODY},
    ensemble={{"runs": 100, "vary": {{"body.mass": {{"normal": [2.0, 0.1]}}, "initial.omega_b": {{"relative": 0.1}}}}}},
)
"""
_MEASURED = f"""{_SCENE}run = rbfmu.simulate(scene)
noise = 0.01 * np.random.default_rng(1).normal(size=run.omega_b.shape)
measured = {{"time": run.time, "omega_b": run.omega_b + noise}}
"""
LINES = {
    "Body": "body = rbfmu.Body(mass=2.0, inertia=[1.0, 2.0, 2.5])\nprint(body.M_c)",
    "Chart": _SCENE + "made = rbfmu.chart(scene, quick=True)\nprint(made.model, made.accuracy)\nmade.save('charts')",
    "Controller": """from numba import njit


@njit
def damper(t, outputs, state, inputs, noise):
    for i in range(3):
        inputs[i] = -2.0 * (outputs[i] + 0.001 * noise[i])


"""
    + _DRIVEN.replace(
        "},\n)",
        """},
    outputs={"quantities": ["omega_b"]},
    ensemble={"runs": 100, "vary": {"initial.omega_b": {"normal": [[0.1, 2.0, 0.3], 0.1]}}},
)""",
    )
    + """found = rbfmu.run_ensemble(scene, controller=rbfmu.Controller(damper, noise=3), progress=False)
print(abs(found.final["omega_b"]).max() < 0.1)""",
    "EnsembleResult": _VARIED
    + """rbfmu.run_ensemble(scene, "runs.npz", progress=False)
found = rbfmu.EnsembleResult.load("runs.npz")
print(found.final["quaternion"].shape, found.mean["omega_b"][-1])""",
    "Fit": _MEASURED
    + """found = rbfmu.fit(scene, measured, ["initial.omega_b"])
print(found.names, found.values, found.standard_errors)
found.save("fitted.toml")""",
    "Linearization": _DRIVEN + "found = rbfmu.linearize(scene)\nprint(found.states, found.A.shape, found.B.shape)",
    "Plan": _SCENE + "planned = rbfmu.plan(scene)\nprint(planned)",
    "Result": _SCENE
    + "run = rbfmu.simulate(scene)\nrun.save('run.csv')\nprint(rbfmu.Result.load('run.csv').omega_b[-1])",
    "Scene": _SCENE + 'print(scene.replace({"body.mass": 3.0}).body.mass)',
    "SceneError": """try:
    rbfmu.Scene(body={"mass": -1.0, "inertia": [1.0, 2.0, 2.5]})
except rbfmu.SceneError as wrong:
    print(wrong.faults)""",
    "SceneWarning": """import warnings

with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    rbfmu.plan(rbfmu.Scene(body={"mass": 1e-3, "inertia": [1.0, 2.0, 2.5]}))
print(said[0].message)""",
    "Sensitivity": _SCENE
    + """found = rbfmu.sensitivity(scene, ["initial.omega_b"])
print(found.numbers, found.of["attitude"].shape)
found.save("slopes.csv")""",
    "SimulationError": f"""scene = rbfmu.Scene(
    {_BODY},
    constants={{"k": 20.0}}, outputs={{"late": "log(k - t)"}}, inputs={{"parameters": ["k"]}},
)
body = rbfmu.Simulator(scene, k=5.0)
try:
    body.step(6.0)
except rbfmu.SimulationError as wrong:
    print(wrong)""",
    "Simulator": _DRIVEN
    + """body = rbfmu.Simulator(scene)
for _ in range(100):
    body.step(0.01, torque_b=-0.5 * body.omega_b)
print(body.time, body.omega_b)""",
    "attitude_spline": """times = np.linspace(0.0, 10.0, 101)
measured, rates = rbfmu.free_rotation([1.0, 2.0, 3.0], [1, 0, 0, 0], [0.1, 1.0, 0.2], times)
spline = rbfmu.attitude_spline(times, measured)
print(spline(4.567), spline.omega_b(4.567))""",
    "compiled_step": _SCENE
    + """step, z = rbfmu.compiled_step(scene)
print(step(z, 0.1))  # 0: taken""",
    "load_scene": """from pathlib import Path

Path("brick.toml").write_text("[body]\\nmass = 2.0\\ninertia = [1.0, 2.0, 2.5]\\n")
print(rbfmu.load_scene("brick.toml").body.mass)""",
    "progress_bar": _SCENE + 'run = rbfmu.simulate(scene, progress=rbfmu.progress_bar("a brick"))',
    "view": _SCENE + 'rbfmu.view(scene, "motion.html")',
}
"""Of names that are no functions of arrays."""
SAME = {
    "chart": "Chart", "run_ensemble": "EnsembleResult", "fit": "Fit", "linearize": "Linearization", "plan": "Plan",
    "simulate": "Result", "sensitivity": "Sensitivity",
}  # fmt: skip
"""Functions, and the name of what they return, with which they have an example together."""


def code_of(name: str) -> str:
    """Return the lines of a name's example."""
    if (name := SAME.get(name, name)) in LINES:
        return LINES[name]
    given = inspect.signature(getattr(rbfmu, name)).parameters.values()
    values = [VALUES[one.name] for one in given if one.kind is not one.KEYWORD_ONLY]
    return f"print(rbfmu.{name}({', '.join(values)}))"


def printed(code: str, folder: Path) -> str:
    """Return what lines print that are run by themselves in a folder."""
    here = Path.cwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(io.StringIO()) as said, np.printoptions(precision=6, suppress=True):
            exec(compile(code, "example", "exec"), {"rbfmu": rbfmu, "np": np})
    finally:
        os.chdir(here)
    return said.getvalue()
