"""Pictures as their readers see them."""

from itertools import combinations
from typing import Any

from matplotlib.text import Text


def overlaps(figure: Any) -> list[tuple[str, str]]:
    """Texts that lie on one another, or beyond the page; ticks beyond their axis' ends are not drawn."""
    figure.draw_without_rendering()
    hidden = set()
    for axes in figure.axes:
        (left, right), (bottom, top) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
        hidden |= {tick.label1 for tick in axes.xaxis.get_major_ticks() if not left <= tick.get_loc() <= right}
        hidden |= {tick.label1 for tick in axes.yaxis.get_major_ticks() if not bottom <= tick.get_loc() <= top}
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip() and t not in hidden]
    boxes = [(t.get_text(), Text.get_window_extent(t)) for t in texts]
    boxes = [(text, box) for text, box in boxes if box.width > 1.0]
    page = figure.bbox
    outside = [(text, "figure") for text, b in boxes if min(b.x0, b.y0) < 0.0 or b.x1 > page.x1 or b.y1 > page.y1]
    pairs = ((a, b) for a, b in combinations(boxes, 2) if a[1].shrunk(0.9, 0.8).overlaps(b[1].shrunk(0.9, 0.8)))
    return outside + [(a[0], b[0]) for a, b in pairs]
