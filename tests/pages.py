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
        if tag not in ("meta", "link", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def check(text):
    """What must hold for every report."""
    found = Page(text)
    assert found.open == []
    assert len(set(found.ids)) == len(found.ids)
    assert set(found.links) <= {f"#{name}" for name in found.ids}
    assert all(one.startswith(("#", "data:")) for one in found.fetched)
    assert all(len(image["alt"]) > 20 for image in found.images)
    assert len(text.encode()) < 3e6
    for image in found.images:
        svg = base64.b64decode(image["src"].partition(",")[2]).decode()
        assert svg.startswith("<svg") and "var(--ink)" in svg and "#010203" not in svg
        assert not re.findall(r'(?:href|src)="(?!#|data:)', svg)
        assert not re.findall(r"url\((?!#)", svg)
    return found
