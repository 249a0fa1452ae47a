"""Laws 10 to 14: unstable motions, a resonance that splitting causes, and the library's models on known motions."""

import math
from typing import NamedTuple

import numpy as np

from rbfmu.runs.inputs import undriven
from rbfmu.runs.plan import Plan, start_run
from rbfmu.runs.steps import Steps, substeps_counted
from rbfmu.scene.scene import SceneError
from rbfmu.simulation import simulate
from rbfmu.studies import dop853, reference_methods, tables_of
from rbfmu.studies.stability import LAWS, Columns, Finding, Study, exponent, finding, method_laws, motions
from rbfmu.studies.stability.motions import BRICK, FLIPPING, HEAVY_TOP, UPRIGHT, scene_of
from rbfmu.types import Array, Motion
from rbfmu_kernels.integrators.splitting import resonant_step
from rbfmu_kernels.types import Vec3

# Laws 10 to 12: motions that are unstable, and a resonance


def flip_rate(moments: Vec3, omega_2: float) -> float:
    """Return omega_2 sqrt((I2 - I1) (I3 - I2) / (I1 I3)), the growth rate of a disturbed spin about the middle axis."""
    i_1, i_2, i_3 = moments
    return omega_2 * math.sqrt((i_2 - i_1) * (i_3 - i_2) / (i_1 * i_3))


def time_between_flips(moments: Vec3, omega: Vec3) -> float:
    """Return ln(16 / mc) / lambda, half a period of omega_2 for a small complementary parameter mc of sn, cn, dn."""
    i_1, i_2, i_3 = moments
    w_1, w_2, w_3 = omega
    excess = i_3 * (i_3 - i_2) * w_3 * w_3 - i_1 * (i_2 - i_1) * w_1 * w_1
    i_s, w_s, i_p = (i_3, w_3, i_1) if excess > 0.0 else (i_1, w_1, i_3)
    amplitude = (i_s * w_s) ** 2 + i_2 * w_2 * w_2 * i_s * (i_2 - i_p) / (i_s - i_p)
    mc = abs(excess) * i_s / (abs(i_s - i_2) * amplitude)
    return math.log(16.0 / mc) / flip_rate(moments, w_2)


def _measured_time(time: Array, omega_2: Array) -> float:
    """Return the time between the first two sign changes of omega_2, by linear interpolation."""
    k = np.flatnonzero(np.signbit(omega_2[1:]) != np.signbit(omega_2[:-1]))[:2]
    first, second = time[k] - omega_2[k] * (time[k + 1] - time[k]) / (omega_2[k + 1] - omega_2[k])
    return float(second - first)


def _flips_about_a_pivot() -> tuple[float, float]:
    """Return the measured and predicted time between flips of a weightless brick on a pivot 0.5 m from its centre."""
    hung = {"body.r_oc_b": (0.0, 0.0, 0.5), "body.pivot": True}
    result = simulate(scene_of(FLIPPING.start, ["omega_b"], 40.0, 1e-3, hung))
    predicted = time_between_flips((1.25, 2.25, 3.0), FLIPPING.start.omega_b)
    return _measured_time(result.time, result.omega_b[:, 1]), predicted


def intermediate_axis(quick: bool) -> Study:
    """Measure law 10: a spin about the middle axis flips repeatedly, at predicted intervals."""
    time, start = np.arange(0.0, 30.0 if quick else 62.0, 0.25), FLIPPING.start
    columns: Columns = {"time": time.tolist(), "exact": motions.free_rates(start.omega_b, time)[:, 1].tolist()}
    for method, h in ((method_laws.RK4, 0.25), (method_laws.SEMI, 0.05)):
        states = method.path(start, h, [round(0.25 / h)] * (len(time) - 1), FLIPPING.body)
        columns[f"{method.name}, h = {h:g} s"] = [y.omega_b[1] for y in (start, *states)]
    tiny = motions.free_rates((1e-8, 2.0, 1e-8), np.array([5.0, 8.0]))[:, 0]
    fine = np.linspace(0.0, 32.0, 32_001)
    measured = _measured_time(fine, motions.free_rates(start.omega_b, fine)[:, 1])
    findings = [
        finding("growth of a disturbance", exponent(tiny[1], tiny[0], math.e) / 3.0, flip_rate(BRICK, 2.0)),
        finding("time between flips", measured, time_between_flips(BRICK, start.omega_b)),
        finding("that time", measured),
    ]
    if not quick:
        findings.append(finding("flips about a pivot", *_flips_about_a_pivot()))
    return Study("intermediate_axis", findings, columns)


_I_1, _, _I_3 = HEAVY_TOP.moments
_CRITICAL = 2.0 * math.sqrt(_I_1) / _I_3
"""The critical spin in rad/s, from (I3 w3)^2 = 4 I1 m g l."""


