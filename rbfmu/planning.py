"""From a scene to a plan: the smallest model that serves it, and why."""

from rbfmu.fitting import cheapest_fit
from rbfmu.models import Plan
from rbfmu.scene import Scene, SceneError

EXACT = 1e-14
"""The accuracy that the exact models keep."""


def plan(scene: Scene) -> Plan:
    """Choose model, method and step. Raises SceneError where the accuracy asked cannot be met."""
    if "omega_b" in scene.inputs.ports:
        reason = "port omega_b prescribes the body's rates: attitude only, exact for rates held over a step"
        return Plan("prescribed rates", "exact rotation", 4, reasons=(reason,))
    assert scene.body is not None
    states = 7 if scene.body.pivot else 13
    if _is_torque_free(scene):
        _check_exact(scene)
        reason = f"no load makes a torque: rotation exact at any time, position in closed form; error below {EXACT:g}"
        return Plan("torque-free body", "elliptic functions", states, reasons=(reason,))
    return cheapest_fit(scene, Plan("body under loads", "DOP853", states, tolerance=scene.run.accuracy))


def _is_torque_free(scene: Scene) -> bool:
    """Whether nothing known, supplied or listed as a parameter makes a torque (or turns a force with the body)."""
    body, inputs = scene.body, scene.inputs
    assert body is not None
    acting = _acting(scene)
    arm = any(body.r_oc_b) or "r_oc_b" in inputs.parameters
    if acting & {"torque_a", "torque_b", "damping_b"}:
        return False
    if body.pivot:
        return not (arm and "gravity_a" in acting)
    return "force_b" not in acting and not (arm and "force_a" in acting)


def _acting(scene: Scene) -> set[str]:
    """Names of the loads that are known and not zero, supplied through a port, or an importer's to change."""
    known = {n for n in type(scene.loads).model_fields if any(getattr(scene.loads, n))}
    return known | set(scene.inputs.ports) | set(scene.inputs.parameters)


def _check_exact(scene: Scene) -> None:
    if scene.run.accuracy < EXACT:
        expected = f"at least {EXACT:g}, what double precision keeps"
        raise SceneError(f"run.accuracy = {scene.run.accuracy!r}: expected {expected}", scene.name)
