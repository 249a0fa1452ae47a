"""`make ranges` tests what it is asked for, and refuses what it does not know."""

import sys

from tests.support import ranges

TEST = "tests/project/test_ranges.py"


def test_a_word_that_is_not_known_is_refused(capsys):
    assert ranges.main(["lowset", "3.11", "tests/no_such_test.py"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("lowset, tests/no_such_test.py: expected of lowest, newest, 3.11")


def test_what_is_asked_for_is_tested_and_the_status_says_how_it_went(capsys, monkeypatch):
    seen = []

    def tested(python, tests):
        seen.append((python.parents[1].name, tests))
        return len(seen) == 1

    monkeypatch.setattr(ranges, "python_of", lambda version: sys.executable if version == "3.11" else None)
    monkeypatch.setattr(ranges, "install", lambda python, resolution, folder: folder / resolution / "bin" / "python")
    monkeypatch.setattr(ranges, "versions", lambda python: "numba 0.61.0")
    monkeypatch.setattr(ranges, "tested", tested)
    assert ranges.main(["lowest", "3.11", TEST]) == 0
    assert ranges.main(["newest"]) == 1
    assert seen == [("lowest", [TEST]), ("newest", ranges.TESTS)]
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == [
        "Python 3.11, lowest: passed with numba 0.61.0",
        "Python 3.11, newest: FAILED with numba 0.61.0",
    ]
    assert lines[2:] == [f"Python 3.{n}: not on this machine, not tried" for n in (12, 13, 14)]
