"""The native FMU's C layer under the address and undefined-behaviour sanitizers (`make fuzz` for more, and counts)."""

import re

import pytest

from tests.support.fmu import fuzzing
from tests.support.fmu.fmus import workshop

SPOILT = {
    "heap-buffer-overflow": ("if (size < sizeof s) return refuse", "if (size + 9 < sizeof s) return refuse"),
    "stack-buffer-overflow": ("char escaped[2 * MESSAGE_SIZE]", "char escaped[64]"),
    "heap-use-after-free|SEGV": ("return link ? *link : NULL;\n}\n\nStatus", "return state;\n}\n\nStatus"),
    "the importer's memory did not come back|LeakSanitizer": ("    while (m->saved) {", "    while (0) {"),
    "null pointer": ("is_given = m && (n == 0 || (references && values))", "is_given = m != NULL"),
    "out of bounds": ("    return r < REALS;", "    return 1;"),
    "a buffer across cache lines": ("now.z)) % CACHE_LINE);", "now.z)) % 8);"),
    "a message's text": ("if (*text == '%') *end++ = '%';", ""),
}
"""What the sanitizers say of a C layer spoilt thus."""


@pytest.fixture(scope="module")
def compiler():
    return fuzzing.sanitizing_compiler() or pytest.skip("no C compiler with sanitizers")


@pytest.fixture
def folder(request):
    place = workshop() / f"fuzz {abs(hash(request.node.name))}"
    place.mkdir()
    return place


@pytest.mark.parametrize("name", fuzzing.NAMES)
def test_sanitizers_are_silent(name, compiler, folder):
    done = fuzzing.fuzz(fuzzing.compiled(name, folder, compiler), 1, 500)
    assert (done.returncode, done.stderr) == (0, "")
    print(done.stdout)
    calls, refused = map(int, re.search(r"(\d+) calls, (\d+) refused", done.stdout).groups())
    assert calls > 100_000
    assert 0.2 < refused / calls < 0.8
    accepted = {f: int(n) - int(r) for f, n, r in re.findall(r"  (\w+): (\d+), (\d+) refused", done.stdout)}
    assert min(accepted[f"fmi2{f}"] for f in ("DoStep", "SetReal", "SetFMUstate", "DeSerializeFMUstate")) > 500


@pytest.mark.slow
@pytest.mark.parametrize("finding", SPOILT)
def test_the_fuzzer_finds_what_is_wrong(finding, compiler, folder):
    program = fuzzing.compiled("prescribed", folder, compiler, spoilt=SPOILT[finding])
    done = fuzzing.fuzz(program, 1, 2000)
    assert done.returncode != 0
    assert re.search(finding, done.stderr)
