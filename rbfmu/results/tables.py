"""Results as tables of pandas and arrays of xarray, where these are installed."""

from typing import TYPE_CHECKING, Any

from rbfmu.extras import needed
from rbfmu_kernels.quantities import OUTPUT, TIME

if TYPE_CHECKING:
    from rbfmu.results.result import Result

AXES = {"quaternion": "parameter", "rpy": "angle"}
"""What the components of a quantity are, if they are not along axes x, y, z."""


def dataframe(result: "Result") -> Any:
    """Return a pandas.DataFrame: a column for each FMU variable, time (s) as index, units in `.attrs["units"]`."""
    columns = result.columns()
    index = columns.pop("time")
    table = needed("pandas", "tables").DataFrame(columns, index=index)
    table.index.name = "time"
    table.attrs["units"] = result.units
    return table


def dataset(result: "Result") -> Any:
    """Return a xarray.Dataset: a variable for each quantity, with the names of its components and its unit."""
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"time": ("time", result.time, {"units": TIME.unit, "long_name": TIME.meaning})}
    for name, values in result.quantities.items():
        row, axis = OUTPUT[name], AXES.get(name, "axis")
        attributes = {"units": row.unit, "long_name": row.meaning}
        variables[name] = ("time" if values.ndim == 1 else ("time", axis), values, attributes)
        if values.ndim == 2:
            coordinates[axis] = list(row.components)
    return needed("xarray", "tables").Dataset(variables, coordinates)
