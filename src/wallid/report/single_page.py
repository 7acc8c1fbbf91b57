"""The page of a result that is no `Run`: what it is made of, and the figures as its template takes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from matplotlib.figure import Figure

from .._internal.visible_text import visible_text
from .page import page_environment
from .svg import DrawnFigure, data_uris


@dataclass(frozen=True)
class SinglePage:
    """What a command writes of its result.

    Args:
        case: name of the case.
        template: file of the page's template.
        context: what the template takes, besides figures, command, date and version.
        entries: of result.json.
        draw: draws each figure, with the name of its file.
        captions: of the figures, by the name of the file.
        files: further files, by name.
    """

    case: str
    template: str
    context: Mapping[str, Any]
    entries: Mapping[str, Any]
    draw: Callable[[], Sequence[tuple[str, Figure]]]
    captions: Mapping[str, str]
    files: Mapping[str, bytes] = field(default_factory=dict)

    def render(self, figures: Sequence[DrawnFigure], command: str = "") -> str:
        """The page as HTML.

        Args:
            figures: in the order of the page.
            command: command line that made the page; empty where there was none.
        """
        shown = [
            {
                "stem": one.stem,
                "uri": uri,
                "caption": self.captions[one.stem],
                "width": round(96 * one.figure.get_figwidth()),
            }
            for one, uri in zip(figures, data_uris(figures), strict=True)
        ]
        template = page_environment().get_template(self.template)
        return visible_text(
            template.render(
                **self.context,
                figures=shown,
                command=command,
                date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
                wallid=version("wallid"),
            )
        )
