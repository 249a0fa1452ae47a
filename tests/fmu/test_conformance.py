"""Any call of FMI 2.0 or 3.0 in any order with any argument: the right answer, the right motion, and never a crash.

conformance/machine.py and conformance/states.py make the calls in a child process (process.py there,
child.py); conformance/model.py says what each must answer, and has the motion from direct calls of the
kernels. Numbers of calls are printed (`make fuzz`, or -s).
"""

import re

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.support.fmu import fuzzing
from tests.support.fmu.conformance.machine import CallMachine
from tests.support.fmu.conformance.machine3 import CallMachine3
from tests.support.fmu.conformance.model import Facts
from tests.support.fmu.conformance.process import Process
from tests.support.fmu.fmu_importer import OK
from tests.support.fmu.fmus import planned, run_case, scene, unzipped, workshop

NAMES = ("driven", "prescribed")


def drive(kind, examples, steps):
    facts = [Facts(scene(name), planned(name), kind) for name in NAMES]
    process = Process(kind, [unzipped(name, kind) for name in NAMES])
    chosen = settings(max_examples=examples, stateful_step_count=steps, deadline=None, derandomize=True,
                      database=None, suppress_health_check=list(HealthCheck))  # fmt: skip
    try:
        machine = CallMachine3 if kind == "fmi3_scalars" else CallMachine
        run_state_machine_as_test(lambda: machine(kind, process, facts), settings=chosen)
    finally:
        process.stop()
    print(process.report())
    return process


@pytest.mark.parametrize("examples", [15, pytest.param(100, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("kind", ["python", "native", "fmi3_scalars"])
def test_any_calls_are_answered_rightly(kind, examples):
    process = drive(kind, examples, 50)
    assert sum(process.calls.values()) > 50 * examples
    assert sum(process.refused.values()) > 10 * examples


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["python", "native"])
def test_very_many_calls_are_answered_rightly(kind):
    process = drive(kind, 2000, 80)
    assert sum(process.calls.values()) > 200_000


@pytest.mark.parametrize("kind", ["python", "native", "fmi3_scalars"])
def test_every_byte_of_a_state_counts(kind):
    process = Process(kind, [unzipped("prescribed", kind)])
    process.ask("instantiate", 1, 0, "it", 1, None, False)
    process.ask("get_state", 1, 0)
    _, size, _ = process.ask("size", 1, 0)
    _, content, _ = process.ask("serialize", 1, 0, size)
    for k in range(size):
        damaged = content[:k] + bytes([content[k] ^ 1]) + content[k + 1 :]
        assert process.ask("deserialize", 1, 1, damaged)[0] != OK, k
    assert process.ask("deserialize", 1, 1, content)[0] == OK
    process.stop()


@pytest.mark.thorough
def test_a_hundred_thousand_native_lives_leave_nothing_behind():
    growth, _ = run_case("cycles", unzipped("driven", "native"), 100_000)
    assert growth < 0.5  # MB; the smallest block kept of each life would be 3


# The C layer under sanitizers


SPOILT = {
    "heap-buffer-overflow": ("if (size < sizeof s) return refuse", "if (size + 9 < sizeof s) return refuse"),
    "stack-buffer-overflow": ("char escaped[2 * MESSAGE_SIZE]", "char escaped[64]"),
    "use-after-free|SEGV|null pointer": ("return link ? *link : NULL;\n}\n\nStatus", "return state;\n}\n\nStatus"),
    "the importer's memory did not come back|LeakSanitizer": ("    while (m->saved) {", "    while (0) {"),
    "null pointer": ("is_given = m && (n == 0 || (references && values))", "is_given = m != NULL"),
    "out of bounds|SEGV": ("if (v[i] >= REFERENCES) return !refuse(m, call,", "if (0) return !refuse(m, call,"),
    "a buffer across cache lines": ("now.z)) % CACHE_LINE);", "now.z)) % 8);"),
    "a message's text": ('escape(escaped, text, "%#");', 'escape(escaped, text, "#");'),
    "a single # in a message": ('escape(escaped, text, "%#");', 'escape(escaped, text, "%");'),
}
"""What the sanitizers say of a C layer spoilt thus."""


USUAL = {
    "fmi2": ("DoStep", "SetReal", "GetDirectionalDerivative", "SetFMUstate", "DeSerializeFMUstate"),
    "fmi3": ("DoStep", "SetFloat64", "GetDirectionalDerivative", "GetAdjointDerivative", "SetFMUState",
             "DeserializeFMUState"),
}  # fmt: skip
"""Calls of each version that are to be accepted often."""
SPOILT_3 = {
    "heap-use-after-free|SEGV": ("    if (!is_updating(c, __func__)) free_instance(c);", "    free_instance(c);"),
    "a single # in a message": ('escape(escaped, text, "#");', 'escape(escaped, text, "");'),
    "a step's answers": ("m->returned_early = h < whole;", "m->returned_early = 0;"),
    "heap-buffer-overflow": ('return n_values == expected || !refuse(m, call, "%zu values: expected %zu", n_values, '
                             'expected);', "return 1;"),
    "out of bounds": ("int is_real = v[i] < REFERENCES && v[i] != TIME", "int is_real = v[i] != TIME"),
}  # fmt: skip
"""The same of that of FMI 3.0."""


@pytest.fixture(scope="module")
def compiler():
    return fuzzing.sanitizing_compiler() or pytest.skip("no C compiler with sanitizers")


@pytest.fixture
def folder(request):
    place = workshop() / f"fuzz {abs(hash(request.node.name))}"
    place.mkdir()
    return place


@pytest.mark.thorough
@pytest.mark.parametrize("fmi", fuzzing.FUZZERS)
@pytest.mark.parametrize("name", fuzzing.NAMES)
def test_sanitizers_are_silent(name, fmi, compiler, folder):
    done = fuzzing.fuzz(fuzzing.compiled(name, folder, compiler, fmi=fmi), 1, 500)
    assert (done.returncode, done.stderr) == (0, "")
    print(done.stdout)
    calls, refused = map(int, re.search(r"(\d+) calls, (\d+) refused", done.stdout).groups())
    assert calls > 80_000
    assert 0.2 < refused / calls < 0.8
    accepted = {f: int(n) - int(r) for f, n, r in re.findall(r"  (\w+): (\d+), (\d+) refused", done.stdout)}
    assert min(accepted[f"{fmi}{function}"] for function in USUAL[fmi]) > 300


def test_what_is_spoilt_stands_in_the_c_layer():
    for fmi, ways in (("fmi2", SPOILT), ("fmi3", SPOILT_3)):
        for spoilt in ways.values():
            assert fuzzing.c_layer(fmi, spoilt) != fuzzing.c_layer(fmi), spoilt


@pytest.mark.slow
@pytest.mark.parametrize("finding", SPOILT)
def test_the_fuzzer_finds_what_is_wrong(finding, compiler, folder):
    program = fuzzing.compiled("prescribed", folder, compiler, spoilt=SPOILT[finding])
    done = fuzzing.fuzz(program, 1, 2000)
    assert done.returncode != 0
    assert re.search(finding, done.stderr)


@pytest.mark.slow
@pytest.mark.parametrize("finding", SPOILT_3)
def test_the_fuzzer_of_fmi_3_finds_what_is_wrong(finding, compiler, folder):
    program = fuzzing.compiled("prescribed", folder, compiler, spoilt=SPOILT_3[finding], fmi="fmi3")
    done = fuzzing.fuzz(program, 1, 2000)
    assert done.returncode != 0
    assert re.search(finding, done.stderr)
