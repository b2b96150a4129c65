"""A browser without a window, for tests that are marked with what they need."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.optional import program

#: WebGL by the processor alone, as machines for tests have no graphics.
FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)

#: What a browser has time for [ms]: busy machines may take minutes to open a page.
PATIENCE = 300_000


class Page:
    """An opened page, with all messages of its console and the network."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.messages: list[str] = []
        page.on("console", lambda m: self.messages.append(f"{m.type}: {m.text}"))
        page.on("pageerror", lambda error: self.messages.append(f"error: {error}"))
        page.on("request", self._asked)

    def _asked(self, request: Any) -> None:
        if not request.url.startswith(("file:", "data:", "blob:")):
            self.messages.append(f"request: {request.url}")

    def run(self, script: str) -> Any:
        """The value of an expression on the page."""
        return self.page.evaluate(script)


@contextmanager
def opened(path: Path) -> Iterator[Page]:
    """A page of a file in a headless Chromium: `needs("chromium", "playwright")`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=program("chromium"), args=list(FLAGS), timeout=PATIENCE
        )
        try:
            page = browser.new_page(viewport={"width": 900, "height": 600})
            page.set_default_timeout(PATIENCE)
            watched = Page(page)
            page.goto(path.as_uri())
            yield watched
        finally:
            browser.close()
