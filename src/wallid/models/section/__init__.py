"""The full-order model of a section in two dimensions."""

from .affine_model import AffineModel
from .full_order_section import SectionModel, SectionPoint, full_order_section
from .tensor_mesh import TensorMesh, section_mesh

__all__ = ["AffineModel", "SectionModel", "SectionPoint", "TensorMesh", "full_order_section", "section_mesh"]
