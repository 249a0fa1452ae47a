"""What several commands share: options, and the output of errors, warnings, notes and tables.

Rich is imported only where it draws, as importing it takes a tenth of a short run.
"""

import math
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import click

import rbfmu
from rbfmu.exceptions import PlanningWarning, SceneError, SceneWarning, SimulationError
from rbfmu.on_disk import try_replacing

MOST_SHOWN = 5
"""The largest number of times of an event, and of messages of failed runs, that are printed."""
UNREAD = 141
"""The exit status if a reader such as `head` stops early: 128 plus the number of SIGPIPE, as shells expect."""
DOUBTS = (SceneWarning, PlanningWarning)
"""Warnings that commands print as lines."""


class Commands(click.Group):
    """Commands that print users' errors as messages, with exit status 2, and warnings as lines."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command, and print its errors and warnings as messages."""
        with errors_in_messages(), doubts_in_lines():
            return super().invoke(ctx)

    def make_context(self, *args: Any, **more: Any) -> click.Context:
        """Read the arguments, and print help if it is asked for."""
        with errors_in_messages():
            return super().make_context(*args, **more)


@contextmanager
def errors_in_messages() -> Iterator[None]:
    """Print users' errors as messages; exit status 1 for SimulationError, UNREAD without a reader, else 2."""
    status = 2
    try:
        yield
        return
    except SceneError as error:
        click.echo(f"Error: {error}" if len(error.faults) == 1 else f"Errors:\n{error}", err=True)
    except SimulationError as error:
        click.echo(f"Error: {error}", err=True)
        status = 1
    except MemoryError as error:
        expected = "expected a longer run.step, or fewer runs, that need less"
        click.echo(f"Error: memory: {error or 'there is no more'}: {expected}", err=True)
    except (BrokenPipeError, SystemExit) as error:
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):  # as Rich raises
            raise
        _write_nowhere(sys.stdout, sys.stderr)
        status = UNREAD
    except OSError as error:
        click.echo(f"Error: {error.filename or _unnamed_target()}: {error.strerror or error}", err=True)
        try:
            sys.stdout.flush()
        except OSError:
            _write_nowhere(sys.stdout)
    raise click.exceptions.Exit(status)


