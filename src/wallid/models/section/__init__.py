"""A section in two dimensions: its mesh, its full-order model, its steady state, its reduced models."""

from .affine_model import AffineModel
from .full_order_section import SectionModel, SectionPoint, full_order_section
from .material_range import MaterialRange
from .material_sensitivity import material_sensitivity
from .reduced_section import ReducedSection, reduce_section
from .section_response import section_response
from .section_solution import SectionSolution, solve_section
from .section_state_space import SectionModes, SectionProjection, section_modes, section_over_range
from .steady_section import EquivalentWall, SteadySection, equivalent_wall, heat_flux, steady_section
from .tensor_mesh import TensorMesh, section_mesh

__all__ = [
    "AffineModel",
    "EquivalentWall",
    "MaterialRange",
    "ReducedSection",
    "SectionModel",
    "SectionModes",
    "SectionPoint",
    "SectionProjection",
    "SectionSolution",
    "SteadySection",
    "TensorMesh",
    "equivalent_wall",
    "full_order_section",
    "heat_flux",
    "material_sensitivity",
    "reduce_section",
    "section_mesh",
    "section_modes",
    "section_over_range",
    "section_response",
    "solve_section",
    "steady_section",
]
