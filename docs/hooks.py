"""What the site adds to the folder of the documentation: the notebooks, the picture, and equations as MathML."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

_ROOT = Path(__file__).parents[1]
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)

_TAG = re.compile(r"<(script|link|img|iframe|source|video|audio|object|embed)\b([^>]*)>", re.IGNORECASE)
_ADDRESS = re.compile(r"""\b(?:src|href|data|srcset)\s*=\s*["']?((?:https?:)?//[^"'\s>]+)""", re.IGNORECASE)
_STYLE_ADDRESS = re.compile(r"""(?:@import\s+|url\()\s*["']?((?:https?:)?//[^"')\s]+)""", re.IGNORECASE)
_ONLY_NAMED = re.compile(r"""\brel\s*=\s*["']?(?:canonical|next|prev|alternate)\b""", re.IGNORECASE)

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


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Refuse a page that a browser without a network cannot show.

    Raises:
        PluginError: the page loads a script, a style, a font or a picture from elsewhere.
    """
    if found := loaded_from_elsewhere(output):
        raise PluginError(f"{page.file.src_uri}: loads {', '.join(found)}; the site must need no network")
    return output


def loaded_from_elsewhere(page: str) -> list[str]:
    """The addresses on other hosts that a browser loads with a page; links that a reader may follow are none."""
    text = re.sub(r"<(pre|code)\b.*?</\1>", "", page, flags=re.DOTALL)
    tags = [match[2] for match in _TAG.finditer(text) if not _ONLY_NAMED.search(match[2])]
    styles = re.findall(r"<style\b[^>]*>(.*?)</style>", text, flags=re.DOTALL | re.IGNORECASE)
    styles += re.findall(r"""\bstyle\s*=\s*"([^"]*)\"""", text)
    return [m[1] for tag in tags for m in _ADDRESS.finditer(tag)] + [
        m[1] for style in styles for m in _STYLE_ADDRESS.finditer(style)
    ]
