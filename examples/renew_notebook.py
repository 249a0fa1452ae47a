"""`python -m examples.renew_notebook` runs the notebook and stores what it shows, without bars of progress."""

import os
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellTimeoutError

NOTEBOOK = Path(__file__).with_name("notebook.ipynb")
LONGEST, TRIES = 60, 3
"""What a cell may take, s, and how often the notebook is run: at times nbclient sees a reply only when that time is
over, or never (jupyter/nbclient, issue 312), and the first run may have to compile."""


def executed(folder: Path) -> Any:
    """Return the notebook with what it shows when it runs in a folder."""
    os.environ["RBFMU_QUIET"] = "1"
    for left in reversed(range(TRIES)):
        notebook = nbformat.read(NOTEBOOK, 4)
        try:
            NotebookClient(notebook, timeout=LONGEST, resources={"metadata": {"path": str(folder)}}).execute()
        except CellTimeoutError:
            if not left:
                raise
        else:
            break
    return notebook


def main() -> None:
    """Store the notebook anew."""
    with tempfile.TemporaryDirectory() as folder:
        notebook = executed(Path(folder))
    notebook.metadata.pop("widgets", None)
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.output_type == "execute_result"]
    nbformat.write(notebook, NOTEBOOK)


if __name__ == "__main__":
    main()
