"""What a command does so as to start and end soon."""

import atexit
import gc

import rbfmu.__main__


def test_a_command_seldom_looks_for_garbage_and_leaves_it_at_the_end(monkeypatch):
    """What it imports and compiles lives until its end: looking through that takes a quarter of a short command."""
    thresholds, at_end = [], []
    monkeypatch.setattr("rbfmu.cli.main", lambda prog_name: None)
    monkeypatch.setattr(gc, "set_threshold", thresholds.append)
    monkeypatch.setattr(atexit, "register", at_end.append)
    rbfmu.__main__.main()
    assert thresholds == [rbfmu.__main__.YOUNG]
    assert gc.freeze in at_end
