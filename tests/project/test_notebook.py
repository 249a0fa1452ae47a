"""The notebook of the examples runs as it stands, and shows what is stored in it."""

from pathlib import Path
from typing import Any

import nbformat
import pytest

from examples.renew_notebook import NOTEBOOK, executed

OWN = ("text/html", "<table><caption>")
"""What is ours among the outputs; others' tables look different in each of their versions."""


def outputs(notebook: Any) -> list[Any]:
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def own_tables(notebook: Any) -> list[str]:
    texts = [output.get("data", {}).get(OWN[0], "") for output in outputs(notebook)]
    return [text for text in texts if text.startswith(OWN[1])]


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of sockets that Jupyter leaves
def test_the_notebook_runs_and_shows_what_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RBFMU_QUIET", "1")
    stored, fresh = nbformat.read(NOTEBOOK, 4), executed(tmp_path)
    assert own_tables(fresh) == own_tables(stored), "renew by: python -m examples.renew_notebook"
    assert len(own_tables(fresh)) == 3
    kinds = {kind for output in outputs(fresh) for kind in output.get("data", {})}
    assert {"image/png", "application/vnd.jupyter.widget-view+json"} <= kinds, "a plot and a bar of progress"
    assert not [output for output in outputs(fresh) if output.output_type in ("error", "stream")]
    assert (tmp_path / "motion.html").stat().st_size > 500_000
