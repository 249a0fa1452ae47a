"""For simulators that are not tried here, Simulink and Dymola: what to run there, and how to read what came of it.

`python -m examples.interop.elsewhere prepare FOLDER` writes native.fmu, expected.csv and a script for each simulator.
Run a script there, in that folder; it writes result.csv. `python -m examples.interop.elsewhere compare FOLDER` says how
far it is off. Nobody has run the scripts yet: what they need changed belongs into the form, FORM.md, as well.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from examples.interop.importers import table
from examples.interop.run import STEP, STEPS, build, by_kernels, scene_to_try
from rbfmu.planning.select import plan
from rbfmu_fmu.description import describe

SIMULINK = f"""% In MATLAB with Simulink, in this folder: interop_simulink
model = 'interop_model';
new_system(model);
add_block('simulink_extras/FMU Import/FMU', [model '/it']);
set_param([model '/it'], 'FMUName', fullfile(pwd, 'native.fmu'));
set_param(model, 'Solver', 'FixedStepDiscrete', 'FixedStep', '{STEP}', 'StopTime', '{STEP * STEPS}');
ports = get_param([model '/it'], 'PortHandles');
for k = 1:numel(ports.Outport)
    set_param(ports.Outport(k), 'DataLogging', 'on');
end
out = sim(model);
signals = out.logsout;
values = signals{{1}}.Values.Time;
names = {{'time'}};
for k = 1:signals.numElements
    values = [values squeeze(signals{{k}}.Values.Data)];
    names{{end + 1}} = signals{{k}}.Name;
end
file = fopen('result.csv', 'w');
fprintf(file, '"%s"', names{{1}});
fprintf(file, ',"%s"', names{{2:end}});
fprintf(file, '\\n');
fclose(file);
dlmwrite('result.csv', values, '-append', 'precision', '%.17g');
"""
DYMOLA = f"""// In Dymola, in this folder: RunScript("interop_dymola.mos")
importFMU("native.fmu", true, false, false);
simulateModel("controlled_satellite_fmu", stopTime={STEP * STEPS}, outputInterval={STEP}, resultFile="result");
DataFiles.convertMATtoCSVfile("result.mat", {{"Time"}}, "result.csv");
"""
FORM = """| question | answer |
| --- | --- |
| simulator and its version | |
| operating system | |
| does native.fmu import, with which messages | |
| are inputs, outputs, parameters and units shown | |
| does the script run as it is; if not, what had to be changed | |
| what `compare` printed | |
| does a parameter that the scene does not list give a message that can be read | |
"""


def prepare(folder: Path) -> None:
    """Write what a user takes along."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = scene_to_try()
    build(scene, folder, "native")
    rows = by_kernels(scene, {})
    with open(folder / "expected.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *_outputs()])
        writer.writerows([repr((k + 1) * STEP), *map(repr, row)] for k, row in enumerate(rows.tolist()))
    for name, text in (("interop_simulink.m", SIMULINK), ("interop_dymola.mos", DYMOLA), ("FORM.md", FORM)):
        (folder / name).write_text(text)


def compare(folder: Path) -> float:
    """Print the largest difference of result.csv to the kernels at the times of expected.csv; return it."""
    names = ["time", *_outputs()]
    expected = np.loadtxt(folder / "expected.csv", delimiter=",", skiprows=1)
    found = np.array(table(folder / "result.csv", names))
    last = {round(row[0] / STEP): row for row in found}  # of several rows for a time, the last
    missing = [time for time in expected[:, 0] if round(time / STEP) not in last]
    if missing:
        sys.exit(f"no row for t = {missing[0]} s")
    differences = np.abs(np.array([last[k + 1] for k in range(len(expected))]) - expected)
    largest = float(np.max(differences))
    print(f"{len(expected)} steps; largest difference {largest}, of {names[int(np.argmax(differences.max(axis=0)))]}")
    return largest


def _outputs() -> list[str]:
    scene = scene_to_try()
    return [v.name for v in describe(scene, plan(scene)).variables if v.causality == "output"]


def main(words: list[str]) -> None:
    """Do what is asked, or say what is missing."""
    commands = {"prepare": prepare, "compare": compare}
    if len(words) != 2 or words[0] not in commands:
        sys.exit(f"expected {' or '.join(commands)}, and a folder")
    try:
        commands[words[0]](Path(words[1]))
    except FileNotFoundError as error:
        sys.exit(f"{error}: expected what `prepare`, and a script that was run there, write")


if __name__ == "__main__":
    main(sys.argv[1:])