def _write_nowhere(*streams: Any) -> None:
    """Send all further output to nowhere; else Python would fail once more when it flushes its streams at the end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in filter(None, streams):  # a stream that was closed at the start is None
        os.dup2(nowhere, stream.fileno())


def _unnamed_target() -> str:
    """Return in words what an OSError without a file name is about."""
    try:
        os.getcwd()
    except OSError:
        return "the working folder, which is gone"
    return "standard output or a file"


@contextmanager
def doubts_in_lines() -> Iterator[None]:
    """Print each warning of DOUBTS as one line, and only once."""
    with warnings.catch_warnings():
        for kind in DOUBTS:
            warnings.simplefilter("always", kind)
        show, printed = warnings.showwarning, set[str]()

        def in_a_line(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if not issubclass(category, DOUBTS):
                show(message, category, *place, **more)
            elif str(message) not in printed:
                printed.add(str(message))
                with suppress(OSError):  # stderr may be a file on a full disk
                    click.echo(f"Warning: {message}", err=True)

        warnings.showwarning = in_a_line
        yield


@contextmanager
def usage_errors(*kinds: type[Exception]) -> Iterator[None]:
    """Turn these errors into usage errors; by default those of a wrong argument and of a missing package."""
    refused = kinds or (ValueError, ModuleNotFoundError)
    try:
        yield
    except SceneError:
        raise
    except refused as error:
        raise click.UsageError(str(error)) from None


NOT_KEPT = (
    "compiled code cannot be kept here, so every start compiles for seconds: "
    "set NUMBA_CACHE_DIR to a folder that can be written"
)


def keeps_code() -> bool:
    """Return whether Numba has a folder in which it can keep compiled code."""
    from rbfmu_kernels import rotate

    return not hasattr(rotate, "stats") or rotate.stats.cache_path is not None


def say_where_nothing_is_kept() -> None:
    """Print a note if Numba has no folder in which it can keep compiled code."""
    if not keeps_code():
        click.echo(f"Note: {NOT_KEPT}", err=True)


def check_target(path: Path, option: str, endings: Sequence[str]) -> None:
    """Raise an error for a file that cannot be written, before anything runs."""
    if path.suffix not in endings or not path.stem.strip("."):
        raise click.UsageError(f"{option} {str(path)!r}: expected a name that ends in {' or '.join(endings)}")
    if not path.parent.is_dir():
        raise click.UsageError(f"{option} {str(path)!r}: there is no folder {str(path.parent)!r}")
    try_replacing(path)


def expected_error(scene: "rbfmu.Scene", planned: "rbfmu.Plan", driven: bool) -> str:
    """Return the error that a plan expects, in words, and for which inputs and parameters, if these may vary."""
    of_run = ["the inputs given" if driven else scene.inputs.at_start] * bool(scene.inputs.ports)
    of_run += ["the scene's parameters"] * bool(scene.inputs.parameters)
    return f"expected: error {planned.error:.1e}" + (f" with {' and '.join(of_run)}" if of_run else "")


def plan_text(scene: "rbfmu.Scene", chosen: "rbfmu.Plan", variables: int, full: tuple[int, int], driven: bool) -> str:
    """Return a plan as text.

    variables: the number in its FMU; full: the numbers of states and variables of the full model; driven: whether
    inputs are given.
    """
    from rbfmu.planning.methods import MACHINE

    cost = f"about {float(f'{chosen.cost:.2g}'):,.0f} ns a step of {scene.run.step:g} s on {MACHINE}"
    lines = [f"{chosen.model}: {chosen.method}", f"{expected_error(scene, chosen, driven)}, {cost}", *chosen.reasons]
    against = f", against {full[0]} and {full[1]} of the full model"
    beside = f"; the whole body has {full[0]} states" if scene.has_formulas else against
    states = f"{chosen.states} state{'s' * (chosen.states != 1)}"
    return "\n".join([*lines, f"{states} and {variables} FMU variables{beside}"])


def print_end(scene: "rbfmu.Scene", planned: "rbfmu.Plan", result: "rbfmu.Result", driven: bool) -> None:
    """Print the model and its method, the reasons for them, the error to expect, the last values, and the events."""
    if scene.inputs.ports:  # inputs are known over the run, so there is no loop whose delay the plan must name
        from rbfmu.planning.select import without_loops

        planned = without_loops(scene, planned)
    error = f"{expected_error(scene, planned, driven)}, accuracy asked {scene.run.accuracy:g}"
    click.echo("\n".join([f"{planned.model}: {planned.method}", error, *planned.reasons]))
    last = {name: " ".join(f"{x: .8g}" for x in values[-1:].ravel()) for name, values in result.quantities.items()}
    rows = [(name, result.units[name], numbers) for name, numbers in last.items()]
    print_columns([("at the end", "unit", f"t = {scene.run.text_of(result.time[-1])} s"), *rows])
    if result.events:
        print_columns([("event", "times", "at t (s)"), *_events(scene, result)])


def print_fit(found: "rbfmu.Fit") -> None:
    """Print the fitted numbers with standard errors, what the data leave open, and whether residuals are noise."""
    from rbfmu.identification.noise import are_too_few, trends

    numbers = zip(found.names, found.values, found.standard_errors, strict=True)
    rows = [(n, f"{x: .8g}", f"{error:.2g}") if error < math.inf else (n, " not told", "") for n, x, error in numbers]
    print_columns([("number", "value", "standard error"), *rows])
    noise = (f"{'attitude' if name == 'quaternion' else name} {size:.3g}" for name, size in found.sigma.items())
    click.echo(f"noise: {', '.join(noise)}")
    small = "residuals follow each other, but are within the scene's accuracy"
    well = small if trends(found.residuals) else "residuals look like noise"
    if are_too_few(found.residuals):
        well = "rows are too few to tell whether residuals are noise"
    click.echo("\n".join([*found.unknown, *(found.doubts or (well,))]))


def _events(scene: "rbfmu.Scene", result: "rbfmu.Result") -> Iterator[tuple[str, str, str]]:
    """Yield a row for each event, and one for its touches if there are any, with the first of the times."""
    touched = {f"{name}, touches": times for name, times in result.touches.items() if len(times)}
    for name, times in (result.events | touched).items():
        shown = " ".join(scene.run.text_of(t, 9) for t in times[:MOST_SHOWN])
        yield name, f"{len(times)}", shown + (" ..." if len(times) > MOST_SHOWN else "")


def write(found: "rbfmu.Result | rbfmu.Sensitivity", output: Path | None, plot: Path | None, title: str) -> None:
    """Save and draw a result, if this is asked for."""
    if output:
        found.save(output)
    if plot:
        found.plot(plot, title)


def print_written(*paths: Path | None) -> None:
    """Print the paths of the files that were written, if any."""
    if written := ", ".join(str(path) for path in paths if path):
        click.echo(f"written: {written}")


def print_ensemble(planned: "rbfmu.Plan", result: "rbfmu.EnsembleResult") -> None:
    """Print the model, the failed runs, the mean and standard deviation of the runs at their end, and the events."""
    click.echo("\n".join([f"{planned.model}: {planned.method}", *planned.reasons]))
    redrawn = int((result.redrawn > 0).sum())
    click.echo(f"{result.runs:,} runs, {len(result.failed):,} of them failed, {redrawn:,} drawn again")
    for index, text in [*result.failed.items()][:MOST_SHOWN]:
        click.echo(f"run {index}: {text}")
    text_of = result.scene.run.text_of
    ends = {name: [" ".join(f"{x: .6g}" for x in values) for values in result.at_end(name)] for name in result.rows}
    rows = [(name, result.rows[name].unit, *words) for name, words in ends.items()]
    print_columns([(f"at t = {text_of(result.time[-1])} s", "unit", "mean", "standard deviation"), *rows])
    for name in result.counts:
        times = result.first_of(name)
        deviation = times.std(ddof=1) if len(times) > 1 else math.nan  # as of all others
        mean = text_of(times.mean()) if len(times) else ""
        first = f"; first times: mean {mean} s, standard deviation {deviation:.3g} s" if mean else ""
        click.echo(f"{name}: in {len(times):,} of {len(result.good):,} runs{first}")


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Print rows of equal length in columns; lines are not wrapped, so that numbers stay whole."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        click.echo("  ".join(map(str.ljust, row, widths)).rstrip())


PATH = click.Path(path_type=Path)
PICTURES = (".png", ".svg", ".pdf")
Option = Callable[[Callable[..., None]], Callable[..., None]]
more_keys: Option = click.argument("more", metavar="[KEY]...", nargs=-1)
"""Further keys after an option that has the first of them."""
method_option: Option = click.option(
    "--method", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FILE.py",
    help="Add your own method: step(q, omega, h, body, loads) in FILE.",
)  # fmt: skip


def choice(known: Sequence[str], text: str) -> dict[str, Any]:
    """Return the arguments of an option that is a choice; its default is the first."""
    return {"type": click.Choice(known), "default": known[0], "show_default": True, "help": text}


def one_of(option: str, known: Sequence[str], text: str) -> Option:
    """Return an option that is a choice; its default is the first."""
    return click.option(option, **choice(known, text))


_INPUTS = "File that drives the ports: columns time, torque_b[1], ...  [ports at zero]"
_MODELS = choice(["planned", "full"], "The smallest model that serves the scene, or all degrees of freedom.")
INPUTS = [
    click.Option(["--inputs"], type=PATH, metavar="FILE.csv", help=_INPUTS),
    click.Option(["--interpolate"], **choice(["hold", "linear"], "What inputs do between the rows of --inputs.")),
]
MODEL = click.Option(["--model"], **_MODELS)
RUN = {"accuracy": "", "stop": " (s)", "step": " (s)"}
"""The keys of a scene's table [run] that options can replace, with their units."""
RUN_OPTIONS = [
    click.Option([f"--{key}"], type=float, help=f"Replaces the scene's run.{key}{unit}.") for key, unit in RUN.items()
]


