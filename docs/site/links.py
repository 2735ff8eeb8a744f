"""Links from the pages to files of the repository that are not pages.

On GitHub a link such as ``[x](../examples/x.py)`` opens the file. The site has no such file: there it becomes a link to
the address "Repository" of pyproject.toml, or the path as code while there is none. The file, and the heading after #,
must exist. A link to the kept results, or to one of them, becomes links to their tables, which are written for the
site. The first image of the site becomes a link to a page that replays a flight, with a link to a race below it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

import table

try:
    import tomllib
except ImportError:  # Python 3.10
    import tomli as tomllib  # type: ignore[no-redef]

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"\[([^\]]+)\]\((\.\./[^)#\s]+)(#[^)\s]*)?\)")
NAMED = re.compile(r"\[([\w-]+\.md)\]\(\1(#[^)\s]*)?\)")  # a link whose text is the name of the file
IMAGE = re.compile(r"^!\[([^\]]+)\]\(([^)]+)\)$", re.MULTILINE)
#: With files of `html_extra_path`.
REPLAY = (
    "```{figure} \\2\n:alt: \\1\n:target: replay.html\n\nFollow a flight from any side: select the image. "
    'Or <a href="race.html#fly">fly a race</a> against a trained policy.\n```'
)
CSV = ROOT / "build" / "docs" / "results"
logger = logging.getLogger(__name__)


def repository() -> str:
    """Return the address of the repository, or nothing."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"].get("urls", {})
    return str(urls.get("Repository", "")).rstrip("/")


def anchors(path: Path) -> set[str]:
    """Return the anchors that GitHub gives the headings of a Markdown file."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {"#" + re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def table_link(page: str, text: str, name: str) -> str:
    """Return a link of a page to the table of a kept result."""
    return f"[{text}]({'../' * (page.count('/') + 1)}{(CSV / name).relative_to(ROOT).as_posix()}.csv)"


def replaced(match: re.Match[str], page: str, address: str) -> str:
    """Return what stands on the site for a link to a file."""
    text, anchor = match[1], match[3] or ""
    path = (ROOT / "docs" / page).parent.joinpath(match[2]).resolve()
    if not path.exists() or (anchor and anchor not in anchors(path)):
        logger.warning("a link leads nowhere: %s%s", match[2], anchor, location=page)
    if path.is_relative_to(ROOT / "docs"):
        return match[0]
    if path == table.KEPT:
        return f"{text} ({', '.join(table_link(page, file.stem, file.stem) for file in sorted(CSV.glob('*.csv')))})"
    if path.parent == table.KEPT:
        return table_link(page, text, path.stem)
    name = path.relative_to(ROOT).as_posix()
    if address:
        return f"[{text}]({address}/{'tree' if path.is_dir() else 'blob'}/main/{name}{anchor})"
    return f"`{name}`" if text.strip("`/") in (name, path.name) else f"{text} (`{name}`)"


def replace_links(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace the links of a page to files outside of docs/, and those that show the name of a page's file."""
    address = repository()
    if page == app.config.root_doc:
        source[0] = IMAGE.sub(REPLAY, source[0], count=1)
    source[0] = NAMED.sub(r"[](\1\2)", source[0])  # shows the title of the page
    source[0] = LINK.sub(lambda match: replaced(match, page, address), source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension with Sphinx."""
    table.write_csv(CSV, table.read(table.KEPT))
    app.connect("source-read", replace_links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
