"""The versions of FMI: in what their FMUs differ, one row of facts a version.

`model_description` writes modelDescription.xml by such a row, and the C file `signatures` has the version's functions.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from rbfmu_fmu.description import Count, Description, FmiVariable, arrays, scalars


@dataclass(frozen=True, kw_only=True)
class FmiVersion:
    """One version of FMI; `VERSIONS` lists all."""

    name: str
    """The attribute fmiVersion of modelDescription.xml."""
    identity: str
    """The attribute of modelDescription.xml that identifies an FMU."""
    signatures: str
    """The C source of the version's functions, in `native/`."""
    folders: dict[str, str]
    """The folder of `binaries` for each of `native.platforms.PLATFORMS`."""
    second_folders: dict[str, str] = field(default_factory=dict)
    """A second folder for a platform, where no other platform of an FMU has it: importers there look into it."""
    icon: str = "terminalsAndIcons/icon.png"
    """The place of an FMU's picture."""
    abilities: dict[str, str]
    """What FMUs of either kind can do, as attributes of the element CoSimulation."""
    native_abilities: dict[str, str]
    """What a native FMU can do besides."""
    with_input_rates: dict[str, str]
    """And where all of its inputs may change within a step."""
    references: Callable[[Description], list[FmiVariable]]
    """What has a value reference."""
    real: str
    """What the version calls the type of floating-point variables."""
    integer: str
    """The same of `status`."""
    has_time: bool
    """Whether the time is a variable: the one after those that have a value reference."""
    course_of_inputs: str
    """How an importer gives inputs that change within a step."""
    nested: bool
    """Whether a variable is an element that holds another for its type, and knowns and unknowns stand in lists that
    count variables from 1 (FMI 2), or an element of its type, and go by value references (FMI 3)."""

    def abilities_of(self, d: Description) -> dict[str, str]:
        """Return what a native FMU can do besides that of either kind."""
        said = self.native_abilities | (self.with_input_rates if d.interpolates_inputs else {})
        return said | ({"maxOutputDerivativeOrder": "1"} if d.output_rates else {})

    def status_reference(self, d: Description) -> int:
        """Return the value reference of the integer output `status`, which all Reals come before."""
        return len(self.references(d)) + self.has_time

    def counted(self, d: Description) -> list[tuple[int, Count]]:
        """Return the counts of events with their value references, which are the last of all."""
        return [*enumerate(d.counts, self.status_reference(d) + 1)]


FMI2 = FmiVersion(
    name="2.0",
    identity="guid",
    signatures="fmi2.c",
    # One folder for macOS and none for Linux on aarch64: the first takes both processors in one file, the second has
    # the name that FMI 3.0 gave it, as FMI 2.0.5 says.
    folders={"linux64": "linux64", "win64": "win64", "linux-aarch64": "aarch64-linux", "darwin64": "darwin64",
             "darwin-aarch64": "darwin64"},
    second_folders={"linux-aarch64": "linux64"},  # FMPy, for one, looks into this folder on any Linux
    icon="model.png",
    abilities={"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true",
               "canBeInstantiatedOnlyOncePerProcess": "false"},
    native_abilities={"needsExecutionTool": "false", "canNotUseMemoryManagementFunctions": "false",
                      "canInterpolateInputs": "false", "providesDirectionalDerivative": "true"},
    with_input_rates={"canInterpolateInputs": "true"},
    references=scalars,
    real="Real",
    integer="Integer",
    has_time=False,
    course_of_inputs="gives their derivatives with respect to time",
    nested=True,
)  # fmt: skip
FMI3 = FmiVersion(
    name="3.0",
    identity="instantiationToken",
    signatures="fmi3.c",
    folders={"linux64": "x86_64-linux", "win64": "x86_64-windows", "linux-aarch64": "aarch64-linux",
             "darwin64": "x86_64-darwin", "darwin-aarch64": "aarch64-darwin"},
    abilities={"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"},
    native_abilities={"providesDirectionalDerivatives": "true", "providesAdjointDerivatives": "true"},
    with_input_rates={"providesIntermediateUpdate": "true", "mightReturnEarlyFromDoStep": "true",
                      "canReturnEarlyAfterIntermediateUpdate": "true"},
    references=arrays,
    real="Float64",
    integer="Int32",
    has_time=True,
    course_of_inputs="sets them in intermediate updates",
    nested=False,
)  # fmt: skip
FMI3_SCALARS = replace(FMI3, references=scalars)
"""For importers that take no arrays."""
VERSIONS = {(2, False): FMI2, (3, False): FMI3, (3, True): FMI3_SCALARS}
"""What FMUs are built for: by the version of FMI, and by whether scalars are asked for in place of arrays."""


def version_of(fmi: int, scalars: bool) -> FmiVersion:
    """Return a version of FMI, with arrays as variables or without. Raises ValueError where there is none."""
    if fmi not in (2, 3):
        raise ValueError(f"fmi = {fmi!r}: expected 2 or 3")
    if (fmi, scalars) not in VERSIONS:
        raise ValueError("scalars = True: expected fmi = 3 with it, as FMI 2 has no arrays")
    return VERSIONS[fmi, scalars]
