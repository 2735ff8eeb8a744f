"""The C++ reference: one page for each public header, by Doxygen and Breathe.

A public name without a comment is a warning of Doxygen, and therefore fails the build.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from sphinx.application import Sphinx
from sphinx.util import logging

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "docs" / "site"
GENERATED = ROOT / "build" / "docs" / "server"  # of the C++ client
FOLDERS = [ROOT / part / "include" / "flockstep" for part in ("engine", "server")] + [GENERATED / "flockstep"]
PAGES = ROOT / "docs" / "reference" / "cpp"
logger = logging.getLogger(__name__)

DOXYGEN = f"""
INPUT = {" ".join(map(str, FOLDERS))} {SITE / "namespace.dox"}
FILTER_PATTERNS = "*.hpp={sys.executable} {SITE / "doxygen_filter.py"}"
RECURSIVE = YES
STRIP_FROM_PATH = {ROOT}
GENERATE_XML = YES
GENERATE_HTML = NO
GENERATE_LATEX = NO
XML_PROGRAMLISTING = NO
EXTRACT_ALL = NO
MAX_INITIALIZER_LINES = 1
WARN_IF_UNDOCUMENTED = YES
WARN_IF_DOC_ERROR = YES
QUIET = YES
MACRO_EXPANSION = YES
EXPAND_ONLY_PREDEF = YES
PREDEFINED = FLOCKSTEP_API=
EXCLUDE_SYMBOLS = flockstep::detail* flockstep::client::detail* flockstep::EnumNames* FLOCKSTEP_TEXT* FLOCKSTEP_API \\
  FLOCKSTEP_EXPORT \\
  FLOCKSTEP_TASK_VERSION
"""


def run_doxygen(out: Path) -> None:
    """Read all headers into XML files, and report what has no comment."""
    subprocess.run([sys.executable, ROOT / "server" / "generate.py", GENERATED], check=True)
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    settings = f"{DOXYGEN}\nOUTPUT_DIRECTORY = {out}\n"
    done = subprocess.run(["doxygen", "-"], input=settings, text=True, capture_output=True, check=False)
    for line in done.stderr.splitlines():
        if line.strip():
            logger.warning("%s", line.replace(": warning", ""), type="doxygen")


def about(header: Path) -> str:
    """Return the first comment of a header, without its example."""
    text = header.read_text(encoding="utf-8")
    comment = text[: text.index("#pragma once")].strip().splitlines()
    paragraphs = "\n".join(line[3:] if line[3:4] != " " else "" for line in comment)
    return re.sub(r"\n\n+", "\n\n", paragraphs).strip()


def label(header: Path) -> str:
    """Return Doxygen's name of a header, to which references lead."""
    return header.name.replace("_", "__").replace(".", "_8")


def directives(xml: Path) -> dict[str, list[str]]:
    """Return Breathe's directives for all that the headers declare, by header, in the order of the declarations."""
    found: dict[str, list[tuple[int, str]]] = {}

    def add(element: ElementTree.Element, kind: str, name: str) -> None:
        place = element.find("location")
        assert place is not None
        members = "   :members:\n" if kind in ("class", "struct") else ""
        entry = int(place.attrib["line"]), f".. doxygen{kind}:: {name}\n{members}"
        found.setdefault(Path(place.attrib["file"]).name, []).append(entry)

    for path in sorted(xml.glob("*.xml")):
        for compound in ElementTree.parse(path).getroot().findall("compounddef"):
            kind = compound.attrib["kind"]
            if kind in ("class", "struct", "concept"):
                if path.with_stem(path.stem.rpartition("_1_1")[0]).exists():
                    continue  # a class in a class, which shows it
                add(compound, kind, compound.findtext("compoundname", ""))
            for member in compound.iter("memberdef") if kind in ("namespace", "file") else ():
                name = member.findtext("qualifiedname") or member.findtext("name") or ""
                kind = member.attrib["kind"]
                if "<" not in name:  # a specialisation
                    add(member, kind, name + (member.findtext("argsstring") or "" if kind == "function" else ""))
    return {file: [text for _, text in sorted(entries)] for file, entries in found.items()}


def write_pages(app: Sphinx) -> None:
    """Write the pages of all headers, and their table."""
    xml = Path(app.config.breathe_projects["flockstep"])
    run_doxygen(xml.parent)
    entries = directives(xml)
    shutil.rmtree(PAGES, ignore_errors=True)
    PAGES.mkdir(parents=True)
    rows = hidden = ""
    headers = [header for folder in FOLDERS for header in folder.rglob("*.hpp")]
    for header in sorted(headers, key=lambda header: header.name):
        title, text = header.as_posix().partition("/include/")[2], about(header)
        page = f".. _{label(header)}:\n\n{title}\n{'=' * len(title)}\n\n{text}\n\n" + "\n".join(
            entries.get(header.name, [])
        )
        (PAGES / f"{header.name}.rst").write_text(page, encoding="utf-8")
        sentence = re.split(r"(?<=[.])\s", text)[0].replace("\n", " ")
        rows += f"   * - :doc:`{header.name}`\n     - {sentence}\n"
        hidden += f"   {header.name} <{header.name}>\n"
    intro = (SITE / "cpp_index.rst").read_text(encoding="utf-8")
    table = f".. list-table::\n   :widths: 25 75\n\n{rows}"
    (PAGES / "index.rst").write_text(f"{intro}\n{table}\n.. toctree::\n   :hidden:\n\n{hidden}", encoding="utf-8")


def remove_pages(app: Sphinx, error: Exception | None) -> None:
    """Remove the pages from the sources, as autoapi does with its own."""
    shutil.rmtree(PAGES, ignore_errors=True)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension with Sphinx."""
    app.connect("builder-inited", write_pages, priority=100)
    app.connect("build-finished", remove_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
