"""Co-simulation units (FMI 2.0, FMI 3.0) of rigid-body scenes: `build` and `verify`."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rbfmu_fmu.builder import build
    from rbfmu_fmu.native.platforms import BuildError
    from rbfmu_fmu.verification import Verification, VerificationError, verify

__all__ = ["BuildError", "Verification", "VerificationError", "build", "verify"]
_HOMES = {"build": "builder", "BuildError": "native.platforms"}


def __getattr__(name: str) -> object:
    """Import a name's module when it is first used, as importing FMPy takes a tenth of a second."""
    if name not in __all__:
        raise AttributeError(f"module 'rbfmu_fmu' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"rbfmu_fmu.{_HOMES.get(name, 'verification')}"), name)
    return value
