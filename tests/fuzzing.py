"""Compiles fuzz.c with the C layer and a unit's object code under the address and undefined-behaviour sanitizers.

`python tests/fuzzing.py [SEED] [INPUTS]` runs it on a body under loads and on prescribed rates (`make fuzz`).
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from fmus import TESTS, planned, scene

from rbfmu_fmu import linking, native_fmu
from rbfmu_fmu.description import describe
from rbfmu_fmu.object_code import object_files
from rbfmu_fmu.platforms import this_platform

NAMES = ("driven", "prescribed")
FLAGS = ["-std=c11", "-O1", "-g", "-Wall", "-fno-omit-frame-pointer"]
FLAGS += ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all", "-ffp-contract=off"]
OPTIONS = {"ASAN_OPTIONS": "detect_leaks=1:abort_on_error=0", "UBSAN_OPTIONS": "print_stacktrace=1"}


def sanitizing_compiler():
    """A C compiler with both sanitizers, or None."""
    for name in ("gcc", "clang", "cc"):
        compiler = shutil.which(name)
        if compiler:
            with tempfile.TemporaryDirectory() as folder:
                source = Path(folder, "empty.c")
                source.write_text("int main(void) { return 0; }\n")
                command = [compiler, "-fsanitize=address,undefined", source, "-o", Path(folder, "empty")]
                if not subprocess.run(command, capture_output=True).returncode:
                    return compiler
    return None


def compiled(name, folder, compiler, flags=(), c_layer=None):
    """The fuzzer of a scene's C layer; c_layer: another source to try instead."""
    description = describe(scene(name), planned(name))
    (folder / "model.h").write_text(native_fmu.model_header(description, "{00000000-0000-0000-0000-000000000000}"))
    objects = object_files(planned(name).unit, this_platform())
    for file, content in {linking.UNIT: linking.source(linking.UNIT), **objects}.items():
        (folder / file).write_bytes(content)
    (folder / "fmi2.c").write_text(c_layer or linking.source("fmi2.c").decode())
    program = folder / f"fuzz_{name}"
    command = [compiler, *FLAGS, *flags, f"-I{folder}", f"-I{linking.HEADERS}", TESTS / "fuzz.c"]
    subprocess.run([*command, *[folder / file for file in objects], "-lm", "-o", program], check=True)
    return program


def fuzz(program, seed, inputs, timeout=3600):
    """The finished process."""
    command = [program, str(seed), str(inputs)]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | OPTIONS, timeout=timeout)


def main(seed="1", inputs="10000"):
    """Print the counts; exit with the sanitizer's status."""
    compiler = sanitizing_compiler() or sys.exit("no C compiler with sanitizers")
    for name in NAMES:
        with tempfile.TemporaryDirectory() as folder:
            done = fuzz(compiled(name, Path(folder), compiler), seed, inputs)
        print(f"{name}: {done.stdout}{done.stderr}", end="")
        if done.returncode:
            sys.exit(done.returncode)


if __name__ == "__main__":
    main(*sys.argv[1:])
