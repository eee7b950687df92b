"""Sphinx settings of the website: ``make docs``. Neither the build nor a page that is read needs the network."""

import os
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
os.environ["PYTHONPATH"] = str(ROOT)  # notebooks use this checkout, whatever is installed

project = "sinew"
author = "the authors of sinew"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_click",
    "sphinx_copybutton",
]
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]

html_theme = "furo"
html_title = "sinew"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0072B2", "color-brand-content": "#0072B2"},
    "dark_css_variables": {"color-brand-primary": "#56B4E9", "color-brand-content": "#56B4E9"},
}

myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
nb_execution_mode = os.environ.get("SINEW_DOCS_NOTEBOOKS", "force")  # "off" skips the notebooks, for a quick look
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # for one cell, on a busy machine
nb_merge_streams = True
nb_ipywidgets_js: dict[str, Any] = {}  # not needed, and they would be fetched from elsewhere

autodoc_typehints = "description"
autodoc_member_order = "bysource"
autosummary_generate = False
nitpicky = True
nitpick_ignore_regex = [
    (
        r"py:.*",
        r"(collections\.abc|np|numpy|pd|pandas|xr|xarray|matplotlib|arviz|pyabc|SALib|skopt|pydantic|annotated_types)\..*",
    ),
    (r"py:.*", r"(pathlib\.|collections\.|typing\.)?(Path|Callable|Literal|Any|Sequence|Mapping|DataFrame|DataTree)"),
    (r"py:.*", r"BadInput|PHASES|PLACES"),  # docstrings name them without their module
    (r"py:.*", r"(sinew\.)?(runner|tasks)\..*"),  # parts of the code that are not in the reference
]


def setup(app: Any) -> None:
    """Add the checks and filters of this site."""
    app.connect("sphinx-click-process-epilog", _plain)
    app.connect("build-finished", _check_offline)


def _plain(app: Any, command: Any, lines: list[str]) -> None:
    """Escape stars in the examples of commands, which are not markup."""
    lines[:] = [line.replace("*", r"\*") for line in lines]


def _check_offline(app: Any, failure: Exception | None) -> None:
    """Refuse a page that would fetch a script, a style or an image from the network."""
    if failure is not None or app.builder.format != "html":
        return
    fetched = re.compile(
        r"""<(?:script|img|iframe|link(?=[^>]*stylesheet))[^>]*(?:src|href)=["'](?:https?:)?//[^"']+"""
    )
    for page in sorted(Path(app.outdir).rglob("*.html")):
        if found := fetched.search(page.read_text("utf-8")):
            raise RuntimeError(f"{page}: fetches {found.group(0)}; expected a site that needs no network")
