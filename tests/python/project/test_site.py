"""The sources of the documentation site, without building it; `./dev docs` builds it, and fails on any warning."""

import ast
import re
import sys

import pytest
from conftest import ROOT

DOCS = ROOT / "docs"
PAGES = sorted(path.stem for path in DOCS.glob("*.md"))
STUB = (ROOT / "envs" / "flockstep" / "_core.pyi").read_text(encoding="utf-8")
HEADER = """// Fan: a fan of beams.
#pragma once
inline constexpr FieldInfo kRate{.about = "Readings per second.", .unit = "Hz", .limits = above(0)};

struct Fan {
  int beams = 35;
  std::optional<float> rate_hz;  // none: every step
  std::vector<float> ranges;

  static constexpr auto fields() {
    using C = Fan;
    return field_list(field("beams", &C::beams, {.about = "Beams \\"of\\" "
                                                          "a fan.", .limits = between(1, 9)}),
                      field("rate_hz", &C::rate_hz, kRate),
                      array("ranges", &C::ranges, {.per = Per::ray, .unit = "m", .about = "distances"}));
  }

  // Returns one
  // range, m.
  float range(int beam) const;
  float range(int beam, int row) const;
  float mean() const;
  int rows = 0, columns = 0;  // of the grid
};
"""


@pytest.fixture
def modules(monkeypatch):
    """Makes the extensions of the site importable."""
    monkeypatch.setattr(sys, "path", [str(DOCS / "site"), str(ROOT / "bindings"), *sys.path])


def test_every_page_is_in_one_table_of_contents():
    listed = [
        entry
        for page in PAGES
        for block in re.findall(
            r"```\{toctree\}\n(.*?)```", (DOCS / f"{page}.md").read_text(encoding="utf-8"), re.DOTALL
        )
        for entry in re.findall(r"^(?:.*<)?([\w-]+)>?$", block, re.MULTILINE)
    ]
    assert sorted(listed) == [
        page for page in PAGES if page != "index"
    ]  # those in environments/ are found by a pattern


def test_the_extra_has_the_packages_that_dev_installs():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    extra = ast.literal_eval(re.search(r"^docs = (\[.*?\])", project, re.MULTILINE | re.DOTALL)[1])
    names = {re.split(r"[<>=]", package)[0] for package in extra}
    dev = (ROOT / "dev").read_text(encoding="utf-8")
    assert names == {*re.search(r'^pip_docs="(.*)"', dev, re.MULTILINE)[1].split(), "playwright"}
    pinned = (DOCS / "constraints.txt").read_text(encoding="utf-8")
    assert [name for name in names if f"\n{name}==" not in pinned] == []


def test_comments_of_a_header_become_documentation(modules):
    from doxygen_filter import Header

    text = Header(HEADER, "").documented()
    assert text.count("\n") == HEADER.count("\n")
    for line in (
        "/** A fan of beams. */ struct Fan {",
        '/** Beams "of" a fan. Limits: `between(1, 9)`. */ int beams = 35;',
        "/** Readings per second. Unit: Hz. Limits: `above(0)`. none: every step. */ std::optional<float> rate_hz;",
        "/** (N, channels, beams) m: distances. */ std::vector<float> ranges;",
        "  /// Returns one\n  /// range, m.\n  float range(int beam) const;",
        "/** Returns one range, m. */ float range(int beam, int row) const;",
        "\n  float mean() const;",  # what has no comment gets none
        "/** of the grid. */ int rows = 0; /** of the grid. */ int columns = 0;",
    ):
        assert line in text


def test_fields_of_the_stub_have_their_texts(modules):
    from stub_copy import copied

    text = copied(STUB)
    ast.parse(text)
    assert '    hfov_deg: float\n    """Horizontal field of view. Values: (0, 360] deg. Default: 270.0."""' in text
    assert re.search(r"    contact = 2\n    \"\"\"terminated while", text)
    assert "-> npt.NDArray[np.float32]:" in text
    assert "-> _F32" not in text
    config = next(
        node for node in ast.parse(text).body if isinstance(node, ast.ClassDef) and node.name == "LidarConfig"
    )
    assert ast.get_docstring(config).strip() == "A scanning LiDAR: a grid of channels x beams, or a beam pattern."
