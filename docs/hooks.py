"""What the site adds to the folder of the documentation: the notebooks, the picture, and equations as MathML."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

_ROOT = Path(__file__).parents[1]
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)

_SCROLLING = '<div style="overflow-x: auto; margin: 1.5em 0; padding: 0.3em 0">{}</div>'  # wider than a narrow screen


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, and the picture of the demo."""
    for path in sorted((_ROOT / "notebooks").glob("*.ipynb")):
        files.append(File.generated(config, f"tutorials/{path.stem}.md", content=_as_markdown(path)))
    picture = _ROOT / "notebooks" / "figures" / "demo.png"
    files.append(File.generated(config, "figures/demo.png", abs_src_path=str(picture)))
    return files


def _as_markdown(path: Path) -> str:
    """A notebook's text and code, without running it."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        parts.append(f"```python\n{source}\n```" if cell["cell_type"] == "code" else source)
    return re.sub(r"(\]\(\w+)\.ipynb\)", r"\1.md)", "\n\n".join(parts))


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Replace each equation by MathML, which a browser draws without a script."""
    content = _INLINE.sub(lambda match: convert(html.unescape(match[1])), content)
    return _BLOCK.sub(lambda match: _SCROLLING.format(convert(html.unescape(match[1]), display="block")), content)
