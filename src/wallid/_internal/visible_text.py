"""Text from files without the characters that an SVG or a page cannot hold.

Source: W3C, Extensible Markup Language (XML) 1.0 (2008), production 2, `Char`.
"""

from __future__ import annotations

import re

_NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def visible_text(text: str) -> str:
    """A text with the replacement character in the place of each control character and each lone surrogate."""
    return _NOT_IN_XML.sub("\ufffd", text)
