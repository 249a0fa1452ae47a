"""A ball of 1 kg and 1 kg m2, the slope of whose rate is the torque on it, and of whose velocity the force."""

import rbfmu

BALL = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}


def ball(torque=0, stop=2.0, step=0.5, accuracy=1e-6, shows=("omega_b",), start=0.0, **tables):
    """Return a scene under a torque about its third axis; tables: of the scene, its own outputs among them."""
    outputs = {"quantities": list(shows)} | tables.pop("outputs", {})
    loads = {} if torque == 0 else {"torque_b": f"[0, 0, {torque}]"}
    run = {"start": start, "stop": stop, "step": step, "accuracy": accuracy}
    return rbfmu.Scene.from_dict({"body": BALL, "loads": loads, "outputs": outputs, "run": run} | tables)


def pushed_ball(force, **run_and_tables):
    """Return the same, without weight, under a force along the first axis, of which it shows the velocity."""
    loads = {"gravity_a": [0, 0, 0], "force_a": f"{force}*[1, 0, 0]"}
    return ball(loads=loads, **{"shows": ["velocity"]} | run_and_tables)
