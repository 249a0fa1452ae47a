"""The command `rbfmu view`."""

from pathlib import Path

import click

from rbfmu.cli_options import driven_by, input_options
from rbfmu.cli_output import check_target, planning_bar, say_where_nothing_is_kept, usage_errors


@click.command()
@click.argument("source", metavar="SCENE|RESULT", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path),
              help="Page to write, also over one that is there.  [motion.html, if there is none]")  # fmt: skip
@click.option("--scene", "body", type=click.Path(path_type=Path), help="Whose body a RESULT (.csv, .npz) moves.")
@click.option("--stop", type=float, help="End of what is shown (s).")
@click.option("--ghosts", type=click.IntRange(0), default=0, metavar="N",
              help="Show N runs of the scene's ensemble as pale bodies.")  # fmt: skip
@input_options
def view(
    source: Path,
    output: Path | None,
    body: Path | None,
    stop: float | None,
    ghosts: int,
    inputs: Path | None,
    interpolate: str,
) -> None:
    """Write a page that plays a motion in 3D, in any browser and without network.

    A SCENE is simulated; a RESULT is shown as it is.
    """
    from rbfmu.viewer import view as write_page

    check_target(output, "--output", (".html",))
    target = output or Path("motion.html")
    if output is None and target.exists():
        raise click.UsageError(f"{target}: exists already, and stays as it is; -o {target} writes over it")
    say_where_nothing_is_kept()
    with usage_errors(), planning_bar(source.stem) as bar:
        driven = driven_by(inputs, interpolate)
        motion = write_page(source, target, scene=body, stop=stop, progress=bar, ghosts=ghosts, **driven)
    size = target.stat().st_size / 1e6
    click.echo(f"{target}: {size:.1f} MB, {len(motion.result.time)} pictures, played in {motion.played:.3g} s")
