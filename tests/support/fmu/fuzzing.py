"""Compiles fuzz.c and fuzz3.c with the C layer and a model under address and undefined-behaviour sanitizers.

`python -m tests.support.fmu.fuzzing [SEED] [INPUTS]` runs it on a body under loads and on prescribed rates
(`make fuzz`).
"""

import os
import shutil
import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path

from rbfmu_fmu.builder import c_sources
from rbfmu_fmu.description import describe
from rbfmu_fmu.model_description import FMI2, FMI3
from rbfmu_fmu.native import headers as native_headers, platforms
from rbfmu_fmu.native.object_code import object_files
from rbfmu_fmu.native.platforms import this_platform
from tests.support.fmu.fmus import planned, scene
from tests.support.paths import C_SOURCES

NAMES = ("driven", "prescribed")
FUZZERS = {"fmi2": (FMI2, "fuzz.c"), "fmi3": (FMI3, "fuzz3.c")}
"""By the version of FMI: what it is, and the program."""
INCLUDED = "saved_states.c"
"""What fuzzers include, to forge saved states; the other sources are compiled by themselves."""
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


def c_layer(fmi, spoilt=None):
    """The files of the C layer of a version of FMI by name; spoilt: see `compiled`."""
    files = (*c_sources(FUZZERS[fmi][0]), *platforms.HEADERS)
    sources = {file: platforms.source(file).decode() for file in files}
    if spoilt:
        (file,) = (file for file, text in sources.items() if spoilt[0] in text)
        sources[file] = sources[file].replace(*spoilt)
    return sources


def compiled(name, folder, compiler, flags=(), spoilt=None, fmi="fmi2"):
    """The fuzzer of a scene's C layer; spoilt: what to replace in it, (right, wrong), each to be found once."""
    version, fuzzer = FUZZERS[fmi]
    description = describe(scene(name), planned(name))
    headers = native_headers.headers(description, version, "{00000000-0000-0000-0000-000000000000}")
    objects = object_files(planned(name).kernels, this_platform())
    sources = c_layer(fmi, spoilt)
    for file, content in {**sources, **headers}.items():
        (folder / file).write_text(content)
    for file, content in objects.items():
        (folder / file).write_bytes(content)
    program = folder / f"fuzz_{name}"
    command = [compiler, *FLAGS, *flags, f"-I{folder}", f"-I{platforms.FMI_HEADERS}", C_SOURCES / fuzzer]
    parts = [*objects, *(file for file in c_sources(version) if file != INCLUDED)]
    subprocess.run([*command, *[folder / part for part in parts], "-lm", "-o", program], check=True)
    return program


def fuzz(program, seed, inputs, timeout=3600):
    """The finished process."""
    command = [program, str(seed), str(inputs)]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | OPTIONS, timeout=timeout)


def main(seed="1", inputs="10000"):
    """Print the counts; exit with the sanitizer's status."""
    compiler = sanitizing_compiler() or sys.exit("no C compiler with sanitizers")
    for name, fmi in product(NAMES, FUZZERS):
        with tempfile.TemporaryDirectory() as folder:
            done = fuzz(compiled(name, Path(folder), compiler, fmi=fmi), seed, inputs)
        print(f"{name}, {fmi}: {done.stdout}{done.stderr}", end="")
        if done.returncode:
            sys.exit(done.returncode)


if __name__ == "__main__":
    main(*sys.argv[1:])
