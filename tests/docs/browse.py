"""Opens every page of the site in Debian's Chromium: `./dev docs --test`.

No page is wider than a phone, every request is answered, the search finds a class by its name, the first image leads
to a flight, and a link below it to a race that one flies.

usage: browse.py FOLDER
"""

from __future__ import annotations

import os
import sys
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

from playwright.sync_api import Page, TimeoutError, sync_playwright

CHROMIUM = "/usr/bin/chromium"
PHONE = {"width": 390, "height": 844}
SOUGHT = "LidarConfig"
TIME_LIMIT_MS = 60_000  # for one page, on a busy machine


# Elements of the text that reach beyond the window and cannot be scrolled to.
CUT_OFF = """() => [...document.querySelectorAll("article *")].filter(element => {
    if (element.getBoundingClientRect().right <= innerWidth + 1) return false;
    for (let box = element.parentElement; box; box = box.parentElement)
        if (/auto|scroll/.test(getComputedStyle(box).overflowX) && box.closest("article")) return false;
    return getComputedStyle(element).position != "absolute" && !/auto|scroll/.test(getComputedStyle(element).overflowX);
}).map(element => element.outerHTML.slice(0, 80))"""


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files without a line for each request."""

    def log_message(self, *arguments: object) -> None:
        pass


def wide_pages(page: Page, address: str, names: list[str]) -> list[str]:
    """Return the pages that are wider than the window, and what is cut off."""
    wide = []
    for name in names:
        page.goto(f"{address}/{name}")
        width = page.evaluate("document.documentElement.scrollWidth")
        if width > page.evaluate("innerWidth"):
            wide.append(f"{name}: {width} pixels wide, expected at most {PHONE['width']}")
        wide += [f"{name}: cut off: {element}" for element in page.evaluate(CUT_OFF)[:3]]
    return wide


def search_failures(page: Page, address: str, word: str) -> list[str]:
    """Return a failure unless the search, typed into its field, shows a link to the page of this name."""
    page.goto(f"{address}/index.html")
    page.keyboard.press("Control+k")
    field = page.locator("input[type=search]:visible").first
    field.fill(word)
    field.press("Enter")
    try:
        page.wait_for_selector(f"#search-results a[href*='{word}']")
    except TimeoutError:
        return [f"search for {word}: expected a link to its page, got {page.inner_text('#search-results')!r}"]
    return []


def replay_failures(page: Page, address: str) -> list[str]:
    """Return the failures of the links of the first page to pages with a flight: its first image, and the race."""
    failures = []
    for link in ("article a > img", "text=fly a race"):
        page.goto(f"{address}/index.html")
        page.locator(link).first.click()
        try:
            page.wait_for_selector("body[data-state=ready]", state="attached")
        except TimeoutError:
            failures.append(f"{page.url}: expected a flight, got {page.inner_text('body')!r}")
    return failures


def main(folder: Path) -> int:
    """Return the number of failures."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(QuietHandler, directory=str(folder)))
    Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}"
    files = (path.relative_to(folder) for path in folder.rglob("*.html"))
    names = sorted(path.as_posix() for path in files if path.parts[0] != "_static")  # templates of the theme
    failures: list[str] = []
    with sync_playwright() as playwright:
        # The sandbox does not run as root.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        arguments += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # OpenGL without a GPU
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        page = browser.new_page(viewport=PHONE)
        page.set_default_timeout(TIME_LIMIT_MS)
        page.on(
            "response", lambda reply: failures.append(f"{reply.url}: {reply.status}") if reply.status >= 400 else None
        )
        page.on("requestfailed", lambda request: failures.append(f"{request.url}: {request.failure}"))
        page.on("pageerror", lambda error: failures.append(f"{page.url}: {error}"))
        failures += wide_pages(page, address, names)
        failures += search_failures(page, address, SOUGHT)
        failures += replay_failures(page, address)
        browser.close()
    server.shutdown()
    for failure in failures:
        print(failure)
    print(f"{len(names)} pages, a flight and the search for {SOUGHT}: {len(failures)} failures")
    return len(failures)


if __name__ == "__main__":
    sys.exit(min(main(Path(sys.argv[1])), 1))
