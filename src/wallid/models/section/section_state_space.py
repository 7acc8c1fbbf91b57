"""A section as a `StateSpace` whose rate scales with one diffusivity: the materials keep their ratios.

    z' = (Fo A + A0) z + (Fo B + B0) q,      u = C z + D q

The full-order model at the stated values is projected on rational Krylov snapshots (`krylov_basis`) and taken in its
modes. Its diffusivity is that of the equivalent homogeneous wall, so estimate, design and intervals take it like the
model of a homogeneous wall.

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
from .affine_model import Factorised
from .full_order_section import SectionModel, SectionPoint, full_order_section, output_rows
from .krylov_basis import generalised_modes, log_frequencies, orthonormal_basis, snapshots
from .steady_section import EquivalentWall, equivalent_wall

_PERIODS = 600.0, 100.0 * 86400.0  # s, of the shifts: wide, so that one basis serves all diffusivities
_SHIFTS = 16
_PROFILE_DEGREE = 2  # the highest of an initial profile
_ORDER = 40  # of all sections of more than one material: one compilation serves them


@dataclass(frozen=True, eq=False)
class SectionModes:
    """A section's modes at the stated values of its materials.

    Args:
        section: the full-order model, without outputs.
        equivalent: the homogeneous wall.
        rates: f < 0, 1/s.
        vectors: the modes at the nodes of the full-order model, of mean square 1 by heat content, `(state, mode)`.
        weighted: their products with the nodes' share of the heat capacity: a field's amplitudes in the modes.
    """

    section: SectionModel
    equivalent: EquivalentWall
    rates: np.ndarray
    vectors: np.ndarray
    weighted: np.ndarray

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
        _, _, drive = model.at(self.section.conductivity, self.section.heat_capacity)
        per_rate = own.length**2 / self.equivalent.diffusivity  # from 1/s to multiples of alpha / L^2
        C, D = self._outputs(outputs)
        states = StateSpace(
            A=per_rate * self.rates,
            B=per_rate / self.capacity * self.vectors.T @ drive,
            C=C,
            D=D,
            P=self.weighted.T @ self._profile_fields[:, : profile_degree + 1],
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
            k = self.section.conductivity[mesh.cells[:, cell]] / self.equivalent.conductivity
            each = 0.5 * weight * k * np.diff(mesh.y) / own.height * own.length / (mesh.x[cell + 1] - mesh.x[cell])
            for half in (slice(None, -1), slice(1, None)):
                row[half, cell] += each
                row[half, cell + 1] -= each
        return row.ravel()

    @cached_property
    def _profile_fields(self) -> np.ndarray:
        """The fields of the initial profile's coefficients at the nodes that are states, `(state, param)`."""
        degree = _PROFILE_DEGREE
        own, model = self.section.section, self.section.model
        E, K, drive = model.at(self.section.conductivity, self.section.heat_capacity)
        solver = Factorised(-K)
        x = np.tile(self.section.mesh.x / own.length, len(self.section.mesh.y))[self.section.unknown]
        edges = np.array([[1.0, *np.zeros(degree)], np.ones(degree + 1)])
        fields = []
        for power in range(degree + 1):
            source = np.zeros(len(x))
            if power >= 2:
                shape = power * (power - 1) * x ** (power - 2)
                source = E @ shape * (self.equivalent.diffusivity / own.length**2)
            fields.append(solver.solve(drive @ edges[:, power] - source))
        return np.stack(fields, axis=1)

    def _heat_shares(self, profiles: Sequence[HeatProfile]) -> np.ndarray:
        """The share of each profile's heat that is released in each state's node, `(state, profile)`."""
        mesh = self.section.mesh
        bounds = [np.concatenate([[0.0], 0.5 * (one[1:] + one[:-1]), [one[-1]]]) / one[-1] for one in (mesh.x, mesh.y)]
        columns = []
        for profile in profiles:
            share = np.diff(bounds[1])[:, None] * np.diff(np.asarray(profile.released_up_to(bounds[0])))
            columns.append(share.ravel()[self.section.unknown])
        return np.stack(columns, axis=1)


@lru_cache(maxsize=8)
def section_modes(section: Section) -> SectionModes:
    """The modes of a section at the stated values of its materials, computed once for a section.

    Raises:
        InputError: an edge that is not adiabatic, so that there is no equivalent wall; a surface resistance, which does
            not scale with the materials' diffusivity.
    """
    if reason := section.why_not_estimated:
        raise InputError(f"[section]: {reason}")
    full = full_order_section(section, profile_degree=2)
    equivalent = equivalent_wall(full)
    assert equivalent is not None
    values = full.conductivity, full.heat_capacity
    columns = snapshots(full.model, [values], log_frequencies(*_PERIODS, _SHIFTS), no_progress)
    basis = orthonormal_basis(full.model, columns, _ORDER)
    E, K, _ = full.model.at(*values)
    rates, modes = generalised_modes(basis.T @ (E @ basis), basis.T @ (K @ basis))
    total = equivalent.heat_capacity * section.length * section.height
    vectors = basis @ modes * np.sqrt(total)
    return SectionModes(full, equivalent, rates, vectors, E @ vectors / total)
