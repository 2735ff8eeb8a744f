"""Configuration of the documentation site, for Sphinx. `./dev docs` builds it; docs/site/ has its extensions."""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "docs" / "site"), str(ROOT / "bindings"), str(ROOT / "bench")]

project = author = "flockstep"
version = re.findall(r'VERSION "([^"]+)"', (ROOT / "engine/include/flockstep/version.hpp").read_text(encoding="utf-8"))[
    0
]
extensions = ["myst_parser", "sphinx.ext.autodoc", "autoapi.extension", "breathe", "links", "python_names", "cpp_pages"]
exclude_patterns = ["site"]

# Every reference must lead somewhere, except to names of other packages.
nitpicky = True
nitpick_ignore_regex = [
    (
        "cpp:identifier",
        r"flockstep|flockstep::client|detail(::.*)?|DroneKind|EnvKind|(std|Eigen|Vec3|Quat)(::.*)?",
    ),  # the last two are Eigen's
    ("py:obj", r"Box|Discrete|TimeLimit|(single_)?(action|observation)_space|np_random"),  # Gymnasium's
    ("py:obj", r"Monitor|PPO|VecEnv|VecNormalize"),  # Stable-Baselines3's
    ("py:(obj|exc)", r"(gymnasium|numpy|stable_baselines3|torch)\..*"),
]
suppress_warnings = ["autoapi.python_import_resolution"]  # the stub and two modules import types of each other

myst_heading_anchors = 4
default_role = "py:obj"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = cpp_maximum_signature_line_length = 80

autoapi_dirs = ["../build/docs/python/flockstep"]  # made by python_names.py
autoapi_root = "reference/python"
autoapi_template_dir = "site/templates"
autoapi_file_patterns = ["*.pyi", "*.py"]
autoapi_options = ["members", "imported-members", "inherited-members", "show-module-summary"]
autoapi_member_order = "bysource"
autoapi_own_page_level = "class"
autoapi_add_toctree_entry = False

breathe_projects = {"flockstep": str(ROOT / "build" / "docs" / "doxygen" / "xml")}
breathe_default_project = "flockstep"

html_theme = "pydata_sphinx_theme"
html_title = "flockstep"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_extra_path = ["../build/docs/extra"]  # a flight to replay, which `./dev docs` writes
toc_object_entries_show_parents = "hide"
html_show_copyright = html_show_sourcelink = html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "header_links_before_dropdown": 7,
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": False,
    "footer_start": [],
    "footer_end": [],
    "search_bar_text": "Search",
    "use_edit_page_button": False,
    "pygments_light_style": "tango",
}
