"""How Sphinx builds the site from these pages: `make docs`."""

import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))

import reference_pages  # noqa: E402 - beside this file

import rigd  # noqa: E402

reference_pages.write(DOCS / "reference", DOCS.parent / "schemas")

project = "rigd"
release = rigd.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["__pycache__"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
nb_execution_mode = "off"  # the tests execute the notebook, which holds what it shows
myst_heading_anchors = 4
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
html_theme = "furo"
html_title = f"rigd {release}"
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
