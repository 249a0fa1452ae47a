"""Co-simulation units (FMI 2.0, FMI 3.0) of rigid-body scenes: `build` and `verify`."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rbfmu_fmu.builder import build as build
    from rbfmu_fmu.native.platforms import BuildError as BuildError
    from rbfmu_fmu.verification import Verification as Verification
    from rbfmu_fmu.verification import VerificationError as VerificationError
    from rbfmu_fmu.verification import verify as verify

_HOMES = {
    "build": "builder",
    "BuildError": "native.platforms",
    "Verification": "verification",
    "VerificationError": "verification",
    "verify": "verification",
}
__all__ = ["BuildError", "Verification", "VerificationError", "build", "verify"]


def __getattr__(name: str) -> object:
    """Load a name's module when it is first used, as FMPy takes a tenth of a second."""
    if name not in _HOMES:
        raise AttributeError(f"module 'rbfmu_fmu' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"rbfmu_fmu.{_HOMES[name]}"), name)
    return value
