"""The motions on which methods compete, their references to 40 digits, and what each motion conserves."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu import arrays
from rbfmu.runs.motion import relative_error
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene
from rbfmu_kernels.body.memory import body_of, loads_of, motion_of
from rbfmu_kernels.integrators.splitting import is_symmetric_top
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State

Array = NDArray[np.float64]

CHECKPOINTS = 5
"""The number of points at which errors are measured, and of the outputs of a run with few outputs."""
RATES, PATH, ROTATION, ALL = 3, 6, 7, 13
"""How many numbers solvers integrate: omega_b; r_c and v_c; q_ab and omega_b; q_ab, omega_b, r_c and v_c."""
OUTPUT_STEP = 0.01
"""The time in s between the outputs of a run with many outputs."""
REFERENCES = Path(__file__).with_name("reference_motions.json")
"""The file is written by examples/references/reference_motions.py."""
_GENERAL = Plan("body under loads, by series", "", 13, order=12)
_NOTHING = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Case:
    """A scene on which methods are compared at checkpoints.

    title: the name that a user would give the motion; keeps: what it conserves out of "energy", "momentum" (its
    inertial components) and "vertical momentum"; torque_free: whether no load makes a torque; outputs: the number of
    equally spaced states that a method returns over the run; points: the largest number of checkpoints among them.
    """

    key: str
    title: str
    scene: Scene
    keeps: tuple[str, ...] = ()
    torque_free: bool = False
    outputs: int = CHECKPOINTS
    points: int = CHECKPOINTS

    @property
    def span(self) -> float:
        """Return the simulated time, s."""
        return self.scene.run.stop

    @property
    def interval(self) -> float:
        """Return the time between outputs, s."""
        return self.span / self.outputs

    @property
    def checkpoints(self) -> slice:
        """Return the checkpoints among the outputs, equally spaced up to the last."""
        every = math.ceil(self.outputs / self.points)
        return slice((self.outputs - 1) % every, None, every)

    @property
    def numbers(self) -> int:
        """Return how many numbers solvers integrate: `RATES`, `PATH`, `ROTATION` or `ALL`."""
        return ALL if self.turning_force else ROTATION

    @property
    def outputs_between(self) -> list[int]:
        """Return the number of outputs up to each checkpoint from the one before."""
        at = [0, *(i + 1 for i in range(self.outputs)[self.checkpoints])]
        return [b - a for a, b in pairwise(at)]

    @property
    def quantities(self) -> tuple[str, ...]:
        """Return the quantities that all methods compute; the position only where it has no closed form."""
        return ("quaternion", "omega_b", "position") if self.turning_force else ("quaternion", "omega_b")

    def with_many_outputs(self) -> "Case":
        """Return the same motion with an output every `OUTPUT_STEP`."""
        return replace(self, outputs=round(self.span / OUTPUT_STEP))

    def states_of(self, rows: Array) -> Sequence[State] | Mapping[str, Array]:
        """Return the states at the checkpoints from a model's rows of `quantities` at the outputs."""
        return [self._state(row) for row in rows[self.checkpoints]]

    def _state(self, row: Array) -> State:
        """Return the state of a row (q, omega, perhaps the position of o); without it the centre of mass stays."""
        q, omega, body = row[:4], row[4:7], self.scene.body
        assert body is not None
        r = row[7:] + arrays.rotate(q, np.array(body.r_oc_b)) if len(row) > 7 else self.start.r_c
        return state_of(r, self.start.v_c, q, omega)

    def asking(self, accuracy: float) -> Scene:
        """Return the scene with this accuracy, and with the quantities and output times of all methods."""
        tables = self.scene.to_dict()
        tables["run"] |= {"accuracy": accuracy, "step": self.interval}
        tables["outputs"]["quantities"] = list(self.quantities)
        return Scene.from_dict(tables, self.key)

    @cached_property
    def buffer(self) -> Array:
        """Return the buffer of a body under loads at the start, which holds body and loads."""
        z = filled_buffer(self.scene, _GENERAL)
        initialize(self.scene, _GENERAL.kernels, z)
        return z

    @cached_property
    def body(self) -> Body:
        """Return the constants of the equations of motion."""
        return body_of(self.buffer)

    @cached_property
    def loads(self) -> Loads:
        """Return the loads of the equations of motion."""
        return loads_of(self.buffer)

    @cached_property
    def start(self) -> State:
        """Return position and velocity of the centre of mass, q_ab, omega_b."""
        return motion_of(self.buffer)

    @property
    def moments(self) -> tuple[float, float, float]:
        """Return the principal moments about the reference point: all cases are in principal axes."""
        M = self.body.inertia
        return M[0][0], M[1][1], M[2][2]

    @property
    def top(self) -> bool:
        """Return whether splitting with the symmetric free rotation applies."""
        return not self.torque_free and bool(is_symmetric_top(self.body.inertia)) and self.body.damping_b == _NOTHING

    @property
    def long(self) -> bool:
        """Return whether a run in steps takes minutes, so that few methods and settings are tried."""
        return self.span > 1e5

    @property
    def turning_force(self) -> bool:
        """Return whether a force turns with a free body, so that its path has no closed form."""
        return any(self.loads.force_b)

    @cached_property
    def rate(self) -> float:
        """Return the largest |omega| at start and checkpoints, rad/s."""
        return float(max(np.linalg.norm(self.start.omega_b), *np.linalg.norm(reference(self.key)["omega_b"], axis=1)))

    def judged(self, errors: Mapping[str, float]) -> float:
        """Return the error by which methods are compared, of those from `errors`: that of the attitude, rad."""
        return errors["attitude"]

    def errors(self, states: Any) -> dict[str, float]:
        """Return the largest errors at the checkpoints, and the drifts of what is conserved (NaN for the rest)."""
        r, _, q, omega = (np.array(part, dtype=float) for part in zip(*states, strict=True))
        truth = reference(self.key)
        with np.errstate(over="ignore"):
            sizes = np.linalg.norm(q, axis=1, keepdims=True)
        if not (np.all(np.abs(r) < 1e50) and np.all(np.abs(omega) < 1e50) and np.all((sizes > 0.0) & (sizes < np.inf))):
            return {"attitude": math.inf} | dict.fromkeys(("position", *DRIFTS), math.nan)
        found = {
            "attitude": _attitude_error(q / sizes, truth),
            "position": float(np.max(relative_error(r, truth["r_c"], 1.0))),
        }
        now = self._kept(r, q / sizes, omega)
        before = self._kept(*(np.array([x]) for x in (self.start.r_c, self.start.q_ab, self.start.omega_b)))
        scale = {"energy": abs(before["energy"][0]), "momentum": np.linalg.norm(before["momentum"])}
        for name in DRIFTS:
            change = np.abs(now[name] - before[name]).reshape(CHECKPOINTS, -1)
            size = scale["energy" if name == "energy" else "momentum"]
            found[name] = float(np.max(np.linalg.norm(change, axis=1)) / size) if name in self.keeps else math.nan
        return found

    def _kept(self, r: Array, q: Array, omega: Array) -> dict[str, Array]:
        """Return the energy (with that of the weight about a pivot) and the angular momentum of (n, ...) states."""
        h_a = arrays.rotate(q, arrays.angular_momentum(np.array(self.body.inertia), omega))
        energy = 0.5 * np.sum(omega * arrays.angular_momentum(np.array(self.body.inertia), omega), axis=-1)
        if self.body.is_free == 0.0:
            energy = energy - arrays.rotate(q, np.array(self.body.arm_b)) @ np.array(self.loads.force_a)
        return {"energy": energy, "momentum": h_a, "vertical momentum": h_a[:, 2]}


