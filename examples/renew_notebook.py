"""`python -m examples.renew_notebook` runs the notebook and stores what it shows, without bars of progress."""

import os
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).with_name("notebook.ipynb")


def executed(folder: Path) -> Any:
    """Return the notebook with what it shows when it runs in a folder."""
    os.environ["RBFMU_QUIET"] = "1"
    notebook = nbformat.read(NOTEBOOK, 4)
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}}).execute()
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
