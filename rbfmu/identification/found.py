"""What a fit found: numbers with their errors, as a scene file with comments, and as an ensemble of what is open."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rbfmu.exceptions import named
from rbfmu.extras import needed
from rbfmu.identification.charts import INERTIA, OWN, value_of
from rbfmu.identification.measured import Measured
from rbfmu.scene.scene import SECTIONS, Scene
from rbfmu.sensitivities import ATTITUDE
from rbfmu.types import Array


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """What `fit` gives.

    scene: the fitted one; names, values, standard_errors: of the numbers that were free, (n,), NaN and infinite where
    the data do not tell them; of an attitude the turn in b from the scene's, rad; covariance, correlation: (n, n);
    unknown: what the data do not tell, in words; residuals: measured less fitted by output, of a quaternion a turn in
    b, rad, (times, k), NaN at gaps; sigma: the standard deviation of each output's; doubts: in which way residuals do
    not look like noise, in words; measured: the data.
    """

    scene: Scene
    names: tuple[str, ...]
    values: Array
    standard_errors: Array
    covariance: Array
    unknown: tuple[str, ...]
    residuals: Mapping[str, Array]
    sigma: Mapping[str, float]
    doubts: tuple[str, ...]
    measured: Measured

    def __repr__(self) -> str:
        told = ", ".join(
            f"{name} = {value:.6g} +- {error:.2g}"
            for name, value, error in zip(self.names, self.values, self.standard_errors, strict=True)
        )
        return f"Fit({self.scene.name}: {told})"

    @property
    def correlation(self) -> Array:
        """Return the correlation of the numbers' errors, (n, n); NaN where the data do not tell one."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.covariance / np.outer(self.standard_errors, self.standard_errors))

    @property
    def _places(self) -> dict[str, list[int]]:
        """Return where each key has its numbers among all."""
        keys = [name.partition("[")[0] for name in self.names]
        return {key: [n for n, one in enumerate(keys) if one == key] for key in dict.fromkeys(keys)}

    def posterior(self, runs: int = 1000, seed: int = 1) -> Scene:
        """Return the fitted scene with an ensemble of what the data leave open: normal, correlated as the fit has it.

        Raises ValueError where there is something that they do not tell.
        """
        if self.unknown:
            raise ValueError(f"{self.scene.name}: expected data that tell all numbers: {'; '.join(self.unknown)}")
        spreads = {key: _spread(self, key, at) for key, at in self._places.items()}
        components = [name for _, names in spreads.values() for name in names]
        matrix = self.correlation
        np.fill_diagonal(matrix, 1.0)
        vary = {key: distribution for key, (distribution, _) in spreads.items()}
        table: dict[str, object] = {"runs": runs, "seed": seed, "vary": vary}
        if len(components) > 1:
            table["correlation"] = {"components": components, "matrix": (0.5 * (matrix + matrix.T)).tolist()}
        return self.scene.replace({"ensemble": table})

    def save(self, path: str | Path, source: str | Path | None = None) -> None:
        """Write the fitted scene as a TOML file, each number with its standard error in a comment.

        source: the file of the scene that was fitted, whose own comments then stay. Needs tomlkit.
        """
        tomlkit = needed("tomlkit", "fit")
        with named(path):
            plain = tomlkit.dumps(self.scene.to_dict()) if source is None else ""
            document = tomlkit.parse(Path(source).read_text(encoding="utf-8-sig") if source else plain)
            for key, at in self._places.items():
                errors = ("not told" if np.isinf(e) else f"{e:.2g}" for e in self.standard_errors[at])
                _put(tomlkit, document, self.scene, key, f"fitted; standard error {', '.join(errors)}")
            written = tomlkit.dumps(document)
            Scene.from_dict(tomllib.loads(written), str(path))  # what cannot be read again is not written
            Path(path).write_text(written, encoding="utf-8")

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw residuals over their standard deviation, a panel an output; return the matplotlib.figure.Figure."""
        from rbfmu.plot import plot_residuals

        of = {name: rows / (self.sigma[name] or 1.0) for name, rows in self.residuals.items()}
        return plot_residuals(self.measured.time, of, path, self.scene.name)


def _put(tomlkit: Any, document: Any, scene: Scene, key: str, comment: str) -> None:
    """Put what a scene has for a key into the tables of a file, in place of any spelling of it."""
    table, _, name = key.partition(".")
    rows = document.setdefault(table, tomlkit.table())
    keys = SECTIONS[table]._keys if table in SECTIONS else {}
    for other in [key for key in rows if name in keys and key != name and keys.get(key, ("",))[0] == keys[name][0]]:
        del rows[other]
    value = tomlkit.item(_as_written(scene, key))
    if key == ATTITUDE:
        value = tomlkit.inline_table().append("quaternion", value)
    if table in OWN and isinstance(rows.get(name), Mapping):
        rows[name][OWN[table]] = value
        rows[name].comment(comment)
        return
    rows.pop(name, None)
    value.comment(comment)
    rows.add(name, value)


def _as_written(scene: Scene, key: str) -> Any:
    """Return what a scene has for a key as a file has it: principal moments alone, where the axes are those of b."""
    value = np.array(value_of(scene, key))
    if key == INERTIA:
        return (value if np.any(value - np.diag(np.diag(value))) else np.diag(value)).tolist()
    return value.tolist() if value.size > 1 else value.item()


def _spread(fit: Fit, key: str, at: list[int]) -> tuple[dict[str, Any], list[str]]:
    """Return the distribution of a key's numbers, and by which names these are correlated."""
    errors = fit.standard_errors[at]
    if key == ATTITUDE:
        return {"rotvec": errors.tolist()}, [f"{key}.rotvec[{k}]" for k in (1, 2, 3)]
    value = _as_written(fit.scene, key)
    if key == INERTIA and len(at) == 6:
        a, b, c, d, e, f = errors.tolist()
        return {"normal": [value, [[a, d, e], [d, b, f], [e, f, c]]]}, [fit.names[n] for n in at]
    if not isinstance(value, list):
        return {"normal": [value, float(errors[0])]}, [key]
    places = [int(fit.names[n].partition("[")[2].partition(",")[0].rstrip("]")) for n in at]
    spread = np.zeros(len(value))
    spread[np.array(places) - 1] = errors
    return {"normal": [value, spread.tolist()]}, [f"{key}[{k}]" for k in places]