def state_of(r: Any, v: Any, q: Any, omega: Any) -> State:
    """Return a state made from any sequences of numbers."""
    return State(*(tuple(map(float, x)) for x in (r, v, q, omega)))  # type: ignore[arg-type]


DRIFTS = ("energy", "momentum", "vertical momentum")


def _attitude_error(q: Array, truth: dict[str, Array]) -> float:
    """Return the largest angle in rad to references in two parts, so that their own rounding adds no error."""
    high, low = truth["q"], truth["q_low"]
    sign = np.where(np.sum(q * high, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    apart = np.linalg.norm((sign * q - high) - low, axis=1)
    return float(np.max(4.0 * np.arctan2(apart, np.linalg.norm(sign * q + high, axis=1))))


@cache
def _references() -> dict[str, Any]:
    return json.loads(REFERENCES.read_text())["motions"]  # type: ignore[no-any-return]


@cache
def reference(key: str) -> dict[str, Array]:
    """Return the true motion at the checkpoints: q and its low part (5, 4), omega_b and r_c (5, 3)."""
    motion = _references()[key]
    high = np.array(motion["quaternion"], dtype=float)
    low = np.array([[_low(x) for x in row] for row in motion["quaternion"]])
    return {"q": high, "q_low": low} | {k: np.array(motion[k], dtype=float) for k in ("omega_b", "r_c")}


def _low(digits: str) -> float:
    """Return the difference between a decimal number and its nearest double."""
    from fractions import Fraction

    return float(Fraction(digits) - Fraction(float(digits)))


def _scene(name: str, stop: float, body: dict[str, Any], omega_b: Sequence[float], **more: Any) -> Scene:
    initial = {"omega_b": list(omega_b)} | more.pop("initial", {})
    tables = {
        "name": name,
        "body": {"mass": 1.0} | body,
        "initial": initial,
        "loads": {"gravity_a": [0.0, 0.0, 0.0]} | more,
        "run": {"stop": stop, "step": stop / CHECKPOINTS},
    }
    return Scene.from_dict(tables, name)


BRICK = {"inertia": [1.0, 2.0, 3.0]}
_LEANING = {"attitude": {"quaternion": [math.cos(0.3), math.sin(0.3), 0.0, 0.0]}}


def _top(name: str, middle: float) -> Scene:
    """Return a heavy top, m g r = 1 N m, moments (1, middle, 0.3) about the pivot, numbers exact in binary."""
    arm = 0.125
    body = {"inertia": [1.0 - arm * arm, middle - arm * arm, 0.3], "r_oc_b": [0.0, 0.0, arm], "pivot": True}
    return _scene(name, 10.0, body, (0.0, 0.0, 50.0), initial=_LEANING, gravity_a=[0.0, 0.0, -8.0])


def _free(name: str, stop: float) -> Scene:
    return _scene(name, stop, BRICK, (0.3, 1.0, 0.2), initial={"attitude": {"quaternion": [0.5, 0.5, 0.5, 0.5]}})


_KEPT = ("energy", "momentum")
CASES = {
    case.key: case
    for case in (
        Case("a", "free body", _free("free_body", 100.0), _KEPT, True),
        Case("b", "free body, flipping", _scene("flipping", 60.0, BRICK, (1e-4, 2.0, 1e-4)), _KEPT, True),
        Case("g", "free body, 1e6 turns", _free("million_turns", 6e6), _KEPT, True),
        Case("c", "heavy top", _top("heavy_top", 1.0), ("energy", "vertical momentum")),
        Case("c'", "heavy top, three moments", _top("three_moments", 1.25), ("energy", "vertical momentum")),
        Case(
            "d",
            "constant body torque",
            _scene("body_torque", 20.0, BRICK, (0.1, 0.2, 0.3), torque_b=[0.1, 0.05, -0.2]),
        ),
        Case("e", "damped spin", _scene("damped_spin", 10.0, BRICK, (0.0, 0.0, 10.0), damping_b=[0.5, 0.5, 0.5])),
        Case(
            "f",
            "thruster off the centre",
            _scene(
                "thruster",
                20.0,
                {"mass": 2.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.1, -0.2, 0.05]},
                (0.3, -0.5, 0.8),
                initial={"velocity": [1.0, 0.0, 0.0]},
                gravity_a=[0.0, 0.0, -9.81],
                force_b=[1.0, 0.5, -2.0],
            ),
        ),
    )
}
"""The cases by key: a to e as in the literature on these methods, f with six degrees of freedom, g a long run."""


def described(case: Case) -> str:
    """Return a motion's name, key and length, and how many outputs few and many are."""
    many = "" if case.long else f", many: {case.with_many_outputs().outputs:,}"
    return f"{case.title} ({case.key}), {case.span:,.0f} s; few outputs: {CHECKPOINTS}{many}"
