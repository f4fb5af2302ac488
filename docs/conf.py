"""Settings of the documentation site: ``uv run --group docs sphinx-build -W docs build/site``."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

project = "dualwinch"
author = "the dualwinch authors"
html_title = "dualwinch"
project_copyright = "Apache-2.0 licensed"
extensions = ["myst_nb", "docs.generated.extension"]
exclude_patterns = ["generated", "pictures"]
templates_path: list[str] = []
suppress_warnings = [
    "mystnb.unknown_mime_type",  # progress bars of notebooks
]

myst_enable_extensions = ["dollarmath", "attrs_inline", "attrs_block", "deflist", "tasklist"]
myst_fence_as_directive = ["math"]  # as code hosts write formulas
myst_heading_anchors = 4
html_math_renderer = "mathml"
smartquotes_action = "qe"  # not dashes: options begin with two hyphens

nb_execution_mode = "off"  # outputs are kept in the notebooks: `python -m docs.notebooks`
nb_merge_streams = True

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navigation_with_keys": True,
    "light_css_variables": {"color-brand-primary": "#0072B2", "color-brand-content": "#0072B2"},
    "dark_css_variables": {"color-brand-primary": "#56B4E9", "color-brand-content": "#56B4E9"},
}
