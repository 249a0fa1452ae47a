"""The native FMU's C layer under the address and undefined-behaviour sanitizers (`make fuzz` for more, and counts)."""

import re

import pytest

from tests.support.fmu import fuzzing
from tests.support.fmu.fmus import workshop

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
    "out of bounds": ("if (v[i] >= REFERENCES || v[i] == TIME_REFERENCE", "if (v[i] == TIME_REFERENCE"),
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
