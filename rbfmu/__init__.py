"""One rigid body, done right: rotations, Newton-Euler, scenes and their simulation.

It has array functions (`rbfmu.rotate(q_ab, v_b)`) and scenes (`load_scene`, `plan`, `simulate`). The same functions on
floats and tuples, for `@njit` code, are in `rbfmu_kernels`; co-simulation units are in `rbfmu_fmu`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rbfmu.arrays import *  # noqa: F403
    from rbfmu.arrays.spline import attitude_spline as attitude_spline
    from rbfmu.ensembles.control import Controller as Controller
    from rbfmu.ensembles.result import EnsembleResult as EnsembleResult
    from rbfmu.ensembles.running import run_ensemble as run_ensemble
    from rbfmu.exceptions import SceneWarning as SceneWarning, SimulationError as SimulationError
    from rbfmu.identification.fit import Fit as Fit, fit as fit
    from rbfmu.linearization import Linearization as Linearization, linearize as linearize
    from rbfmu.progress import progress_bar as progress_bar
    from rbfmu.result import Result as Result
    from rbfmu.runs.plan import Plan as Plan
    from rbfmu.scene import *  # noqa: F403
    from rbfmu.sensitivities import Sensitivity as Sensitivity, sensitivity as sensitivity
    from rbfmu.simulation import *  # noqa: F403
    from rbfmu.studies.chart import Chart as Chart, chart as chart
    from rbfmu.viewer import view as view

__version__ = "0.2.0"

_MODULES = {
    "arrays.spline": ("attitude_spline",),
    "scene": ("Body", "Scene", "SceneError", "load_scene"),
    "runs.plan": ("Plan",),
    "exceptions": ("SceneWarning", "SimulationError"),
    "result": ("Result",),
    "ensembles.control": ("Controller",),
    "ensembles.result": ("EnsembleResult",),
    "ensembles.running": ("run_ensemble",),
    "identification.fit": ("Fit", "fit"),
    "linearization": ("Linearization", "linearize"),
    "progress": ("progress_bar",),
    "sensitivities": ("Sensitivity", "sensitivity"),
    "studies.chart": ("Chart", "chart"),
    "simulation": ("Simulator", "compiled_step", "plan", "simulate"),
    "viewer": ("view",),
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names}


if not TYPE_CHECKING:  # with `__getattr__`, type checkers would accept any name

    def __getattr__(name: str) -> Any:
        """Import a name's module when it is first used; names that are not in `_MODULES` are array functions."""
        if name == "__all__":  # what `help(rbfmu)` lists
            return sorted([*_HOMES, *(n for n in import_module("rbfmu.arrays").__all__ if n not in _HOMES)])
        if name.startswith("__"):
            raise AttributeError(name)
        module = import_module(f"rbfmu.{_HOMES.get(name, 'arrays')}")
        if name not in (_HOMES if name in _HOMES else module.__all__):
            raise AttributeError(f"module 'rbfmu' has no attribute {name!r}")
        value = globals()[name] = getattr(module, name)
        return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES, *import_module("rbfmu.arrays").__all__])
