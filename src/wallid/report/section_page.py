"""The page of a solved section and its figures."""

from __future__ import annotations

from matplotlib.figure import Figure

from .. import plot
from .._internal.number_formats import format_number, format_text
from ..estimation.one_dimension import CostOfOneDimension
from ..models.section.section_solution import SectionSolution
from .single_page import SinglePage

_CAPTIONS = {
    "materials": "The section to scale, with its materials and sensors.",
    "steady": "Temperatures between the two given ones in a steady state, with isotherms. Arrows are the heat flux, "
    "thin lines joints.",
    "one-dimension": "The error of the diffusivity that each sensor causes in an estimate of a homogeneous wall, by "
    "its height. The grey band is the 95 % interval that such an estimate states.",
    "temperatures": "Temperatures at the chosen time, with isotherms. Arrows are the heat flux, thin lines joints.",
}
_LARGEST = 5.0  # inches, of a figure along its longer side


def section_page(solution: SectionSolution) -> SinglePage:
    """What `wallid section` writes."""
    section, wall = solution.case.section, solution.equivalent
    return SinglePage(
        case=solution.case.name,
        template="section.html",
        context={
            "solution": solution,
            "case": solution.case,
            "values": []
            if wall is None
            else [
                ("conductivity", f"{format_number(wall.conductivity, 4)} W/m/K"),
                ("diffusivity", format_text(f"{format_number(wall.diffusivity, 4)} m2/s")),
                ("resistance, face to face", format_text(f"{format_number(wall.resistance, 4)} m2 K/W")),
            ],
            "parts": [
                (one.name, one.conductivity, one.anisotropy * one.conductivity, one.heat_capacity, share)
                for one, share in zip(section.materials, section.areas.tolist(), strict=True)
            ],
            "summary": format_text(str(solution)),
        },
        entries={"section": solution.to_dict()},
        draw=lambda: _figures(solution),
        captions=_CAPTIONS,
    )


def _figures(solution: SectionSolution) -> list[tuple[str, Figure]]:
    section, sensors = solution.case.section, solution.case.sensors
    scale = _LARGEST / max(section.length, section.height)
    width, height = max(3.6, scale * section.length + 1.6), scale * section.height + 1.2
    with plot.style():
        materials, ax = plot.figure(width=width, height=height)
        plot.materials(section, sensors, ax=ax)
        figures = [("materials", materials)]
        for name, field in (
            ("steady", None if solution.steady is None else solution.steady.field),
            ("temperatures", solution.temperatures),
        ):
            if field is not None:
                figure, ax = plot.figure(width=width, height=height)
                plot.section_temperatures(solution.model, field, sensors, ax=ax)
                figures.append((name, figure))
        if isinstance(cost := solution.one_dimension, CostOfOneDimension):
            figure, ax = plot.figure(height=3.2)
            plot.height_bias(cost, ax=ax)
            figures.append(("one-dimension", figure))
    return figures