def _tilts(tilt: float, rate: float, stop: float) -> Array:
    """Return the tilt of the top in rad every 0.1 s; rate: its spin, rad/s."""
    changes = {
        "initial.attitude": {"rotvec": [tilt, 0.0, 0.0]}, "initial.omega_b": [0.0, 0.0, rate],
        "outputs.quantities": ["quaternion"], "run.stop": 0.1 * round(10.0 * stop), "run.step": 0.1,
    }  # fmt: skip
    planned = Plan("symmetric top", "", 7, substep=0.02, order=4)
    q = simulate(HEAVY_TOP.scene.replace(changes), planned=planned).quaternion[1:]
    return np.asarray(2.0 * np.arctan2(np.hypot(q[:, 1], q[:, 2]), np.hypot(q[:, 0], q[:, 3])))


def largest_tilt(ratio: float, stop: float = 60.0) -> float:
    """Return the largest tilt in rad of a top that leans by 0.001 rad, with `ratio` times the critical spin."""
    return float(np.max(_tilts(1e-3, ratio * _CRITICAL, stop)))


def tilt_growth(ratio: float) -> float:
    """Return the growth rate of the tilt, 1/s: sqrt(m g l / I1 - (I3 w3 / (2 I1))^2) for w3 below the critical spin."""
    return math.sqrt((1.0 - ratio * ratio) / _I_1)


def _measured_growth(ratio: float) -> float:
    """Return the growth rate of the tilt between t = 4 / sigma and 8 / sigma, from an initial tilt of 1e-7 rad."""
    tilts = _tilts(1e-7, ratio * _CRITICAL, 8.0 / tilt_growth(ratio))
    half = len(tilts) // 2
    return exponent(tilts[-1], tilts[half - 1], math.e) / (0.1 * (len(tilts) - half))


def sleeping_top(quick: bool) -> Study:
    """Measure law 11: an upright top is stable if it spins faster than the critical spin."""
    ratios = [0.3, 0.6, 0.9, 1.1, 1.5] if quick else np.linspace(0.05, 1.6, 63).tolist()
    columns: Columns = {
        "spin over critical": ratios,
        "largest tilt": [largest_tilt(r, 30.0 if quick else 60.0) for r in ratios],
        "predicted": [1e-3 / math.sqrt(1.0 - 1.0 / (r * r)) if r > 1.0 else math.nan for r in ratios],
    }
    growths = {ratio: _measured_growth(ratio) for ratio in (0.2, 0.5, 0.8)}
    slope, offset = np.polyfit([r * r for r in growths], [g * g for g in growths.values()], 1)
    findings = [
        *(finding("growth of the tilt", g, tilt_growth(r), r=r) for r, g in growths.items()),
        finding("end of the growth", math.sqrt(-float(offset) / float(slope))),
        *(finding("largest tilt", largest_tilt(r) / 1e-3, 1.0 / math.sqrt(1.0 - r**-2), r=r) for r in (1.1, 1.5)),
    ]
    return Study("sleeping_top", findings, columns)


def _energy_error(method: str, h: float) -> float:
    """Return the largest energy error of the fast heavy top over 10 s, relative to m g l."""
    top = HEAVY_TOP
    path = reference_methods.SPLITTINGS[method].path(top.start, h, [1] * round(10.0 / h), top.body, top.loads)
    q, omega = (np.array([getattr(y, part) for y in (top.start, *path)]) for part in ("q_ab", "omega_b"))
    energy = top.conserved({"quaternion": q, "omega_b": omega})["energy"]
    return float(np.max(np.abs(energy - energy[0])))


def _peak(method: str, low: float, high: float) -> float:
    """Return the step at which that error is largest, by golden-section search; it has one peak in the interval."""
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(40):
        a, b = high - golden * (high - low), low + golden * (high - low)
        low, high = (a, high) if _energy_error(method, a) < _energy_error(method, b) else (low, b)
    return 0.5 * (low + high)


def _largest_substep() -> float:
    """Return the substep in s beyond which the library's model of a symmetric top refuses the fast top."""

    def is_taken(h: float) -> bool:
        scene = HEAVY_TOP.scene.replace({"run.stop": 0.1, "run.step": 0.1, "initial.attitude": {"quaternion": UPRIGHT}})
        try:
            simulate(scene, planned=Plan("symmetric top", "", 7, substep=h, order=2))
        except SceneError:
            return False
        return True

    return method_laws.crossing(is_taken, 0.1, 0.4)


def splitting_resonance(quick: bool) -> Study:
    """Measure law 12: with splitting steps in resonance with the free precession, the energy grows."""
    resonance = resonant_step(HEAVY_TOP.body.inertia, HEAVY_TOP.start.omega_b)
    steps = np.sort([*np.geomspace(0.03, 0.6, 13 if quick else 121), resonance]).tolist()  # the peak is narrow
    columns = {"h": steps} | {name: [_energy_error(name, h) for h in steps] for name in reference_methods.SPLITTINGS}
    orders, recorded = LAWS[12]["orders"], LAWS[12]["recorded"]

    def power(name: str, h: float) -> float:
        return exponent(_energy_error(name, h), _energy_error(name, 0.5 * h))

    findings = [
        finding("resonant step", resonance, 2.0 * math.pi / (0.3 * 50.0)),
        finding("peak", _peak("Strang", 0.40, 0.44) / resonance),
        finding("largest substep", _largest_substep() / resonance),
        *(finding("order below", power(name, h), order, name=name) for name, order, h in orders),
        *(finding("energy error", _energy_error(name, h), error, name=name, h=h) for name, h, error in recorded),
    ]
    return Study("splitting_resonance", findings, columns)


