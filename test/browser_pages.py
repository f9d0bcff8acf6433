"""HTML pages in a real browser: Debian's Chromium, without a display and without a network."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")
WEBGL_WITHOUT_GPU = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE_MS = 120_000
"""Where several programs share the processors, a page needs more than playwright's 30 s."""
VIEWPORT: Final = {"width": 1000, "height": 660}
"""Of pages in 3-D: wide enough for the layout of large screens; processors draw their pictures, pixel by pixel."""
PLAY_VIDEOS = """async () => {
    const failed = [];
    for (const video of document.querySelectorAll("video")) {
        video.muted = true;
        try { await video.play(); } catch (error) { failed.push(video.id + ": " + error.message); continue; }
        if (video.readyState < HTMLMediaElement.HAVE_CURRENT_DATA || video.videoWidth === 0) failed.push(video.id);
        video.pause();
    }
    return failed;
}"""


class OpenedPage:
    """A page that is open in the browser, with what it complained of and asked for since."""

    def __init__(self, page: "Page") -> None:  # noqa: F821 - playwright's, which is imported where it is there
        self.page = page
        page.set_default_timeout(PATIENCE_MS)
        self.problems: list[str] = []
        self.requests: list[str] = []
        page.on("console", lambda said: said.type in {"error", "warning"} and self.problems.append(said.text))
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        page.on("requestfailed", lambda request: self.problems.append(f"not loaded: {request.url[:200]}"))
        page.on("request", lambda request: self.requests.append(request.url[:200]))

    def empty_images(self) -> list[str]:
        """The alternative texts of the images that show nothing."""
        script = "() => Promise.all([...document.images].map(i => i.decode().catch(() => i.alt).then(() => i)))"
        self.page.evaluate(script + ".then(all => all.length)")
        return self.page.evaluate("() => [...document.images].filter(i => !i.naturalWidth).map(i => i.alt)")

    def unplayable_videos(self) -> list[str]:
        """The ids of the videos that do not start to play."""
        return self.page.evaluate(PLAY_VIDEOS)

    def table(self, css: str) -> list[list[str]]:
        """The texts of a table's cells, row by row, as they are shown."""
        script = "table => [...table.rows].map(row => [...row.cells].map(cell => cell.innerText.trim()))"
        return self.page.locator(css).evaluate(script)


class PageBrowser:
    """Opens pages of this machine in a browser that has no network."""

    def __init__(self, context: "BrowserContext") -> None:  # noqa: F821 - playwright's
        self._context = context

    @contextmanager
    def opened(self, path: Path) -> Iterator[OpenedPage]:
        """The page of a file, loaded; the only request that it may have made is that for the file itself."""
        page = self._context.new_page()
        opened = OpenedPage(page)
        address = path.resolve().as_uri()
        page.goto(address, wait_until="load")
        opened.requests = [url for url in opened.requests if url != address[:200]]
        yield opened
        page.close()

    @contextmanager
    def served(self, address: str) -> Iterator[OpenedPage]:
        """The page at an address of this machine, whose requests are kept, in a browser that has a network."""
        browser = self._context.browser
        assert browser is not None
        context = browser.new_context(viewport=VIEWPORT)
        page = context.new_page()
        opened = OpenedPage(page)
        page.goto(address, wait_until="load")
        yield opened
        context.close()


@contextmanager
def running_browser() -> Iterator[PageBrowser]:
    """A browser for the tests of one module; skips the test where the machine has none."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs the extra dev")
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    if executable is None:
        pytest.skip("needs Chromium; as root, ./env installs it with the extra dev")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=WEBGL_WITHOUT_GPU)
        context = browser.new_context(offline=True, has_touch=True, viewport={"width": 1280, "height": 900})
        yield PageBrowser(context)
        browser.close()
