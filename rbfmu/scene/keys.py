"""All keys of a scene with unit, default and meaning, taken from the fields that check them, and a scene template."""

import json
import textwrap
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from rbfmu.scene import body, ensemble, tables
from rbfmu.scene.scene import SECTIONS, Scene
from rbfmu.scene.section import Rule, Section, as_toml, joined

INSIDE: Mapping[str, type[Section]] = {"initial": tables.Attitude, "ensemble": ensemble.Correlation}
"""The tables that are inside others, by the outer table."""
OWN = ("constants", "tables", "formulas", "states", "events")
"""The tables whose keys are a user's own names."""
REQUIRED = "required"
OF_THE_MOTION = "all that the motion has"
WRITTEN = {"body.mass": "2.0", "body.inertia": "[1.0, 2.0, 2.5]", "initial.omega_b": "[0.1, 2.0, 0.1]"}
"""The values that are set in a new scene: a tumbling body."""
SKETCHED = {
    "body.shape": '{ kind = "box", sides = [0.2, 0.1, 0.05] }',
    "initial.attitude": '{ euler = "ZYX", angles_deg = [0, 0, 0] }',
    "initial.omega_b_deg": "[0, 0, 0]",
    "outputs.quantities": f"[{', '.join(map(as_toml, tables.QUANTITIES))}]",
}
"""The values that a new scene shows, commented out, for keys that can replace others, and all quantities."""
HEAD = Path(__file__).with_name("new_scene.toml")
"""The first lines of a new scene."""


class Key(NamedTuple):
    """A key: the dotted path of its table, its name, unit, default (as TOML spells it, or in words) and meaning."""

    table: str
    name: str
    unit: str
    default: str
    meaning: str

    @property
    def path(self) -> str:
        """Return the dotted path of the key."""
        return joined(self.table, self.name)


OF_FORMULAS = (
    Key("loads", "potential", "J", "", "a formula of position and attitude: a force and a torque follow from it"),
    Key("outputs", "NAME", "", "", "an output of your own: a formula, or { value, unit, about }"),
)
"""Keys that are no fields of a table. Also force_a, force_b, torque_a and torque_b may be formulas."""


def scene_keys() -> Iterator[Key]:
    """Return all keys, table by table."""
    yield _key(Scene, "name")
    for section in SECTIONS.values():
        yield from (_key(section, key) for key, (_, rule) in section._keys.items() if isinstance(rule, Rule))
        yield from (key for key in OF_FORMULAS if key.table == section._path)
        if section is body.Body:
            yield Key("body.shape", "kind", "", REQUIRED, " or ".join(f'"{kind}"' for kind in body.SHAPES))
            yield from (_key(shape, key) for shape in body.SHAPES.values() for key in shape.sizes())
        if inside := INSIDE.get(section._path):
            yield from (_key(inside, key)._replace(default="") for key in inside._keys)
    yield from (Key(table, "NAME", "", "", Scene._rules[table].meaning) for table in OWN)


def _key(section: type[Section], name: str) -> Key:
    field, rule = section._keys[name]
    if field != name:
        return Key(section._path, name, rule.unit, "", rule.meaning)
    meaning = f"{rule.meaning}: {rule.choice}" if rule.choice else rule.meaning
    default = as_toml(_plain(getattr(section, name))) if hasattr(section, name) else REQUIRED
    return Key(section._path, name, rule.unit, OF_THE_MOTION if name == "quantities" else default, meaning)


def _plain(value: object) -> object:
    """Return the value with whole numbers as integers, which are easier to read."""
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def new_scene(name: str) -> str:
    """Return the text of a scene file that runs and shows every key of a run; those not needed are commented out."""
    head = HEAD.read_text(encoding="utf-8").splitlines()
    lines = [*(line.format(name=name) for line in head), f"name = {json.dumps(name, ensure_ascii=False)}"]
    for table, keys in groupby(scene_keys(), lambda key: key.table):
        if table in SECTIONS and table != "ensemble":
            lines += ["", f"[{table}]", *(line for key in keys if key not in OF_FORMULAS for line in _lines(key))]
    return "\n".join(lines) + "\n"


def _lines(key: Key) -> Iterator[str]:
    text = f"{key.meaning} ({key.unit})" if key.unit else key.meaning
    yield from textwrap.wrap(text, 100, initial_indent="# ", subsequent_indent="#   ")
    value = WRITTEN.get(key.path) or SKETCHED.get(key.path) or key.default
    yield f"{key.name} = {value}" if key.path in WRITTEN else f"#{key.name} = {value}"
