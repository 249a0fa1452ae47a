"""`python -m examples.renew_notebook` runs the notebooks and stores what they show, without bars of progress."""

import os
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellTimeoutError

NOTEBOOK = Path(__file__).with_name("notebook.ipynb")
CHAPTERS = sorted(Path(__file__).with_name("lecture").glob("*.ipynb"))
LONGEST, TRIES = 60, 3
"""What a cell may take, s, and how often a notebook is run: at times nbclient sees a reply only when that time is
over, or never (jupyter/nbclient, issue 312), and the first run may have to compile."""


def executed(path: Path, folder: Path) -> Any:
    """Return a notebook with what it shows when it runs in a folder."""
    environment = os.environ | {"RBFMU_QUIET": "1"}
    environment.pop("MPLBACKEND", None)  # pictures are shown by the notebook's own alone
    for left in reversed(range(TRIES)):
        notebook = nbformat.read(path, 4)
        try:
            client = NotebookClient(notebook, timeout=LONGEST, resources={"metadata": {"path": str(folder)}})
            client.execute(env=environment)
        except CellTimeoutError:
            if not left:
                raise
        else:
            break
    return notebook


def main() -> None:
    """Store the notebooks anew."""
    for path in (NOTEBOOK, *CHAPTERS):
        with tempfile.TemporaryDirectory() as folder:
            notebook = executed(path, Path(folder))
        notebook.metadata.pop("widgets", None)
        kinds = ("execute_result",) if path == NOTEBOOK else ("execute_result", "display_data")
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)
            if cell.cell_type == "code":
                cell.outputs = [output for output in cell.outputs if output.output_type in kinds]
        nbformat.write(notebook, path)


if __name__ == "__main__":
    main()
