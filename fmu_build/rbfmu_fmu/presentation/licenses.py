"""The notices of what an FMU contains: documentation/licenses."""

import importlib.metadata
import re
from pathlib import Path

import rbfmu
from rbfmu_fmu.native.linking import FMI_HEADERS

FOLDER = "documentation/licenses"
ENTRY = """This FMU contains

- code of rbfmu, compiled or as it is: MIT licence, rbfmu.txt
- names and types of functions from the headers of the FMI standard: 2-clause BSD licence, fmi.txt
{pythonfmu}
The numbers in it are those of a scene, whose author may have terms of their own: see the attribute license in
modelDescription.xml.
"""
PYTHONFMU = "- the library of pythonfmu and its Python modules: MIT licence, pythonfmu.txt\n"


def licenses(with_pythonfmu: bool) -> dict[str, bytes]:
    """Return the notices by their place in an FMU; with_pythonfmu: of the kind that contains pythonfmu."""
    texts = {"license.txt": ENTRY.format(pythonfmu=PYTHONFMU if with_pythonfmu else "")}
    texts |= {"rbfmu.txt": _own(), "fmi.txt": _of_headers()}
    texts |= {"pythonfmu.txt": _of_package("pythonfmu")} if with_pythonfmu else {}
    return {f"{FOLDER}/{name}": text.encode() for name, text in texts.items()}


def _own() -> str:
    """Return the licence of rbfmu, which lies in the package or, of a clone, above it."""
    package = Path(rbfmu.__file__).parent
    return next(path for path in (package / "LICENSE", package.parent / "LICENSE") if path.exists()).read_text("utf-8")


def _of_package(name: str) -> str:
    files = importlib.metadata.files(name) or []
    return next(file for file in files if re.fullmatch(r"LICEN[CS]E(\.\w+)?", file.name)).read_text("utf-8")


def _of_headers() -> str:
    """Return the copyright and the terms that stand in the headers of FMI, as FMPy ships them."""
    text = (FMI_HEADERS / "fmi2Functions.h").read_text("utf-8")
    notice = re.search(r"Copyright.*?(?=\*/)", text, re.DOTALL)
    assert notice, text[:3000]
    return "\n".join(line.strip() for line in notice[0].splitlines()).strip("- \n") + "\n"
