"""Settings of Sphinx, for `make docs`. What is made from the package's own files stands in reference.py."""

import re
import sys
from pathlib import Path
from typing import Any, List

sys.path.insert(0, str(Path(__file__).resolve().parent))
import reference

project = 'obst_avoid'
author = 'The obst_avoid team'
copyright = '%s, BSD-3-Clause' % author
release = re.findall('<version>(.+)</version>', (reference.ROOT / 'package.xml').read_text())[0]

extensions = ['myst_parser', 'sphinx_copybutton']
myst_heading_anchors = 3  # GitHub's own links to headings
html_theme = 'furo'
html_title = 'obst_avoid %s' % release
html_static_path = ['style']
html_css_files = ['site.css']
html_show_sphinx = False
html_copy_source = False
copybutton_selector = 'div.highlight-none pre'
highlight_language = 'none'  # of commands and formulae, which wrap; diagrams and output are ```text


def _fill(app: Any, name: str, source: List[str]) -> None:
    source[0] = reference.filled(source[0])


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect('source-read', _fill)
