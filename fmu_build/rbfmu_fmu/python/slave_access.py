"""What all instances of one pythonfmu FMU share: its variables, the format of saved states, and the model's code.

It is bundled with the slave. It does not import rbfmu, nor Numba or NumPy if the shipped object code can be loaded.
"""

import contextlib
import ctypes
import importlib
import json
import os
import struct
import sys
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

TO_VARY = 'list "%s" under parameters in the scene\'s [inputs] to vary it'
"""The remedy for a refused parameter, given its block or blocks."""
HELD = f"%s = %s: this FMU's model was planned for %s here; {TO_VARY}"
"""The message that refuses a parameter, given its name, its value, the planned value and its block."""

CODE = f"model-{sys.platform}-{os.uname().machine if hasattr(os, 'uname') else 'any'}"
"""The name of the shipped code for this platform, without its suffix."""
LIBRARY, OBJECT = ".so", ".o"
"""The suffixes of shipped code: a shared library on every platform, or an object file that llvmlite loads."""

FORMULAS = ".formulas"
"""The bundled module with the model of a scene's formulas."""

INPUTS_TOGETHER = 12
"""How many numbers the loads that may be inputs have. In the buffer nothing is between them: all are set at once."""

_OWNERS: list[object] = []  # the objects that keep loaded code alive


class Entries(NamedTuple):
    """A model's entry functions; their argument is an array if `on_array`, else the address of a buffer."""

    initialize: Callable[..., int]
    step: Callable[..., int]
    outputs: Callable[..., int]
    on_array: bool


class Access:
    """Maps value references to places in the buffer, loads the model's code, and checks saved states."""

    def __init__(self, folder: str, identity: str) -> None:
        with open(os.path.join(folder, "description.json"), encoding="utf-8") as file:
            self.description: dict[str, Any] = json.load(file)
        self.identity = identity.encode()
        variables = self.description["variables"]
        self.names: list[str] = [v["name"] for v in variables]
        self.offsets: list[int] = [v["offset"] for v in variables]
        self.causality: list[str] = [v["causality"] for v in variables]
        self.counts: list[int] = [offset for _, offset, _ in self.description["counts"]]
        places = [o for o, c in zip(self.offsets, self.causality, strict=True) if c == "input"]
        packed = not places or places[-1] - places[0] < INPUTS_TOGETHER
        self.inputs = [r for r, c in enumerate(self.causality) if c == "input" and packed]
        self.outputs = [r for r, c in enumerate(self.causality) if c == "output"]
        self.settable = {r for r, c in enumerate(self.causality) if c != "output"}
        self.pinned = [(v["name"], v["offset"], v["start"], v["block"]) for v in variables if v["pinned"]]
        self.input_struct = _struct([self.offsets[r] for r in self.inputs])
        self.output_struct = _struct([self.offsets[r] for r in self.outputs])
        start = self.description["start_buffer"]
        self.start = struct.pack(f"{len(start)}d", *start)
        self.last_time, self.accuracy = self.description["last_time"], self.description["accuracy"]
        self._folder = folder
        self._entries: Entries | None = None

    def name_of(self, reference: int) -> str:
        """Return the name of the variable with a value reference, or the reference in words if there is none."""
        names = [*self.names, "status", *(name for name, *_ in self.description["counts"])]
        return names[reference] if reference < len(names) else f"value reference {reference}"

    def entries(self) -> Entries:
        """Return the entries that were compiled ahead of time; if they cannot be used, let Numba compile them."""
        if self._entries is None:
            shipped = _shipped_entries(self._folder, self.description["shipped_code"])
            self._entries = shipped or _numba_entries(self.description["model"])
        return self._entries

    def state_head(self, content: bytes) -> bytes:
        """Return the first bytes of a saved state: the FMU's identity and a checksum of the content."""
        return self.identity + zlib.crc32(content).to_bytes(4, "little")

    def state_content(self, state: bytes) -> bytes:
        """Return the content of a saved state: phase, status, stale and buffer. Raises ValueError if it is not ours."""
        size = len(self.identity) + 4
        head, content = state[:size], state[size:]
        if len(content) != 3 + len(self.start) or head != self.state_head(content):
            raise ValueError(f"these {len(state)} bytes are no state of this FMU")
        return content


def _struct(offsets: list[int]) -> tuple[struct.Struct, int]:
    """Return (struct, first byte) for numbers at ascending offsets; packing sets the numbers between them to zero."""
    layout, end = "", offsets[0] if offsets else 0
    first = 8 * end
    for offset in offsets:
        layout += f"{8 * (offset - end)}xd"
        end = offset + 1
    return struct.Struct(layout), first


def _shipped_entries(folder: str, checksums: dict[str, int]) -> Entries | None:
    """Load the shipped code for this platform; return None if there is none, or it cannot be loaded."""
    if os.environ.get("RBFMU_COMPILE") == "1":
        return None
    try:
        names = [name for name in checksums if name.startswith(CODE)]
        if not names:
            raise OSError(f"there are none for {CODE}")
        path = os.path.join(folder, names[0])
        with open(path, "rb") as file:
            code = file.read()
        if zlib.crc32(code) != checksums[names[0]]:
            raise ValueError(f"{path} is damaged")  # loading damaged code could end the process
        address = _addresses_in_library(path) if path.endswith(LIBRARY) else _addresses_in_object(code)
        pointer, result = ctypes.c_void_p, ctypes.c_int64
        of_buffer = ctypes.PYFUNCTYPE(result, pointer)
        of_buffer_and_step = ctypes.PYFUNCTYPE(result, pointer, ctypes.c_double)
        initialize, outputs = of_buffer(address("initialize")), of_buffer(address("outputs"))
        return Entries(initialize, of_buffer_and_step(address("step")), outputs, on_array=False)
    except (ImportError, RuntimeError, OSError, AttributeError, ValueError) as error:
        tell(f"rbfmu: no shipped kernels can be used here ({error}): Numba compiles them")
        return None


def _addresses_in_library(path: str) -> Callable[[str], int]:
    library = ctypes.PyDLL(path)
    _OWNERS.append(library)
    library.model_chosen_step.restype = ctypes.c_void_p
    step: int = library.model_chosen_step()
    return lambda name: step if name == "step" else ctypes.cast(library[f"model_{name}"], ctypes.c_void_p).value or 0


def _addresses_in_object(code: bytes) -> Callable[[str], int]:
    """Load the object file of an FMU that was built on a machine without a linker."""
    import llvmlite.binding as llvm

    if hasattr(llvm, "initialize_native_target"):
        llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)
    engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _OWNERS.append(engine)
    return engine.get_function_address  # type: ignore[no-any-return]


def _numba_entries(model: str) -> Entries:
    if model.startswith("formulas."):
        entries = importlib.import_module(FORMULAS, __package__).MODEL
    else:
        entries = importlib.import_module(".models", __package__).model_named(model)
    tiered = importlib.import_module(".compile.tiered", __package__).tiered
    return Entries(tiered(entries.initialize), tiered(entries.step), tiered(entries.outputs), on_array=True)


def tell(text: str) -> None:
    """Write one line to stderr, if there is one; never raise, as pythonfmu would not survive an exception."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()
