"""Which model and which method serve a scene at the least cost."""

from rbfmu.planning.select import plan

__all__ = ["plan"]
