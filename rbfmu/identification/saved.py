"""A fit as a scene file with comments, and as a scene with an ensemble of what the data leave open."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbfmu.exceptions import named
from rbfmu.extras import needed
from rbfmu.scene.scene import SECTIONS, Scene
from rbfmu.sensitivities import ATTITUDE
from rbfmu.types import Array

if TYPE_CHECKING:
    from rbfmu.identification.fit import Fit

_INERTIA = "body.inertia"


def write_scene(fit: "Fit", path: Path, source: Path | None = None) -> None:
    """Write the fitted scene; source: the file of the scene that was fitted, whose comments stay.

    Behind each number that was free stands its standard error.
    """
    tomlkit = needed("tomlkit", "fit")
    with named(path):
        text = source.read_text(encoding="utf-8-sig") if source else tomlkit.dumps(_plain(fit.scene.to_dict()))
        document = tomlkit.parse(text)
        for key in dict.fromkeys(name.partition("[")[0] for name in fit.names):
            _put(tomlkit, document, fit, key)
        written = tomlkit.dumps(document)
        Scene.from_dict(tomllib.loads(written), str(path))  # what cannot be read again is not written
        path.write_text(written, encoding="utf-8")


def _plain(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables without what is None, which TOML does not know."""
    return {
        name: _plain(value) if isinstance(value, Mapping) else value
        for name, value in tables.items()
        if value is not None and value != {}
    }


def _put(tomlkit: Any, document: Any, fit: "Fit", key: str) -> None:
    table, _, name = key.partition(".")
    rows = document.setdefault(table, tomlkit.table())
    for spellings in SECTIONS[table]._spellings.values() if table in SECTIONS else ():
        for other in [s for s in spellings if name in spellings and s != name and s in rows]:
            del rows[other]
    value = tomlkit.item(_value_of(fit.scene, key))
    if key == ATTITUDE:
        value = tomlkit.inline_table().append("quaternion", [*fit.scene.initial.quaternion])
    row = rows.get(name)
    if table in ("constants", "states") and isinstance(row, Mapping):
        rows[name]["value" if table == "constants" else "start"] = value
        rows[name].comment(_said(fit, key))
        return
    rows.pop(name, None)
    value.comment(_said(fit, key))
    rows.add(name, value)


def _value_of(scene: Scene, key: str) -> Any:
    table, _, name = key.partition(".")
    if key == ATTITUDE:
        return {"quaternion": [*scene.initial.quaternion]}
    if table in ("constants", "states"):
        row = getattr(scene, table)[name]
        numbers = row.value if table == "constants" else row.start
        return [*numbers] if len(numbers) > 1 else numbers[0]
    if key == _INERTIA:
        assert scene.body is not None
        M = np.array(scene.body.M_c)
        return M.tolist() if np.any(M - np.diag(np.diag(M))) else np.diag(M).tolist()
    value = getattr(getattr(scene, table), name)
    return [*value] if isinstance(value, tuple) else value


def _said(fit: "Fit", key: str) -> str:
    errors = [e for n, e in zip(fit.names, fit.standard_errors, strict=True) if n.partition("[")[0] == key]
    said = ", ".join("not told" if np.isinf(e) else f"{e:.2g}" for e in errors)
    return f"fitted; standard error {said}"


# An ensemble


def with_ensemble(fit: "Fit", runs: int, seed: int) -> Scene:
    """Return the fitted scene with its numbers normally distributed, correlated as the fit has them."""
    vary: dict[str, Any] = {}
    components: list[str] = []
    for key in dict.fromkeys(name.partition("[")[0] for name in fit.names):
        at = [n for n, name in enumerate(fit.names) if name.partition("[")[0] == key]
        errors = fit.standard_errors[at]
        if key == ATTITUDE:
            vary[key] = {"rotvec": errors.tolist()}
            components += [f"{key}.rotvec[{k}]" for k in (1, 2, 3)]
            continue
        value = _value_of(fit.scene, key)
        if key == _INERTIA and len(at) == 6:
            vary[key] = {"normal": [value, _symmetric(errors).tolist()]}
            components += [fit.names[n] for n in at]
        elif isinstance(value, list):
            places = [int(fit.names[n].partition("[")[2].partition(",")[0].rstrip("]")) for n in at]
            spread = np.zeros(len(value))
            spread[np.array(places) - 1] = errors
            vary[key] = {"normal": [value, spread.tolist()]}
            components += [f"{key}[{k}]" for k in places]
        else:
            vary[key] = {"normal": [value, float(errors[0])]}
            components.append(key)
    matrix = fit.correlation
    np.fill_diagonal(matrix, 1.0)
    table: dict[str, Any] = {"runs": runs, "seed": seed, "vary": vary}
    if len(components) > 1:
        table["correlation"] = {"components": components, "matrix": (0.5 * (matrix + matrix.T)).tolist()}
    return fit.scene.replace({"ensemble": table})


def _symmetric(row: Array) -> Array:
    a, b, c, d, e, f = row
    return np.array([[a, d, e], [d, b, f], [e, f, c]])
