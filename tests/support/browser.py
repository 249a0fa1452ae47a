"""A page as a user sees it: a headless browser without network, which tells what the page asks for and complains of."""

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from matplotlib.image import imread

PATIENCE = 300_000.0
"""Milliseconds after which a page that does not answer counts as hanging."""
_NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
_SOFTWARE = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


def browser() -> str | None:
    """Return the path of a browser, or None."""
    return next(filter(None, map(shutil.which, _NAMES)), None)


class Page:
    """A page that plays a motion."""

    def __init__(self, page) -> None:
        self.page, self.requests, self.complaints = page, [], []
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", lambda m: m.type == "error" and self.complaints.append(m.text))

    @property
    def fetched(self) -> list[str]:
        """Return the addresses that the page asked for outside itself."""
        return [url for url in self.requests if not url.startswith(("blob:", "data:"))]

    def open(self, path: Path) -> None:
        """Load the page and stop its play."""
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("[role=slider]", state="attached")
        self.page.locator("canvas").first.wait_for()
        self.page.keyboard.press("Space")

    @property
    def time(self) -> float:
        """Return the time that the panel shows (s)."""
        return float(self.page.locator("#rbfmu-time").text_content())

    def values(self, name: str) -> list[float]:
        """Return the numbers that the panel shows of a quantity."""
        text = self.page.locator("#rbfmu tr", has_text=name).locator("td").nth(1).text_content()
        return [float(line.split()[-1]) for line in text.splitlines()]

    def seek(self, part: float) -> None:
        """Click on the slider, and wait until the panel has followed and the drawing has been drawn."""
        box, before = self.page.locator(".mantine-Slider-root").bounding_box(), self.time
        self.page.mouse.click(box["x"] + part * box["width"], box["y"] + box["height"] / 2)
        self.wait_until_time_is_not(before)
        self.page.evaluate("() => new Promise((done) => { let n = 8;"
                           " const f = () => (n-- ? requestAnimationFrame(f) : done()); f(); })")  # fmt: skip

    def wait_until_time_is_not(self, before: float) -> None:
        """Wait until the panel shows another time."""
        self.page.wait_for_function("t => Number(document.getElementById('rbfmu-time').textContent) !== t", arg=before)

    def picture(self) -> np.ndarray:
        """Return what is drawn now (rows, columns, 3), from 0 to 1, without the panel and without viser's notes."""
        return imread(io.BytesIO(self.page.screenshot(clip={"x": 0, "y": 160, "width": 400, "height": 300})))[..., :3]


def photographed(path: Path, picture: Path, part: float = 0.6) -> None:
    """Write what a page shows at a part of its motion to a file."""
    with open_page(path, 1000, 620) as page:
        page.seek(part)
        page.page.add_style_tag(content=".mantine-Notifications-root, .mantine-Notification-root { display: none }")
        page.page.screenshot(path=picture)


@contextmanager
def open_page(path: Path, width: int = 720, height: int = 520) -> Iterator[Page]:
    """Open a page in a browser without network."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser(), args=_SOFTWARE)
        context = chromium.new_context(viewport={"width": width, "height": height}, offline=True)
        context.set_default_timeout(PATIENCE)
        page = Page(context.new_page())
        page.open(path)
        yield page
        chromium.close()
