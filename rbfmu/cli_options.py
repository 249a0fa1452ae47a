"""What several commands take: options of models, of inputs, of runs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rbfmu.cli_output import say_where_nothing_is_kept

if TYPE_CHECKING:
    from rbfmu.scene.scene import Scene

SAVED = (".csv", ".npz")
STORES = (".npz", ".zarr")
PICTURES = (".png", ".svg", ".pdf")

model_option = click.option(
    "--model",
    type=click.Choice(["planned", "full"]),
    default="planned",
    show_default=True,
    help="The smallest that serves the scene, or all degrees of freedom.",
)


def input_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of commands that drive the ports by a file."""
    interpolate = click.option(
        "--interpolate",
        type=click.Choice(["hold", "linear"]),
        default="hold",
        show_default=True,
        help="Between the rows of --inputs.",
    )
    inputs = click.option(
        "--inputs",
        type=click.Path(path_type=Path),
        metavar="FILE.csv",
        help="Drive the ports: columns time, torque_b[1], ...  [ports at zero]",
    )
    return inputs(interpolate(command))


def run_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of commands that plan a run: keys of the scene's table [run]."""
    for key, unit in (("step", " (s)"), ("stop", " (s)"), ("accuracy", "")):
        option = click.option(f"--{key}", type=float, help=f"In place of the scene's run.{key}{unit}.")
        command = option(command)
    return command


def folder_option(default: str, text: str) -> Callable[..., Any]:
    """Return the option of a command that writes a folder."""
    kind = click.Path(file_okay=False, path_type=Path)
    return click.option("-o", "--output", "folder", type=kind, default=Path(default), show_default=True, help=text)


def driven_by(inputs: Path | None, interpolate: str) -> dict[str, Any]:
    """Return the arguments of a plan and of a run that are driven by a file."""
    return {} if inputs is None else {"inputs": inputs, "interpolate": interpolate}


@contextmanager
def given_scene(path: Path, run: dict[str, float | None]) -> Iterator["Scene"]:
    """Return the scene of a file with the options given; errors name the file, also from inside."""
    from rbfmu.scene.argument import faults_of
    from rbfmu.scene.scene import load_scene

    say_where_nothing_is_kept()
    given = {key: value for key, value in run.items() if value is not None}
    options = " and ".join(f"--{key} {value!r}" for key, value in given.items())
    loaded = load_scene(path)
    with faults_of(f"{path} with {options}" if options else str(path)):
        yield loaded.replace(run=given)
