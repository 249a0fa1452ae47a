"""The model of outputs of one's own over a closed form, which need no integration."""

from functools import cached_property
from typing import Any

from rbfmu.formulas.motion import CONSTANT, by_element
from rbfmu.formulas.program import Program
from rbfmu.formulas.source import source_over
from rbfmu.models.formulas import FormulaModel
from rbfmu.models.model_buffer import size_of_block
from rbfmu_kernels import buffer
from rbfmu_kernels.body import memory
from rbfmu_kernels.models import model_named
from rbfmu_kernels.quantities import active_flags

_FIRST_OUTPUT = next(iter(memory.OUTPUTS))


class OverClosedForm(FormulaModel):
    """The model of own outputs over a closed form, of whose motion and of the time they are functions."""

    def __init__(self, formulas: FormulaModel, base: str) -> None:
        super().__init__(formulas.scene, formulas.given, formulas.texts)
        self._base, self._closed_form = base, model_named(base)
        self.program = Program(self.motion.graph, {}, dict(by_element(self.texts.own)))

    @cached_property
    def blocks(self) -> buffer.Layout:
        """Return the places of the buffer's blocks: those of the closed form, and what is shown besides."""
        known = {name: size_of_block(block) for name, block in self._closed_form.BLOCKS.items()}
        constants = {f"{CONSTANT}{n}": s for n, s in self.given.constants.items()}
        own = {"series.start_time": 1, "series.time": 2} | constants | self.own_outputs
        _, before = buffer.places(known | own)
        return buffer.places(known | own | {"series.kept": before - memory.BLOCKS[_FIRST_OUTPUT].start})

    @cached_property
    def source(self) -> str:
        """Return the text of the generated kernels."""
        loads = {n if n == "damping_b" else f"constant_{n}": x for n, x in (self.plain_loads or {}).items()}
        return source_over(self.program, self.place, self._changes, dict(by_element(loads)))

    @property
    def _places(self) -> dict[str, Any]:
        """Return what the templates' globals are."""
        blocks = self.blocks.blocks
        places = {"TIME": "series.time", "STARTS": "series.start_time", "ACTIVE": "active", "KEPT": "series.kept"}
        return {name: blocks[block].start for name, block in places.items()} | {
            "MEMORY": blocks[_FIRST_OUTPUT].start, "MEMORY_SIZE": size_of_block(blocks["series.kept"]),
            "SHOWN": tuple(active_flags(self.quantities_read)),
        }  # fmt: skip
