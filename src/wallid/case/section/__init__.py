"""Sections in two dimensions: materials, rectangles, pictures, patterns."""

from .picture import section_of_picture
from .rectangles import Region, brick_with_joints, coursed_rubble, section_of_regions
from .section_definition import Section
from .section_materials import SectionMaterial
from .section_tables import SectionCase

__all__ = [
    "Region",
    "Section",
    "SectionCase",
    "SectionMaterial",
    "brick_with_joints",
    "coursed_rubble",
    "section_of_picture",
    "section_of_regions",
]
