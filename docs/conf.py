"""Sphinx configuration of the site: ``sphinx-build -W --keep-going docs build/site`` builds the site."""

import sys
from pathlib import Path
from typing import Any

import wbf_mission

sys.path.insert(0, str(Path(__file__).parent))
from page_tables import with_tables

project = "wbf-mission"
author = "The wbf-mission developers"
copyright = author  # noqa: A001 (Sphinx's name)
version = release = wbf_mission.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}
exclude_patterns = ["examples", "images", "**.ipynb_checkpoints"]

myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
nb_execution_mode = "force"
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_execution_show_tb = True

default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autosummary_generate = True
autosummary_ignore_module_all = False
napoleon_google_docstring = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 90
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = "wbf-mission"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
copybutton_prompt_text = "$ "
copybutton_prompt_is_regexp = False


def _with_tables(_app: Any, _page: str, source: list[str]) -> None:
    source[0] = with_tables(source[0])


def setup(app: Any) -> None:
    """Replace the marks of tables in the pages by tables made from the code."""
    app.connect("source-read", _with_tables)
