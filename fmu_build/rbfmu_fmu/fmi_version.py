"""What FMUs of one version of FMI differ in: their XML, their C signatures, their variables, their folders."""

from collections.abc import Callable
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from rbfmu_fmu.description import Description
from rbfmu_fmu.value_references import Referenced

UNSET = "{}"
"""Stands for an FMU's identity while that identity is being made."""


@dataclass(frozen=True)
class FmiVersion:
    """One version of FMI; `native.build.VERSIONS` lists all."""

    name: str
    model_description: Callable[[Description, str, dict[str, str]], Element]
    """Makes modelDescription.xml of a description, the FMU's identity, and attributes in which kinds of FMU differ."""
    identity: str
    """The attribute of modelDescription.xml that identifies an FMU."""
    signatures: str
    """The C source of the version's functions, in `native/`."""
    folders: dict[str, str]
    """The folder of `binaries` for each of `native.platforms.PLATFORMS`."""
    capabilities: Callable[[Description], dict[str, str]]
    """What a native FMU can do, as attributes of modelDescription.xml."""
    references: Callable[[Description], list[Referenced]]
    """What has a value reference."""
    real: str
    """What the version calls the type of floating-point variables."""
    integer: str
    """The same of `status`."""
    has_time: bool
    """Whether the time is a variable: the one after those that have a value reference."""
    course_of_inputs: str
    """How an importer gives inputs that change within a step."""
    second_folders: dict[str, str] = field(default_factory=dict)
    """A second folder for a platform, where no other platform of an FMU has it: importers there look into it."""
    icon: str = "terminalsAndIcons/icon.png"
    """The place of an FMU's picture."""

    def status_reference(self, d: Description) -> int:
        """Return the value reference of the integer output `status`, which is the last of all."""
        return len(self.references(d)) + self.has_time
