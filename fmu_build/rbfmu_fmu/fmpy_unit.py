"""An FMU of either version of FMI in FMPy, stepped by hand: inputs and outputs are the numbers of its description."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
from fmpy.simulation import instantiate_fmu

from rbfmu_fmu.description import Description
from rbfmu_fmu.fmi_version import FmiVersion
from rbfmu_fmu.native.build import version_of


def version_in(model: Any) -> FmiVersion:
    """Return the version of FMI that FMPy's description of a model is of."""
    fmi = 3 if model.fmiVersion.startswith("3") else 2
    return version_of(fmi, scalars=fmi == 3 and not any(v.dimensions for v in model.modelVariables))


class Unit:
    """One instance of an FMU that lies unzipped in a folder; `messages` are those of refused calls."""

    def __init__(self, folder: str | Path, description: Description):
        model = fmpy.read_model_description(str(folder), validate=False)
        version = version_in(model)
        referenced = list(enumerate(version.references(description)))
        causality = {k: description.variables[one.elements[0]].causality for k, one in referenced}
        self._inputs, self._outputs = (
            [k for k, _ in referenced if causality[k] == wanted] for wanted in ("input", "output")
        )
        self._count = sum(v.causality == "output" for v in description.variables)
        self._status = version.status_reference(description)
        self._old = not version.has_time
        self.messages: list[str] = []
        logger = self._log_2 if self._old else self._log_3
        self._fmu = instantiate_fmu(str(folder), model, "CoSimulation", debug_logging=True, logger=logger)

    def _log_2(self, component: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        self._log_3(component, status, category, message)

    def _log_3(self, environment: Any, status: int, category: bytes, message: bytes) -> None:
        if status:
            self.messages.append(message.decode())

    def start(self, begin: float, end: float, inputs: Sequence[float]) -> None:
        """Initialise with these inputs."""
        if self._old:
            self._fmu.setupExperiment(startTime=begin, stopTime=end)
            self._fmu.enterInitializationMode()
        else:
            self._fmu.enterInitializationMode(startTime=begin, stopTime=end)
        self.set_inputs(inputs)
        self._fmu.exitInitializationMode()

    def set_inputs(self, values: Sequence[float]) -> None:
        """Set all inputs."""
        if self._inputs:
            (self._fmu.setReal if self._old else self._fmu.setFloat64)(self._inputs, list(values))

    def outputs(self) -> list[float]:
        """Return all outputs and, as the last one, `status`."""
        if self._old:
            return [*self._fmu.getReal(self._outputs), *self._fmu.getInteger([self._status])]
        return [*self._fmu.getFloat64(self._outputs, self._count), *self._fmu.getInt32([self._status])]

    def step(self, time: float, size: float) -> None:
        """Take a step. Raises FMPy's exception where it is refused."""
        self._fmu.doStep(time, size)

    def terminate(self) -> None:
        """End the simulation."""
        self._fmu.terminate()

    def free(self) -> None:
        """Free the instance."""
        self._fmu.freeInstance()


@contextmanager
def unit_in(folder: str | Path, description: Description) -> Iterator[Unit]:
    """Yield an instance, and free it afterwards."""
    unit = Unit(folder, description)
    yield unit
    unit.free()
