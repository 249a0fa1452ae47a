"""The command `rbfmu ensemble`."""

from pathlib import Path

import click

from rbfmu.cli_options import PICTURES, STORES, given_scene, run_options
from rbfmu.cli_output import check_target, planning_bar, print_ensemble, print_written, usage_errors
from rbfmu.extras import needed


@click.command()
@click.argument("scene", metavar="SCENE", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="STORE", help="Keep in STORE (.npz or .zarr).")
@click.option("--runs", type=click.IntRange(1), help="In place of the scene's ensemble.runs.")
@click.option("--workers", type=click.IntRange(1), help="Threads.  [one for each processor]")
@click.option("--scheduler", metavar="ADDRESS", help="Of Dask, in place of threads: tcp://HOST:PORT.")
@click.option("--resume", is_flag=True, help="Go on with a STORE that is there.")
@click.option("--plot", type=click.Path(dir_okay=False, path_type=Path), help="Draw to FILE (.png, .svg or .pdf).")
@run_options
def ensemble(
    scene: Path,
    output: Path | None,
    runs: int | None,
    workers: int | None,
    scheduler: str | None,
    resume: bool,
    plot: Path | None,
    **run: float | None,
) -> None:
    """Run a scene many times, with the numbers that its table [ensemble] varies.

    A run has the same numbers on any number of workers, in one go or resumed.
    """
    from rbfmu.ensembles.executors import executor_of
    from rbfmu.ensembles.members import with_runs
    from rbfmu.ensembles.planning import plan_ensemble
    from rbfmu.ensembles.running import check_store, run_ensemble

    check_target(output, "--output", STORES)
    check_target(plot, "--plot", PICTURES)
    if resume and output is None:
        raise click.UsageError("--resume: expected --output with the store to go on with")
    if workers and scheduler:
        raise click.UsageError("--workers: expected no --scheduler with it, which has workers of its own")
    with given_scene(scene, run) as loaded, usage_errors():
        check_store(output, resume)
        if plot:
            needed("scipy.stats", "ensemble")  # known to be there before anything runs
        asked = with_runs(loaded, runs)
        with executor_of(workers, scheduler) as executor:
            with planning_bar(asked.name) as bar:
                planned = plan_ensemble(asked, bar)
            try:
                found = run_ensemble(asked, output, executor, resume=resume, planned=planned)
            except KeyboardInterrupt:
                if output:
                    _say_what_is_kept(output)
                raise
        if plot:
            found.plot(plot)
        print_ensemble(planned, found)  # which reads the store
    print_written(output, plot)


def _say_what_is_kept(store: Path) -> None:
    from rbfmu.ensembles.result import kept_runs

    done, runs = kept_runs(store)
    goes_on = "; --resume goes on with them" if done else ""
    click.echo(f"\n{store}: {done:,}{f' of {runs:,}' if runs else ''} runs are kept{goes_on}", err=True)
