"""The command line: the one module above all layers."""

import json
import shlex
from contextlib import AbstractContextManager, nullcontext
from itertools import groupby
from pathlib import Path
from typing import Any

import click

import rbfmu
import rbfmu.cli_output as common
import rbfmu_fmu
from rbfmu.exceptions import SceneError, SceneWarning, named, warn_caller
from rbfmu.on_disk import kept_plan, write_whole
from rbfmu.progress import bar, progress_bar


@click.group(cls=common.Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rbfmu")
def main() -> None:
    """One rigid body: simulate scenes, build and verify their co-simulation units (FMUs).

    Exit status: 0, 1 (a check failed, or a step was refused), 2 (bad usage or a bad scene).
    """


@main.command()
@common.folder_option("rbfmu_demo", "Folder for the FMU, the results and the picture.")
def demo(folder: Path) -> None:
    """Simulate NASA's tumbling brick in three ways, compare them with each other and with NASA, draw it."""
    from rich.console import Console

    from rbfmu_fmu.demo import run_demo

    common.say_where_nothing_is_kept()
    with common.usage_errors(rbfmu_fmu.VerificationError, rbfmu_fmu.BuildError), named(folder):
        passed = run_demo(folder, Console(highlight=False))
    click.get_current_context().exit(0 if passed else 1)


@main.command()
def keys() -> None:
    """List every key of a scene file: unit, default, meaning."""
    from rich import console, markup, table

    from rbfmu.scene.keys import scene_keys

    for name, group in groupby(scene_keys(), lambda key: key.table):
        heads = (markup.escape(f"[{name}]") if name else "", "unit", "default", "meaning")
        # nothing is left out if narrow
        listed = table.Table(*(table.Column(head, overflow="fold") for head in heads), box=None)
        for key in group:
            listed.add_row(key.name, key.unit, markup.escape(key.default), markup.escape(key.meaning))
        console.Console(highlight=False).print(listed)


@main.command()
@click.argument("name")
def new(name: str) -> None:
    """Write a commented scene file NAME.toml to begin with: it runs as it is."""
    from rbfmu.scene.keys import new_scene

    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    common.check_target(path, "NAME", (".toml",))
    rbfmu.Scene._rules["name"].read(path.stem, "NAME")
    if path.exists() or path.is_symlink():  # a link may lead to a file that is not there
        raise click.UsageError(f"{path}: exists already, and stays as it is")
    write_whole(path, new_scene(path.stem).encode())
    shown = f"./{path}" if name.startswith("-") else str(path)  # else it looks like an option
    click.echo(f"{path} (next: rbfmu run {shlex.quote(shown)})")


@main.command("plan", cls=common.SceneCommand, shared=[*common.INPUTS, common.MODEL, *common.RUN_OPTIONS])
@click.option("--json", "as_json", is_flag=True, help="Print model, method, substep, states and reasons as JSON.")
@click.option("--code", is_flag=True, help="Print the kernels that are made from the scene's formulas.")
def show_plan(asked: common.Asked, as_json: bool, code: bool) -> None:
    """Say which model and method a scene gets, and why."""
    given = {"--json": as_json, "--inputs": asked.driven["inputs"], "--model full": asked.model == "full"}
    if code and (idle := next(filter(given.get, given), None)):
        raise click.UsageError(f"--code: expected no {idle} with it, as it prints Python")
    if code:
        with asked.opened() as scene:
            if (formulas := rbfmu.plan(scene).formulas) is None:
                raise SceneError("--code: expected a scene with formulas, inputs of its own or events", scene.name)
            click.echo(formulas.text)
        return
    known = _plan_of(asked, asked.opened())
    for doubt in known["doubts"]:
        warn_caller(doubt, SceneWarning)  # for a plan made just now, they were printed already
    click.echo(json.dumps(known["plan"] | {"variables": known["variables"]}, indent=1) if as_json else known["text"])


def _plan_of(asked: common.Asked, opened: AbstractContextManager["rbfmu.Scene"]) -> dict[str, Any]:
    """Return the plan of a scene, its text and the doubts, as kept on disk; with inputs, they are made and not kept."""
    is_driven = asked.driven["inputs"] is not None

    def make() -> dict[str, Any]:
        from rbfmu.scene.scene import doubts_before
        from rbfmu_fmu.description import sizes

        with opened as scene:
            with bar(f"planning {scene.name}") as tell:
                chosen = rbfmu.plan(scene, full=asked.model == "full", progress=tell, **asked.driven)
            variables, full = sizes(scene, chosen)
            text = common.plan_text(scene, chosen, variables, full, is_driven)
            doubts = [f"{scene.name}: {doubt}" for doubt in doubts_before(scene)]
        return {"plan": chosen.to_dict(), "variables": variables, "text": text, "doubts": doubts}

    return make() if is_driven else kept_plan(asked.file, {"model": asked.model, **asked.run}, make)


@main.command(cls=common.SceneCommand, shared=[*common.INPUTS, common.MODEL, *common.RUN_OPTIONS])
@common.file_option("Save to FILE (.csv, .npz or .aem).", (".csv", ".npz", ".aem"))
@common.plot_option("Draw")
def run(asked: common.Asked, output: Path | None, plot: Path | None) -> None:
    """Simulate a scene, its ports at zero or driven by a file.

    The units of the columns of FILE.csv are written to FILE.units.csv, events to FILE.events.csv.
    """
    from rbfmu.result import check_attitude

    with asked.opened() as scene:
        with common.usage_errors():
            check_attitude(output, scene.outputs.quantities)
            asked = asked.with_inputs(scene)
        planned = rbfmu.Plan.from_dict(_plan_of(asked, nullcontext(scene))["plan"]).of_scene(scene)
        result = rbfmu.simulate(scene, planned=planned, progress=progress_bar(scene.name), **asked.driven)
    common.write(result, output, plot, scene.name)
    common.print_end(scene, planned, result, asked.driven["inputs"] is not None)
    beside = [".units.csv", *([".events.csv"] if result.events else [])] if output and output.suffix == ".csv" else []
    common.print_written(output, *(output.with_suffix(ending) for ending in beside if output), plot)


@main.command()
@click.argument("scenes", metavar="SCENE...", nargs=-1, required=True, type=common.PATH)
def warm(scenes: tuple[Path, ...]) -> None:
    """Plan and compile scenes beforehand, for all processes that share the cache."""
    from rbfmu.ensembles.running import warm as warm_scene
    from rbfmu_kernels.compile.tiered import in_haste

    if not common.keeps_code():
        raise click.ClickException(common.NOT_KEPT)
    for asked in map(common.Asked, scenes):
        with asked.opened() as scene, common.usage_errors():
            planned = rbfmu.Plan.from_dict(_plan_of(asked, nullcontext(scene))["plan"])
            with in_haste():
                warm_scene(scene, planned)


@main.command(cls=common.SceneCommand, shared=[*common.INPUTS, *common.RUN_OPTIONS])
@common.file_option("Store the runs in STORE (.npz or .zarr).", (".npz", ".zarr"), metavar="STORE", type=common.PATH)
@click.option("--runs", type=click.IntRange(1), help="Replaces the scene's ensemble.runs.")
@click.option("--workers", type=click.IntRange(1), help="Number of threads.  [one for each processor]")
@click.option("--scheduler", metavar="ADDRESS", help="Run on Dask, whose scheduler is at HOST:PORT, not on threads.")
@click.option("--resume", is_flag=True, help="Continue an existing STORE.")
@common.plot_option("Draw")
def ensemble(
    asked: common.Asked, output: Path | None, runs: int | None, workers: int | None, scheduler: str | None,
    resume: bool, plot: Path | None,
) -> None:  # fmt: skip
    """Run a scene many times, with the numbers that its table [ensemble] varies.

    A run has the same numbers on any number of workers, in one go or resumed.
    """
    from rbfmu.ensembles import members, planning, result, running

    if workers and scheduler:
        raise click.UsageError("--workers: expected no --scheduler with it, which has workers of its own")
    if resume and output is None:
        raise click.UsageError("--resume: expected --output with the store to go on with")
    with asked.opened() as loaded, common.usage_errors():
        running.check_store(output, resume)
        scene = members.for_ends(members.with_runs(loaded, runs))
        with running.dask_client(scheduler) if scheduler else nullcontext(workers) as executor:
            with bar(f"planning {scene.name}") as tell:
                planned = planning.plan_ensemble(scene, tell)
            try:
                found = rbfmu.run_ensemble(scene, output, executor, resume=resume, planned=planned, **asked.driven)
            except KeyboardInterrupt:
                if output:
                    done, of_runs = result.kept_runs(output)
                    kept = f"{done:,}{f' of {of_runs:,}' if of_runs else ''} runs are kept"
                    click.echo(f"\n{output}: {kept}{'; --resume goes on with them' * bool(done)}", err=True)
                raise
        if plot:
            found.plot(plot)
        common.print_ensemble(planned, found)  # this reads the store
    common.print_written(output, plot)


@main.command("sensitivity", cls=common.SceneCommand, shared=[*common.INPUTS, *common.RUN_OPTIONS])
@common.keys_option("--by", "Key to vary, such as initial.omega_b; more keys may follow.")
@common.more_keys
@common.file_option("Save to FILE (.csv or .npz).", (".csv", ".npz"))
@common.plot_option("Draw what matters when")
def show_sensitivity(
    asked: common.Asked, by: tuple[str, ...], more: tuple[str, ...], output: Path | None, plot: Path | None
) -> None:
    """Print, save or draw how a scene's outputs depend on its numbers: derivatives along the motion."""
    with asked.opened() as scene, common.usage_errors():
        found = rbfmu.sensitivity(scene, (*by, *more), **asked.driven)
        common.write(found, output, plot, scene.name)
    changes = [found.changes(name) for name in found.of]
    rows = [(key, *(f"{of[key].max():.3g}" for of in changes)) for key in found.keys]
    common.print_columns([("1 % of", *found.of), *rows])
    for key, at in found.keys.items():
        if not found.sizes[at].any() and not key.startswith("initial.attitude"):
            click.echo(f"{key} is zero: changed by 0.01, not by 1 %")
    common.print_written(output, plot)


@main.command("fit", cls=common.SceneCommand, shared=common.INPUTS)
@click.argument("data", metavar="DATA", type=common.PATH)
@common.keys_option("--free", "Key to fit, such as body.inertia; more keys may follow.")
@common.more_keys
@click.option(
    "--sigma", metavar="NUMBER|FILE",
    help="Noise: a number, or a CSV file with a column for each output; for quaternion, that of a small turn (rad).",
)  # fmt: skip
@common.one_of("--loss", ["linear", "soft_l1", "huber", "cauchy"], "Loss function; all but linear tolerate outliers.")
@common.file_option("Write the fitted scene to FILE.toml.", (".toml",))
@common.plot_option("Draw residuals")
def fit_scene(
    asked: common.Asked, data: Path, free: tuple[str, ...], more: tuple[str, ...], sigma: str | None, loss: str,
    output: Path | None, plot: Path | None,
) -> None:  # fmt: skip
    """Fit numbers of a scene to measured motion: rates, attitudes or any outputs, with gaps.

    Exit status 1 where residuals do not look like noise.
    """
    from rbfmu.identification.measured import sigma_of

    with asked.opened() as scene, common.usage_errors():
        noise = None if sigma is None else sigma_of(sigma)
        found = rbfmu.fit(scene, data, (*free, *more), noise, loss, **asked.driven)
        if output:
            found.save(output, asked.file)
        if plot:
            found.plot(plot)
    common.print_fit(found)
    common.print_written(output, plot)
    click.get_current_context().exit(1 if found.doubts else 0)


@main.command()
@click.argument("source", metavar="SCENE|RESULT", type=common.PATH)
@common.file_option("Page to write; replaces an existing one.  [motion.html, if there is none]", (".html",))
@click.option("--scene", type=common.PATH, help="Scene whose body a RESULT (.csv, .npz, .aem) moves.")
@click.option("--stop", type=float, help="End of what is shown (s).")
@click.option("--ghosts", type=click.IntRange(0), default=0, metavar="N",
              help="Show N runs of the scene's ensemble as pale bodies.")  # fmt: skip
def view(source: Path, output: Path | None, **shown: Any) -> None:
    """Write a page that plays a motion in 3D, in any browser and without network.

    A SCENE is simulated; a RESULT is shown as it is.
    """
    common.check_interpolate(shown["inputs"], shown["interpolate"])
    target = output or Path("motion.html")
    if output is None and target.exists():
        raise click.UsageError(f"{target}: exists already, and stays as it is; -o {target} writes over it")
    common.say_where_nothing_is_kept()
    with common.usage_errors(), bar(f"planning {source.stem}") as tell:
        motion = rbfmu.view(source, target, progress=tell, **shown)
    size = target.stat().st_size / 1e6
    click.echo(f"{target}: {size:.1f} MB, {len(motion.result.time)} pictures, played in {motion.played:.3g} s")


view.params += common.INPUTS  # for a SCENE, after its own


@main.command(cls=common.SceneCommand, shared=[common.MODEL, *common.RUN_OPTIONS])
@common.file_option("FMU to write.  [NAME.fmu]", (".fmu",))
@click.option("--native", is_flag=True, help="Compiled: the importer needs no Python.")
@click.option("--platform", default="", metavar="NAME,...",
              help="Native platforms: linux64, win64, darwin64, linux-aarch64, darwin-aarch64, or all.")  # fmt: skip
@common.one_of("--fmi", ["2", "3"], "Version of FMI: 2.0, or 3.0 with arrays as variables; 3 needs --native.")
@click.option("--scalars", is_flag=True, help="FMI 3.0 without arrays, for importers that cannot take them.")
@click.option("--terminals", is_flag=True, help="List terminals in FMI 2.0 too, at which some importers fail.")
def build(
    asked: common.Asked, output: Path | None, native: bool, platform: str, fmi: str, scalars: bool, terminals: bool
) -> None:
    """Build a scene's FMU for co-simulation (FMI 2.0, pythonfmu or native; FMI 3.0, native)."""
    from rbfmu_fmu.description import file_name
    from rbfmu_fmu.native.platforms import platforms_named, takes_minutes

    platforms, kind = [name.strip() for name in platform.split(",") if name.strip()], "native" if native else "python"
    if not native and (option := "--platform" if platforms else "--fmi 3" if fmi == "3" else ""):
        raise click.UsageError(f"{option}: expected --native with it")
    if scalars and fmi != "3":
        raise click.UsageError("--scalars: expected --fmi 3 with it")
    with common.usage_errors(rbfmu_fmu.BuildError), asked.opened() as scene:
        if slow := [target.name for target in platforms_named(platforms) if takes_minutes(target)]:
            why = "the first time takes minutes, as ziglang builds the platform's C library"
            click.echo(f"Note: compiling for {', '.join(slow)}: {why}", err=True)
        path = output or Path(file_name(scene.name))
        planned = rbfmu.Plan.from_dict(_plan_of(asked, nullcontext(scene))["plan"])
        version: dict[str, Any] = {"fmi": int(fmi), "scalars": scalars, "terminals": terminals}
        click.echo(rbfmu_fmu.build(scene, path, kind, platforms, **version, planned=planned))


@main.command()
@click.argument("fmu", metavar="FILE.fmu", type=common.PATH)
@click.option("--seed", default=1, show_default=True, help="Seed of the signal that drives the inputs.")
def verify(fmu: Path, seed: int) -> None:
    """Compare an FMU with direct calls of its kernels, bit by bit, and validate it."""
    common.say_where_nothing_is_kept()
    with common.usage_errors(rbfmu_fmu.VerificationError):
        found = rbfmu_fmu.verify(fmu, seed)
    rows = [(name, found.units[name], repr(difference)) for name, difference in found.differences.items()]
    common.print_columns([("output", "unit", "largest difference from the kernels"), *rows])
    click.echo(f"{found.steps_done} of {found.steps_asked} steps done; inputs from seed {found.seed}")
    click.echo(f"planned and full model differ by {found.to_full:.1e}, accuracy asked {found.accuracy:g}")
    click.echo("\n".join([*(f"problem: {text}" for text in found.problems), "passed" if found.passed else "FAILED"]))
    click.get_current_context().exit(0 if found.passed else 1)


@main.command()
@click.argument("scene", metavar="[SCENE]", required=False, type=common.PATH)
@common.folder_option("rbfmu_chart", "Folder for the tables and pictures.")
@click.option("--quick", is_flag=True, help="Only a few cases and methods, to see that it runs.")
@common.method_option
def chart(scene: Path | None, folder: Path, quick: bool, method: Path | None) -> None:
    """Chart accuracy against cost: which method to use, here and with the peers that are installed.

    Charts SCENE with its ports at zero or, without SCENE, eight motions and a loop closed through an FMU.
    """
    from rbfmu.studies.chart import run_charts
    from rbfmu_fmu.cosimulation_chart import run_cosimulation_chart

    with common.usage_errors(), bar("chart") as progress, named(folder):
        if scene is not None:
            paths = rbfmu.chart(scene, quick, progress, method).save(folder)
        else:
            paths = run_charts(folder, quick, progress, method) + run_cosimulation_chart(folder, quick, progress)
    click.echo("\n".join(map(str, paths)))
    click.echo(next(path for path in paths if path.suffix == ".txt").read_text(encoding="utf-8"))


@main.command()
@common.folder_option("rbfmu_stability", "Folder for the tables and pictures.")
@click.option("--quick", is_flag=True, help="Coarse and fast, to see that it runs.")
@common.method_option
def stability(folder: Path, quick: bool, method: Path | None) -> None:
    """Measure where methods fail, against the laws that predict it; draw it."""
    from rbfmu.studies.stability import OWN, print_laws, run_stability

    with common.usage_errors(), named(folder):
        findings, paths = run_stability(folder, quick, progress_bar("stability"), method)
    print_laws(findings)
    wrong = [f for f in findings if not f.holds]
    count = sum(f.kind != OWN for f in findings)
    click.echo(f"\n{count - len(wrong)} of {count} findings hold; {len(paths)} files in {folder}")
    for f in wrong:
        click.echo(f"does not hold: {f}")
    click.get_current_context().exit(1 if wrong else 0)
