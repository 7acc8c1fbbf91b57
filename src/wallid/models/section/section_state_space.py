"""A section as a `StateSpace` whose rate scales with one diffusivity: the materials keep their ratios.

    z' = (Fo A + A0) z + (Fo B + B0) q,      u = C z + D q

The full-order model is projected on rational Krylov snapshots (`krylov_basis`) and taken in its modes. Its diffusivity
is that of the equivalent homogeneous wall, so estimate, design and intervals take it like the model of a homogeneous
wall. Where the ratios of the materials are estimated too, the basis holds for the range of their priors, and the modes
are made anew at each value: the projected matrices are affine in the conductivity and capacity of each material.

The initial profile's coefficients belong to fields p_0, p_1, ... that have the values of 1, x*, x*^2, ... at the faces:
p_0 is 1, p_1 the steady state, and the others are `K p_d = (E / c) (k / L^2) d (d - 1) x*^(d - 2)` with the equivalent
wall's `k` and `c`. In a homogeneous section they are these powers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..._internal.errors import InputError
from ..._internal.progress import no_progress
from ...case.section.section_definition import Section
from ..finite_volume_wall import HeatProfile, Output, with_heat_inputs
from ..state_space import StateSpace
from .affine_model import AffineModel, Factorised
from .full_order_section import SectionModel, SectionPoint, full_order_section, output_rows
from .krylov_basis import Values, generalised_modes, log_frequencies, orthonormal_basis, snapshots
from .material_range import MaterialRange
from .steady_section import EquivalentWall

_PERIODS = 600.0, 100.0 * 86400.0  # s, of the shifts: wide, so that one basis serves all diffusivities
_SHIFTS = 16
_ORDER = 40  # of all sections of more than one material: one compilation serves them
_ORDER_OF_RANGE = 80  # where the ratios of the materials are estimated
_VALUES_OF_RANGE = 16  # of the materials, with snapshots


@dataclass(frozen=True, eq=False)
class SectionModes:
    """A section's modes at some values of its materials.

    Args:
        section: the full-order model, without outputs.
        conductivity, heat_capacity: of the materials, W/m/K and J/m3/K.
        equivalent: the homogeneous wall.
        rates: f < 0, 1/s.
        vectors: the modes at the nodes of the full-order model, of mean square 1 by heat content, `(state, mode)`.
        profile: the modes' amplitudes in the initial profile's fields, `(mode, param)`.
    """

    section: SectionModel
    conductivity: np.ndarray
    heat_capacity: np.ndarray
    equivalent: EquivalentWall
    rates: np.ndarray
    vectors: np.ndarray
    profile: np.ndarray

    def state_space(
        self, outputs: Sequence[Output], profile_degree: int = 2, heat: Sequence[HeatProfile] = ()
    ) -> StateSpace:
        """The state space with these outputs.

        Args:
            outputs: temperatures, gradients along x, and fluxes; without a height, and for a flux, the mean over the
                section's height.
            profile_degree: of the initial profile, at most 2.
            heat: each is one more input, as in `finite_volume_model`.

        Raises:
            InputError: a position outside the section.
        """
        own, model = self.section.section, self.section.model
        drive = model.drive_at(self.conductivity)
        per_rate = own.length**2 / self.equivalent.diffusivity  # from 1/s to multiples of alpha / L^2
        C, D = self._outputs(outputs)
        states = StateSpace(
            A=per_rate * self.rates,
            B=per_rate / self.capacity * self.vectors.T @ drive,
            C=C,
            D=D,
            P=self.profile[:, : profile_degree + 1],
            output_names=tuple(output.name for output in outputs),
        )
        return with_heat_inputs(states, self.vectors.T @ self._heat_shares(heat)) if heat else states

    @property
    def capacity(self) -> float:
        """The heat capacity of the section, J/m/K."""
        own = self.section.section
        return self.equivalent.heat_capacity * own.length * own.height

    def _outputs(self, outputs: Sequence[Output]) -> tuple[np.ndarray, np.ndarray]:
        """C and D of some outputs."""
        own, mesh = self.section.section, self.section.mesh
        rows = np.zeros((len(outputs), mesh.shape[0] * mesh.shape[1]))
        for row, output in zip(rows, outputs, strict=True):
            x = float(output.position)
            if output.kind == "flux":
                row += self._flux_row(x)
            else:
                row += output_rows(own, mesh, [SectionPoint(x, output.height, output.name)], output.kind).toarray()[0]
        inputs = np.stack([rows[:, self.section.given == side].sum(axis=1) for side in range(2)], axis=1)
        return rows[:, self.section.unknown] @ self.vectors, inputs

    def _flux_row(self, x: float) -> np.ndarray:
        """The weights of all nodes for `-(k/k_eff) du/dx*`, the mean over the section's height at x.

        This mean is smooth in x, joints included, so it is the straight line through the middles of the two nearest
        columns of cells.
        """
        own, mesh = self.section.section, self.section.mesh
        middles = 0.5 * (mesh.x[1:] + mesh.x[:-1])
        first = int(np.clip(np.searchsorted(middles, x) - 1, 0, len(middles) - 2))
        share = (x - middles[first]) / (middles[first + 1] - middles[first])
        row = np.zeros(mesh.shape)
        for cell, weight in ((first, 1.0 - share), (first + 1, share)):
            k = self.conductivity[mesh.cells[:, cell]] / self.equivalent.conductivity
            each = 0.5 * weight * k * np.diff(mesh.y) / own.height * own.length / (mesh.x[cell + 1] - mesh.x[cell])
            for half in (slice(None, -1), slice(1, None)):
                row[half, cell] += each
                row[half, cell + 1] -= each
        return row.ravel()

    def _heat_shares(self, profiles: Sequence[HeatProfile]) -> np.ndarray:
        """The share of each profile's heat that is released in each state's node, `(state, profile)`."""
        mesh = self.section.mesh
        bounds = [np.concatenate([[0.0], 0.5 * (one[1:] + one[:-1]), [one[-1]]]) / one[-1] for one in (mesh.x, mesh.y)]
        columns = []
        for profile in profiles:
            share = np.diff(bounds[1])[:, None] * np.diff(np.asarray(profile.released_up_to(bounds[0])))
            columns.append(share.ravel()[self.section.unknown])
        return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class SectionProjection:
    """A section's full-order model projected on a basis, for some range of its materials' values.

    Args:
        section: the full-order model, without outputs.
        basis: its columns, `(state, column)`.
    """

    section: SectionModel
    basis: np.ndarray

    @cached_property
    def _projected(self) -> AffineModel:
        """The model on the basis."""
        return self.section.model.projected(self.basis)

    def equivalent_at(self, conductivity: np.ndarray, heat_capacity: np.ndarray) -> EquivalentWall:
        """The equivalent homogeneous wall at some values of the materials, W/m/K and J/m3/K.

        The heat flow is that which leaves the left face for 1 K across the wall.
        """
        own, model = self.section.section, self._projected
        _, K, drive = model.at(conductivity, heat_capacity)
        steady = np.linalg.solve(-K, drive[:, 0])
        flow = float(self.section.model.drive_at(conductivity)[:, 0].sum() - drive[:, 0] @ steady)
        resistance = own.height / flow
        return EquivalentWall(own.length / resistance, float(own.areas @ heat_capacity), resistance)

    def modes_at(self, conductivity: np.ndarray, heat_capacity: np.ndarray) -> SectionModes:
        """The modes at some values of the materials, W/m/K and J/m3/K."""
        equivalent, own = self.equivalent_at(conductivity, heat_capacity), self.section.section
        E, K, drive = self._projected.at(conductivity, heat_capacity)
        rates, modes = generalised_modes(E, K)
        uniform = self._projected.P[:, 0]
        per_rate = own.length**2 / equivalent.diffusivity
        edges = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
        sources = np.stack([0.0 * uniform, 0.0 * uniform, 2.0 / per_rate * E @ uniform], axis=1)
        fields = np.linalg.solve(-K, drive @ edges - sources)
        scale = np.sqrt(equivalent.heat_capacity * own.length * own.height)
        vectors = scale * (self.basis @ modes)
        return SectionModes(
            self.section, conductivity, heat_capacity, equivalent, rates, vectors, modes.T @ E @ fields / scale
        )


@lru_cache(maxsize=8)
def section_modes(section: Section) -> SectionModes:
    """The modes of a section at the stated values of its materials, computed once for a section.

    Raises:
        InputError: an edge that is not adiabatic, so that there is no equivalent wall; a surface resistance, which does
            not scale with the materials' diffusivity.
    """
    full = _full_order_model(section)
    values = full.conductivity, full.heat_capacity
    return SectionProjection(full, _basis(full, [values], _SHIFTS, _ORDER)).modes_at(*values)


@lru_cache(maxsize=4)
def section_over_range(section: Section) -> SectionProjection:
    """A section's projection that holds for the range of its materials' priors, computed once for a section.

    Raises:
        InputError: as in `section_modes`.
    """
    full, materials = _full_order_model(section), MaterialRange.of(section)
    points = np.vstack([np.zeros((1, 2 * len(section.materials))), materials.points(_VALUES_OF_RANGE - 1, 0)])
    values = [materials.at(point) for point in points]
    return SectionProjection(full, _basis(full, values, _SHIFTS // 2, _ORDER_OF_RANGE))


def _full_order_model(section: Section) -> SectionModel:
    """The full-order model of a section that an estimate takes, without outputs."""
    if reason := section.why_not_estimated:
        raise InputError(f"[section]: {reason}")
    return full_order_section(section, profile_degree=2)


def _basis(full: SectionModel, values: Sequence[Values], shifts: int, order: int) -> np.ndarray:
    """A basis from snapshots at some values of the materials, the second field of the initial profile among them."""
    columns = [snapshots(full.model, values, log_frequencies(*_PERIODS, shifts), no_progress)]
    for conductivity, heat_capacity in values:
        E, K, _ = full.model.at(conductivity, heat_capacity)
        field = Factorised(-K).solve(E @ np.ones(E.shape[0]))
        columns.append((field / field.max())[:, None])
    return orthonormal_basis(full.model, np.concatenate(columns, axis=1), order)
