"""Sphinx configuration of the documentation; `make docs` builds it into build/docs."""

import os
import sys
from importlib.metadata import version as installed
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path[:0] = [str(ROOT), str(DOCS / "_ext")]
os.environ["PYTHONPATH"] = str(ROOT)  # notebooks run in kernels of their own
os.environ["PATH"] = (
    f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # of their commands
)
os.environ["OPEN3D_DISABLE_WEB_VISUALIZER"] = "true"  # which it announces in every notebook
os.environ.pop("MPLBACKEND", None)  # their pictures appear in the page

project = "Surefoot"
author = "Surefoot"
version = release = installed("surefoot")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "myst_nb",
    "docstrings",
    "mathematics",
    "results",
]
exclude_patterns = ["_ext", "_static", "**/.*"]
default_role = "code"
nitpicky = True
nitpick_ignore_regex = [
    ("py:(exc|obj|attr)", ".*"),  # what docstrings raise
    ("py:class", r"(?!perception|mapping|planning|sim|surefoot).*"),  # types of others
]

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist", "attrs_block"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_timeout = 400
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_execution_show_tb = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say shapes, units and frames
autodoc_default_options = {"members": True, "undoc-members": False}
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
napoleon_preprocess_types = False

html_theme = "pydata_sphinx_theme"
html_title = f"Surefoot {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_sidebars = {
    page: []
    for page in (
        "index",
        "tutorial",
        "papers",
        "experiments",
        "limits",
        "outputs",
        "metrics",
        "settings",
        "recordings",
        "scenes",
        "evaluate",
        "bibliography",
    )
}  # they stand alone
html_show_sourcelink = False
add_function_parentheses = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": "Surefoot"},
    "show_toc_level": 2,
    "navigation_with_keys": True,
    "header_links_before_dropdown": 6,
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
copyright = "Surefoot, Apache-2.0"
