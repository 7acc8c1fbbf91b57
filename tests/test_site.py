"""The site needs no network: equations are MathML, and no page loads anything from another host."""

import importlib.util
from pathlib import Path

import pytest

pytest.importorskip("mkdocs")
pytest.importorskip("latex2mathml")


@pytest.fixture(scope="module")
def hooks():
    spec = importlib.util.spec_from_file_location("site_hooks", Path(__file__).parents[1] / "docs" / "hooks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "page",
    [
        '<script src="https://cdn.example/mathjax.js"></script>',
        "<link rel='stylesheet' href='//fonts.example/css'>",
        '<link rel="preconnect" href="https://fonts.example" crossorigin>',
        '<img alt="a" src="http://pictures.example/a.png">',
        "<style>@import 'https://fonts.example/css';</style>",
        '<style>p { src: url("https://fonts.example/a.woff2") }</style>',
        '<p style="background: url(https://pictures.example/a.png)">',
    ],
)
def test_what_is_loaded_from_elsewhere_is_found(hooks, page):
    (address,) = hooks.loaded_from_elsewhere(f"<html>{page}</html>")
    assert "example" in address
    with pytest.raises(hooks.PluginError, match=r"index.md: loads .*example"):
        hooks.on_post_page(page, _Page, None)


class _Page:
    class file:  # noqa: N801
        src_uri = "index.md"


@pytest.mark.parametrize(
    "page",
    [
        '<a href="https://docs.example">a link</a>',
        '<link rel="canonical" href="https://site.example/">',
        '<script src="../assets/bundle.js"></script><img src="figures/demo.png">',
        '<math xmlns="http://www.w3.org/1998/Math/MathML"><mi>x</mi></math>',
        '<pre>&lt;script src="https://cdn.example"&gt;</pre>',
    ],
)
def test_what_a_page_has_itself_is_permitted(hooks, page):
    assert hooks.loaded_from_elsewhere(page) == [] and hooks.on_post_page(page, _Page, None) == page


def test_an_equation_becomes_mathml(hooks):
    given = '<p><span class="arithmatex">\\(\\alpha &lt; 1\\)</span></p><div class="arithmatex">\\[x^2\\]</div>'
    page = hooks.on_page_content(given, None, None, None)
    assert page.count("<math") == 2 and "arithmatex" not in page and "α" in page.replace("&#x003B1;", "α")
