"""Changes of a scene's tables, as `Scene.replace` takes them: by dotted keys, where new keys exclude others."""

from collections.abc import Mapping
from typing import Any

from rbfmu.scene.section import Section


def with_changes(table: Any, value: Any, section: type[Section] | None) -> Any:
    """Return the table with the new keys, and without the keys that these exclude."""
    if not isinstance(value, Mapping) or not isinstance(table, Mapping):
        return value
    if section is None:  # a table with names of one's own, of which a new value keeps unit and meaning
        return {**table, **{key: _in_row(table.get(key), item) for key, item in value.items()}}
    excluded = {key for keys in section._spellings.values() if set(keys) & set(value) for key in keys}
    return {key: item for key, item in table.items() if key not in excluded} | dict(value)


def _in_row(row: Any, item: Any) -> Any:
    """Return what replaces a constant's, an output's or a state's row: of a value or a start alone the rest stays."""
    return {**row, next(iter(row)): item} if isinstance(row, Mapping) and not isinstance(item, Mapping) else item


def as_tables(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables made from dotted keys."""
    tables: dict[str, Any] = {}
    for key, value in changes.items():
        *path, last = str(key).split(".")
        table = tables
        for name in path:
            if not isinstance(table.get(name), dict):
                table[name] = {}
            table = table[name]
        both = isinstance(value, Mapping) and isinstance(table.get(last), dict)
        table[last] = table[last] | dict(value) if both else dict(value) if isinstance(value, Mapping) else value
    return tables
