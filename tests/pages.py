"""What must hold for every report that is written."""

import base64
import re
from html.parser import HTMLParser


class Page(HTMLParser):
    """What a reader's program sees of a page."""

    def __init__(self, text):
        super().__init__()
        self.text, self.ids, self.links, self.images, self.fetched, self.open = text, [], [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids += [given["id"]] if "id" in given else []
        if tag == "img":
            self.images.append(given)
        if tag == "a":
            self.links.append(given["href"])
        self.fetched += [given[key] for key in ("src", "href", "srcset", "action") if key in given]
        if tag not in ("meta", "link", "img", "br", "source"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def drawings(page):
    """The SVG of each figure, and of those that a small screen shows instead."""
    sources = [one for one in page.fetched if one.startswith("data:image/svg")]
    return [base64.b64decode(source.partition(",")[2]).decode() for source in sources]


def check(text):
    """What must hold for every report."""
    found = Page(text)
    assert found.open == []
    assert len(set(found.ids)) == len(found.ids)
    beside = re.compile(r"report(-[a-z]+)?\.html")  # of another command in the same folder
    assert {one for one in found.links if not beside.fullmatch(one)} <= {f"#{name}" for name in found.ids}
    assert all(one.startswith(("#", "data:")) or beside.fullmatch(one) for one in found.fetched)
    assert all(len(image["alt"]) > 20 for image in found.images)
    assert len(text.encode()) < 3e6
    for svg in drawings(found):
        assert svg.startswith("<svg") and "var(--ink)" in svg and "#010203" not in svg
        # black follows the reader's setting, where matplotlib leaves it unsaid too; no light grey covers a dark page
        assert "#000000" not in svg and "svg{fill:var(--ink)}" in svg
        assert not [grey for grey in re.findall(r"fill: #(\w\w)\1\1\b", svg) if 0xC0 <= int(grey, 16) < 0xFF]
        assert not re.findall(r'(?:href|src)="(?!#|data:)', svg)
        assert not re.findall(r"url\((?!#)", svg)
    return found