@dataclass(frozen=True)
class Asked:
    """A scene file, and what a command asks for besides.

    run: values that replace those in its table [run]; driven: what drives the ports, as keyword arguments of `plan` and
    `simulate`.
    """

    file: Path
    run: dict[str, float | None] = field(default_factory=lambda: dict.fromkeys(RUN))
    model: str = "planned"
    driven: Mapping[str, Any] = field(default_factory=lambda: {"inputs": None, "interpolate": "hold"})

    @contextmanager
    def opened(self) -> Iterator["rbfmu.Scene"]:
        """Yield the scene with the options given; errors inside name the file."""
        from rbfmu.scene.scene import faults_of, load_scene

        say_where_nothing_is_kept()
        given = {key: value for key, value in self.run.items() if value is not None}
        options = " and ".join(f"--{key} {value!r}" for key, value in given.items())
        loaded = load_scene(self.file)
        with faults_of(f"{self.file} with {options}" if options else str(self.file)):
            yield loaded.replace(run=given)

    def with_inputs(self, scene: "rbfmu.Scene") -> "Asked":
        """Return a copy with the inputs already read, since a pipe can be read only once."""
        from rbfmu.runs.inputs import input_tables

        read = self.driven["inputs"] and input_tables(scene, **self.driven)
        return replace(self, driven={**self.driven, "inputs": read})


