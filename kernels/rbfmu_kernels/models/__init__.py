"""The models, of the whole body or of the part of its motion that a scene needs; see `body.shell.Model`."""

from functools import cache
from importlib import import_module

from ..body.shell import Model


@cache
def model_named(name: str) -> Model:
    """Return a model by `Model.name`, such as "free.FREE_TRIAXIAL"; its module is loaded when it is first asked for."""
    module, _, constant = name.partition(".")
    found: Model = getattr(import_module(f".{module}", __name__), constant)
    return found