# Laws 13 and 14: the library's models against 40-digit references, their orders, and their error control


LOADED, SERIES = "body under loads", "body under loads, by series"
"""The models by DOP853, and by series, which plans use."""


class Case(NamedTuple):
    """A model with its settings, the motion on which it is tested, and the bound of its error."""

    model: str
    motion: str
    name: str = ""
    bound: float = 0.0
    substep: float = math.inf
    tolerance: float = 0.0
    order: int = 0

    @property
    def planned(self) -> Plan:
        """Return the plan with this model and these settings."""
        kind = dop853.Dop853Plan if self.model == LOADED else Plan
        return kind(self.model, "", 0, self.substep, self.tolerance, self.order)


_TABLES = tables_of("stability/models.toml")
CASES = [Case(motion=one, **{"name": row["model"]} | row) for row in _TABLES["models"] for one in row.pop("motions")]
_ORDERS = [(row.pop("power"), row.pop("step"), Case(**row)) for row in _TABLES["orders"]]
_CONTROLLED = [(row.pop("root"), row.pop("ratio"), Case(**row)) for row in _TABLES["controlled"]]


def product_models(quick: bool) -> Study:
    """Measure law 13: the error of each model stays within its bound; `quick` changes nothing here."""
    rows = [(case.name, case.motion, case.bound, motions.error_of_model(case.motion, case.planned)) for case in CASES]
    rows.append(("prescribed rates", "held, then changing", 1e-14, motions.prescribed_error()))
    findings = [finding("error of a model", error, most, place=at, name=name) for name, at, most, error in rows]
    findings.append(finding("apart", _apart()))
    columns = dict(zip(("model", "motion", "bound", "error"), map(list, zip(*rows, strict=True)), strict=True))
    return Study("product_models", findings, columns)


def _drive(case: Case) -> Motion:
    """Return the state of the loaded body after five steps under changing loads; empty if a step is refused."""
    changing, kernels = _TABLES["changing"], case.planned.kernels
    z = start_run(motions.MOTIONS["loaded"].replace({"inputs.ports": list(changing)}), case.planned)
    for _ in range(5):
        for name, value in changing.items():
            for block, part in ((name, 1.0), (f"{name}_rate", 1.0), (f"{name}_rate_2", 0.5)):
                z[kernels.BLOCKS[block]] = part * np.array(value)
        if kernels.step(z, 1.0):
            return {}
    return {name: z[kernels.BLOCKS[name]].copy()[None, :] for name in motions.STATE}


def _apart() -> float:
    one, other = (_drive(Case(model, "", tolerance=1e-14, order=n)) for model, n in ((SERIES, 16), (LOADED, 0)))
    return motions.error_of(one, other) if one and other else math.inf


def _error_at(case: Case, step: float) -> float:
    """Return the error with substeps of `step` s; for series, which choose substeps, with such communication steps."""
    if case.model != SERIES:
        return motions.error_of_model(case.motion, case._replace(substep=step).planned)
    parts = round(motions.MOTIONS[case.motion].run.step / step)
    return motions.error_of_model(case.motion, case._replace(tolerance=math.inf).planned, parts)


def _substeps(case: Case) -> float:
    """Return the number of substeps; NaN if a step is refused."""
    scene = motions.MOTIONS[case.motion]
    run = Steps(scene, case.planned, undriven([scene.run.step] * motions.POINTS), ())
    done = all(run.advance(k + 1) for k in range(motions.POINTS))
    return substeps_counted(run.kernels, run.z) if done else math.nan


def orders_and_error_control(quick: bool) -> Study:
    """Measure law 14: the order determines how errors fall with the step, and how substeps grow with the accuracy."""
    findings: list[Finding] = []
    halvings = range(4)
    columns: Columns = {"halvings of the step": list(halvings)}
    for power, h, case in _ORDERS:
        errors = columns[case.name] = [_error_at(case, h * 0.5**k) for k in halvings]
        findings.append(finding("order", exponent(errors[0], errors[1]), power, name=case.name))
    for root, ratio, case in _CONTROLLED:
        few, many = (_substeps(case._replace(tolerance=t)) for t in (1e-10, 1e-14))
        error = motions.error_of_model(case.motion, case._replace(tolerance=1e-10).planned)
        findings.append(finding("substeps", exponent(many, few, 1e4), 1.0 / root, name=case.name))
        findings.append(finding("error over tolerance", error / 1e-10, ratio, name=case.name))
    return Study("orders_and_error_control", findings, columns)