def check_interpolate(inputs: Path | None, interpolate: str) -> None:
    """Raise UsageError for an interpolation without inputs."""
    if interpolate != "hold" and inputs is None:
        raise click.UsageError(f"--interpolate {interpolate}: expected --inputs beside it")


class SceneCommand(click.Command):
    """A command on a scene file; its function gets the file and the shared options as one argument, an `Asked`.

    shared: the options that several commands have, listed after its own.
    """

    def __init__(self, params: list[click.Parameter], shared: Sequence[click.Parameter], **others: Any) -> None:
        super().__init__(params=[click.Argument(["scene"], metavar="SCENE", type=PATH), *params, *shared], **others)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        given = ctx.params
        run = {key: given.pop(key) for key in [*given] if key in RUN}  # as they were typed
        read, written, interpolate = given.pop("inputs", None), given.get("output"), given.pop("interpolate", "hold")
        check_interpolate(read, interpolate)
        if read and written and read.exists() and written.exists() and read.samefile(written):
            raise click.UsageError(f"--output {str(written)!r}: expected another file than that of --inputs")
        driven = {"inputs": read, "interpolate": interpolate}
        given["asked"] = Asked(given.pop("scene"), run, given.pop("model", "planned"), driven)
        return super().invoke(ctx)


def file_option(text: str, endings: Sequence[str], *names: str, **more: Any) -> Option:
    """Return the option of a file to write, by default --output; a file that cannot be written is refused at once."""

    def checked(_: click.Context, option: click.Parameter, path: Path | None) -> Path | None:
        if path is not None:
            check_target(path, option.opts[-1], endings)
        return path

    kind = {"type": click.Path(dir_okay=False, path_type=Path), "callback": checked, **more}
    return click.option(*(names or ("-o", "--output")), help=text, **kind)


def plot_option(text: str) -> Option:
    """Return the option for a picture to draw."""
    return file_option(f"{text} to FILE (.png, .svg or .pdf).", PICTURES, "--plot")


def folder_option(default: str, text: str) -> Option:
    """Return the option for the folder that a command writes."""
    kind = click.Path(file_okay=False, path_type=Path)
    return click.option("-o", "--output", "folder", type=kind, default=Path(default), show_default=True, help=text)


def keys_option(option: str, text: str) -> Option:
    """Return the option for keys, which `more_keys` may follow."""
    return click.option(option, multiple=True, required=True, metavar="KEY", help=text)
