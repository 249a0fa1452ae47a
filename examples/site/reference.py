"""The reference: each public name with its docstring, and those of `rbfmu` with an example as well."""

import inspect
import re
import tempfile
from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import rbfmu
import rbfmu_fmu
import rbfmu_kernels
from examples import pages
from examples.site.examples_of import code_of, printed
from rbfmu.scene.keys import scene_keys
from rbfmu.scene.scene import QUANTITIES
from rbfmu_fmu.description import describe
from rbfmu_kernels.types import python_function

LABELS = ("Shapes", "Units", "Frames", "Error", "Singular", "Source", "Raises")
LABEL = re.compile(rf"(?:^|(?<=\s))({'|'.join(LABELS)})(?=:| <=| )")
PORTS = ["force_a", "force_b", "torque_a", "torque_b"]
ARGUMENT = r"([\w, ()*/]{1,40}): "
OF_ARGUMENTS = re.compile(rf"(?:^|(?<=[.;] )){ARGUMENT}")


def functions() -> str:
    """Return the entries of array functions, by what they are about."""
    parts: dict[str, list[str]] = {part: [] for part in (*pages.PARTS, "")}
    for name in rbfmu.arrays.__all__:
        home = python_function(getattr(rbfmu_kernels, name)).__module__ if hasattr(rbfmu_kernels, name) else ""
        parts[home.removeprefix("rbfmu_kernels.")].append(name)
    titles = pages.PARTS | {"": "All of them"}
    return "\n".join(
        f"## {titles[part]}\n\n" + "\n".join(entry("rbfmu", name) for name in sorted(names))
        for part, names in parts.items()
        if names
    )


def motions() -> str:
    """Return the entries of what has to do with scenes."""
    return "\n".join(entry("rbfmu", name) for name in rbfmu.__all__ if name not in rbfmu.arrays.__all__)


def kernels() -> str:
    """Return the entries of kernels that are in no array function."""
    names = [name for name in rbfmu_kernels.__all__ if name not in rbfmu.arrays.__all__]
    routines = [name for name in names if inspect.isroutine(_plain(rbfmu_kernels, name))]
    return "\n".join(entry("rbfmu_kernels", name) for name in routines)


def units() -> str:
    """Return the entries of what builds FMUs."""
    return "\n".join(entry("rbfmu_fmu", name) for name in rbfmu_fmu.__all__)


def keys() -> str:
    """Return an entry of each key of a scene, table by table."""
    lines = []
    for table, group in groupby(scene_keys(), lambda key: key.table):
        lines.append(f"## {f'`[{table}]`' if table else 'Before all tables'}\n")
        for key in group:
            name = f"{table}.{key.name}" if table else key.name
            default = key.default if key.default in ("", "required") else f"default `{key.default}`"
            said = ", ".join(filter(None, (key.unit, default)))
            lines.append(_directive("describe", name, f"{key.meaning}{f' ({said})' if said else ''}"))
    return "\n".join(lines)


def variables() -> str:
    """Return an entry of each variable that an FMU may have: of one scene with ports, and of one with loads."""
    body = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.1, 0.0, 0.0]}
    given = {name: [0.1, 0.2, 0.3] for name in PORTS} | {"damping_b": [0.1, 0.1, 0.1]}
    found = {}
    for more in ({"inputs": {"ports": PORTS}, "outputs": {"quantities": list(QUANTITIES)}}, {"loads": given}):
        scene = rbfmu.Scene(body=body, **more)
        for v in describe(scene, rbfmu.plan(scene)).variables:
            found.setdefault((v.causality, v.block), []).append(v)
    lines = []
    for causality in ("input", "output", "parameter"):
        lines.append(f"## {causality.capitalize()}s\n")
        for (kind, block), all_of in found.items():
            if kind == causality:
                names = ", ".join(dict.fromkeys(f"`{v.name}`" for v in all_of))
                lines.append(_directive("describe", block, f"{all_of[0].meaning} ({all_of[0].unit}): {names}"))
    return "\n".join(lines)


def entry(package: str, name: str) -> str:
    """Return the entry of a name: how it is called, its docstring, members, and for `rbfmu` an example."""
    module = {"rbfmu": rbfmu, "rbfmu_kernels": rbfmu_kernels, "rbfmu_fmu": rbfmu_fmu}[package]
    value = _plain(module, name)
    text = prose(inspect.getdoc(value) or "")
    if inspect.isclass(value):
        text += "\n" + "\n".join(_members(value))
    if package == "rbfmu":
        text += f"\n{example(name)}"
    kind = "py:class" if inspect.isclass(value) else "py:function"
    return _directive(kind, f"{package}.{name}{_called(value)}", text)


def example(name: str) -> str:
    """Return a name's example with what it prints, which is run here."""
    with tempfile.TemporaryDirectory() as folder:
        code = code_of(name)
        said = printed(code, Path(folder))
    head = "import numpy as np\nimport rbfmu\n\n" if "np." in code else "import rbfmu\n\n"
    return f"```python\n{head}{code}\n```\n" + (f"```text\n{said.rstrip()}\n```\n" if said else "")


def prose(text: str) -> str:
    """Return a docstring as Markdown: labels such as "Units" and arguments begin a line of their own."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", text):
        joined = " ".join(paragraph.split())
        if re.match(ARGUMENT, joined) and joined.partition(":")[0] not in LABELS:
            parts.append(_quoted(OF_ARGUMENTS.sub(r"\n\n**\1**: ", joined)))
        else:
            parts.append(_quoted(LABEL.sub(r"\n\n**\1**", joined)))
    return "\n\n".join(parts) + "\n"


def _quoted(text: str) -> str:
    """Return text in which Markdown finds no marks but code and what stands between double stars."""
    pieces = re.split(r"(`[^`]*`|\*\*[\w, ()/]+\*\*)", text)
    return "".join(piece if k % 2 else re.sub(r"([\\*_|<>\[\]#$~])", r"\\\1", piece) for k, piece in enumerate(pieces))


def _members(of: type) -> Iterator[str]:
    for name, value in sorted(vars(of).items()):
        value = inspect.unwrap(getattr(value, "__func__", getattr(value, "fget", getattr(value, "func", value))))
        if not name.startswith("_") and inspect.isfunction(value) and (text := inspect.getdoc(value)):
            whole = isinstance(vars(of)[name], property) or not inspect.isroutine(getattr(of, name))
            kind = "py:property" if whole else "py:method"
            yield _directive(kind, name + ("" if whole else _called(value)), prose(text), fence="::::")


def _called(value: Any) -> str:
    """Return the arguments without their types, which the docstring says."""
    try:
        given = inspect.signature(value).parameters.values()
    except ValueError:
        return ""
    bare = [one.replace(annotation=inspect.Parameter.empty) for one in given if one.name not in ("self", "cls")]
    return str(inspect.Signature(bare)) if not (inspect.isclass(value) and issubclass(value, Warning)) else ""


def _plain(module: Any, name: str) -> Any:
    value = getattr(module, name)
    return getattr(value, "py_func", value)


def _directive(kind: str, argument: str, text: str, fence: str = ":::::") -> str:
    return f"{fence}{{{kind}}} {argument}\n{text}\n{fence}\n"


MADE: dict[str, Callable[[], str]] = {
    "functions": functions,
    "motions": motions,
    "kernels": kernels,
    "units": units,
    "keys": keys,
    "variables": variables,
}
PLACE = re.compile(r"<!-- made by examples\.site: (\w+) -->")


def filled(text: str) -> str:
    """Return a page's text with the entries that its marks ask for."""
    return PLACE.sub(lambda found: MADE[found[1]](), text)
