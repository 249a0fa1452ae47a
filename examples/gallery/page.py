"""The gallery: draws each scene of examples/scenes and writes their page, with what `rbfmu plan` says, word for word.

`python -m examples.gallery.page [NAME ...]` draws the pictures named (all: none named) and writes the page. What the
scenes cost stands there as `python -m examples.pages --measure gallery_cost` has measured it.
"""

import argparse
from collections.abc import Iterable
from pathlib import Path
from statistics import median

import matplotlib as mpl
from click.testing import CliRunner

import rbfmu
from examples.figures import record
from examples.gallery import formulas
from examples.gallery.axes import save
from examples.gallery.pictures import PICTURES
from rbfmu.cli import main as command_line

SCENES = Path(__file__).parents[1] / "scenes"
FOLDER = Path(__file__).parents[1] / "pictures"
PAGE, FORMULAS_PAGE = SCENES / "README.md", SCENES / "formulas" / "README.md"
DRAWN = {**PICTURES, **formulas.PICTURES}
HEAD = """# Gallery

These scenes are in the order of their models, from the smallest to the largest. Each section says what the picture
shows, why no smaller model is valid, and what `rbfmu plan` prints. `python -m examples.gallery.page` writes this page
and its pictures.

| scene | model | size |
|---|---|---|
"""
FORMULAS_HEAD = """# Gallery of formulas

In these scenes, loads, states and outputs are [formulas](../../../rbfmu/README.md#formulas), as text. Each section
says what the picture shows, what is integrated for it, and what `rbfmu plan` prints. `python -m examples.gallery.page`
writes this page and its pictures.

| scene | model | size |
|---|---|---|
"""
COSTS = """## What they cost

![Cost and error of the planned model, the full one and MuJoCo](../pictures/gallery_cost.png)

The table gives the processor time of a communication step in a compiled loop, in ns, for three models:
- the planned model;
- the full model: six degrees of freedom, all outputs, the cheapest integrator of a body under any loads;
- MuJoCo, with the cheapest integrator and step that meet the accuracy.

Ratios ("times") are to the planned model. Errors are the largest in the scene's quantities, against 40 digits, at five
times of the run. Ports are at zero. Prescribed rates have no full model, and MuJoCo cannot model them.
{verdict}

| scene | planned | full | MuJoCo | full, times | MuJoCo, times | error | error, full | error, MuJoCo | asked |
|---|---|---|---|---|---|---|---|---|---|
{table}

Measured by `python -m examples.benchmarks.gallery`: {machine}."""


def scene_file(name: str) -> Path:
    """Return the scene's file."""
    return (FORMULAS_PAGE.parent if name in formulas.PICTURES else SCENES) / f"{name}.toml"


def paragraphs(name: str) -> list[str]:
    """Return the comment at the head of a scene's file: its title, and its paragraphs, each in lines as written."""
    lines = scene_file(name).read_text(encoding="utf-8").splitlines()
    end = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    return "\n".join(line.removeprefix("#").strip() for line in lines[:end]).split("\n\n")


def plan_text(name: str) -> str:
    """Return what `rbfmu plan` prints."""
    done = CliRunner().invoke(command_line, ["plan", str(scene_file(name))], catch_exceptions=False)
    if done.exit_code != 0:
        raise RuntimeError(f"{name}: {done.output}")
    return done.stdout.rstrip()


def costs() -> str:
    """Return the section on what scenes cost, from the figures beside the pictures."""
    machine, rows = record.read("gallery_cost")
    cells = {(row["scene"], row["who"]): row for row in rows}
    table = []
    for name in dict.fromkeys(row["scene"] for row in rows):
        found = [cells.get((name, who)) for who in ("planned", "full", "MuJoCo")]
        cost = [f"{float(row['cost']):.0f}" if row else "" for row in found]
        times = [f"{float(row['ratio']):.3g}" if row else "" for row in found[1:]]
        errors = [f"{float(row['error']):.0e}" if row else "" for row in found]
        table.append(f"| {' | '.join((name, *cost, *times, *errors, found[0]['accuracy']))} |")
    ratios = sorted(float(row["ratio"]) for row in rows if row["who"] == "full")
    verdict = f"The full model costs {median(ratios):.2g} times as much on the median scene, {ratios[0]:.3g} at least."
    return COSTS.format(table="\n".join(table), machine="; ".join(machine), verdict=verdict)


def page() -> str:
    """Return the page's text, in Markdown."""
    return HEAD + _scenes(PICTURES, "..") + "\n\n" + costs() + "\n"


def formulas_page() -> str:
    """Return the text of the page of scenes with formulas."""
    return FORMULAS_HEAD + _scenes(formulas.PICTURES, "../..") + "\n"


def _scenes(names: Iterable[str], above: str) -> str:
    table, sections = [], []
    for name in names:
        (title, *texts), plan = paragraphs(name), plan_text(name)
        model, *reasons = plan.splitlines()
        size = next(line for line in reasons if "FMU variables" in line)
        table.append(f"| [{title}](#{name}) | {model} | {size} |")
        picture = f"![{title}]({above}/pictures/{name}.png)"
        told = f"```\n$ rbfmu plan {name}.toml\n{plan}\n```"
        sections.append("\n\n".join((f'<a id="{name}"></a>\n## {title}', picture, *texts, told)))
    return "\n".join(table) + "\n\n" + "\n\n".join(sections)


def draw(name: str) -> Path:
    """Return the scene's picture."""
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{name}.png"
    save(DRAWN[name](rbfmu.load_scene(scene_file(name))), path)
    return path


def main() -> None:
    """Draw and write."""
    parser = argparse.ArgumentParser(description="Draw the gallery's pictures and write its page.")
    parser.add_argument("names", nargs="*", metavar="name", help="scenes to draw; default all")
    names = parser.parse_args().names
    if unknown := set(names) - set(DRAWN):
        parser.error(f"names = {sorted(unknown)}: expected of {', '.join(DRAWN)}")
    mpl.use("agg")
    for name in names or DRAWN:
        path = draw(name)
        print(f"{path}: {path.stat().st_size / 1024:.0f} kB")
    for path, text in ((PAGE, page()), (FORMULAS_PAGE, formulas_page())):
        path.write_text(text, encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()
