"""How Sphinx makes the site of the pages that stand beside the code: `make site`."""

import shutil
from pathlib import Path
from typing import Any

from examples.site.reference import filled

project, author, copyright = "rbfmu", "the authors of rbfmu", "the authors of rbfmu"
extensions = ["myst_parser", "sphinx_click"]
root_doc = "README"
_SITE = "examples/site"
_FIRST = (f"{_SITE}/choosing", *(f"{_SITE}/tours/{name}" for name in ("couple", "fly", "teach")))
_PAGES = ("rbfmu/README", "fmu_build/README", "kernels/README", "examples/README")
_GALLERY = ("examples/scenes/README", "examples/scenes/formulas/README")
_ENTRIES = ("functions", "motions", "kernels", "fmus", "keys", "commands")
_REFERENCE = tuple(f"{_SITE}/reference/{name}" for name in _ENTRIES)
_PROJECT = ("NOTATION", "GLOSSARY", "ARCHITECTURE", "CONTRIBUTING", "CHANGELOG")
_TREE = {"Start": _FIRST, "Pages": _PAGES, "Gallery": _GALLERY, "Reference": _REFERENCE, "The project": _PROJECT}
include_patterns = [f"{page}.md" for pages in ((root_doc,), *_TREE.values()) for page in pages]
exclude_patterns = [".venv/**", "build/**"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
suppress_warnings = ["myst.xref_missing"]  # of `<a id>` in the text, which HTML finds; a test follows every link
smartquotes = False  # else "--native" and "ZYX" are shown with a dash and quotes that nobody can type
html_theme = "furo"
html_title = "rbfmu"
html_copy_source = False
html_show_copyright = False
add_function_parentheses = False
add_module_names = False
toc_object_entries = False


def _with_tables(_: Any, name: str, content: list[str]) -> None:
    """Fill in what is made from code, and hang all pages below the first."""
    content[0] = filled(content[0])
    if name == root_doc:
        for title, pages in _TREE.items():
            listed = "\n".join(pages)
            content[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{listed}\n```\n"


def _with_index(app: Any, error: Exception | None) -> None:
    """Give the first page the name that servers and people look for."""
    if error is None:
        shutil.copy(Path(app.outdir) / f"{root_doc}.html", Path(app.outdir) / "index.html")


def setup(app: Any) -> None:
    """Tell Sphinx what to do with a page's text, and at the end."""
    app.connect("source-read", _with_tables)
    app.connect("build-finished", _with_index)
