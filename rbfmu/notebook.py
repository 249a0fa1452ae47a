"""HTML tables, in which notebooks show scenes, plans and results."""

from collections.abc import Iterable
from html import escape

import numpy as np
from numpy.typing import ArrayLike


def table(caption: str, header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return an HTML table of texts."""
    head = "".join(f"<th>{escape(text)}</th>" for text in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def numbers_text(values: ArrayLike) -> str:
    """Return a number, or the components of a vector, to five digits."""
    return ", ".join(f"{x:.5g}" for x in np.atleast_1d(values))
