"""FMUs built in a process of their own."""

import subprocess
import sys

from tests.support.paths import with_sources

NAMED = {
    "start_time_nan": "start time = nan: expected a finite number",
    "start_time_infinite": "start time = -inf: expected a finite number",
    "mass_negative": "mass = -1.0",
    "mass_zero": "mass = 0.0",
    "inertia_triangle": "inertia[1,1] = 9.0",
    "inertia_negative": "inertia[2,2] = -1.0",
    "inertia_indefinite": "inertia[1,2] = 100.0",
    "inertia_zero": "inertia[1,1] = 0.0",
    "quaternion_zero": "quaternion_0[1] = 0.0",
    "damping_negative": "damping_b[1] = -0.1",
    "parameter_nan": "mass = nan",
    "parameter_infinite": "gravity_a[3] = -inf",
    "input_nan": "torque_b[2] = nan",
    "all_inputs_nan": "force_a[1] = nan",
    "input_infinite": "force_a[1] = inf",
    "parameter_while_stepping": "parameter mass cannot be set while stepping",
    "start_while_stepping": "parameter omega_b_0[1] cannot be set while stepping",
    "input_and_parameter": "parameter mass cannot be set while stepping",
    "output": "output omega_b[1] cannot be set while stepping",
    "output_at_first": "output position[2] cannot be set before initialisation",
    "get_unknown": "value reference 4294967295 is no Real",
    "get_just_above": "status is no Real",
    "get_output_at_first": "outputs have no values before initialisation",
    "set_unknown": "value reference 4294967295 is no Real",
    "get_integer_unknown": "force_a[1] is no Integer",
    "step_zero": "by 0.0 s refused",
    "step_negative": "by -0.01 s refused",
    "step_nan": "by nan s refused",
    "step_infinite": "by inf s refused",
    "step_minus_infinite": "by -inf s refused",
    "time_nan": "from t = nan",
    "step_out_of_reach": "by 1e+300 s refused",
    "step_before_initialisation": "no step can be taken before initialisation",
    "step_in_initialisation": "no step can be taken in initialisation",
    "enter_twice": "initialisation cannot begin while stepping",
    "exit_twice": "initialisation cannot end while stepping",
    "exit_before_enter": "initialisation cannot end before initialisation",
    "state_of_no_bytes": "no state of this FMU",
    "state_too_short": "no state of this FMU",
    "state_too_long": "no state of this FMU",
    "state_with_a_bit_wrong": "no state of this FMU",
}

KILLED = [
    "os.replace = lambda *paths: os.kill(os.getpid(), 9)",
    "import zipfile; zipfile.ZipFile.writestr = lambda *args, **options: os.kill(os.getpid(), 9)",
]
BUILD = """
import hashlib, os, sys
{before}
from pathlib import Path
from tests.support.fmu import fmus
import rbfmu_fmu
path = rbfmu_fmu.build(fmus.scene("{name}"), Path(sys.argv[1]), "{kind}")
print(hashlib.sha256(path.read_bytes()).hexdigest())
"""


def build_elsewhere(path, before="", kind="python", name="prescribed", **environment):
    """Build in a process of its own; its hash, or what it ended with."""
    command = [sys.executable, "-c", BUILD.format(before=before, kind=kind, name=name), str(path)]
    done = subprocess.run(command, env=with_sources(**environment), capture_output=True, text=True, timeout=1200)
    return done.stdout.strip() or done.returncode
