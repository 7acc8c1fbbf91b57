"""What the readings in a section of stones and mortar differ by from those in the equivalent homogeneous wall.

A sensor at x and y reads `T(x, y)`, where the homogeneous wall of the same diffusivity has `T_1(x)`. The difference is
linear in a few amplitudes with normal priors, which stand for a height that is not known (`sensor_heights`):

    T(x, y) - T_1(x) = mean + sum_k z_k c_k,      z_k ~ N(0, 1)

With the amplitudes integrated out it is a covariance of the readings. Mean and components are linear in ln(alpha) about
the diffusivity at which they are computed.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._internal.arrays import on_device
from ...case.case_definition import Case
from ...case.initial_profile import scales
from ...case.time_window import Window
from ...inference.sensor_heights import (
    COMPONENTS,
    candidate_heights,
    has_uncertain_height,
    principal_components,
    section_minus_homogeneous,
)
from ...models.flux_plates import plate_outputs, with_filtered_faces
from ...models.sensitivity_equations import explicit
from ...models.wall_parameters import model_at
from ...models.window_inputs import window_data

_FURTHEST = 0.7  # of ln(alpha) from where the pattern is computed, to which it is extrapolated


class SectionPattern(eqx.Module):
    """The difference of the readings from those in the homogeneous wall, at all rows.

    Args:
        log_alpha: ln(alpha) at which it is computed, alpha in m2/s.
        mean, mean_slope: K (of a plate over the conductivity, K/m), and the derivative with respect to ln(alpha).
        components, component_slopes: the same for one standard deviation of each amplitude.
    """

    log_alpha: Float[Array, ""]
    mean: Float[Array, "time instrument"]
    mean_slope: Float[Array, "time instrument"]
    components: Float[Array, "param time instrument"]
    component_slopes: Float[Array, "param time instrument"]

    def change(self, log_alpha: Array, amplitudes: Float[Array, " param"]) -> Float[Array, "time instrument"]:
        """The difference at a diffusivity and at amplitudes in prior standard deviations."""
        further = jnp.clip(log_alpha - self.log_alpha, -_FURTHEST, _FURTHEST)
        components = self.components + further * self.component_slopes
        return self.mean + further * self.mean_slope + jnp.tensordot(amplitudes, components, 1)

    def without(self) -> SectionPattern:
        """A pattern of the same shape that changes nothing."""
        arrays = self.mean, self.mean_slope, self.components, self.component_slopes
        zeros = tuple(jnp.zeros_like(array) for array in arrays)
        return eqx.tree_at(lambda p: (p.mean, p.mean_slope, p.components, p.component_slopes), self, zeros)


def section_pattern(case: Case, window: Window, diffusivity: float) -> SectionPattern:
    """The pattern of a case with a section, its sensors first, then its plates.

    A plate reads the mean over the height of the section.

    Args:
        case: with a section. window: the rows.
        diffusivity: m2/s, of the equivalent wall.
    """
    uncertain = [has_uncertain_height(case, sensor) for sensor in case.sensors]
    sensors, plates = len(case.sensors), _plates(case, window, diffusivity)
    shape = window.rows, sensors + plates[0].shape[1]
    mean, mean_slope = np.zeros((2, *shape))
    components, component_slopes = np.zeros((2, COMPONENTS * sum(uncertain), *shape))
    used = 0
    for k, own in enumerate(section_minus_homogeneous(case, window, diffusivity)):
        if not uncertain[k]:
            mean[:, k], mean_slope[:, k] = own.readings[0], own.slopes[0]
            continue
        _, weights = candidate_heights(case, case.sensors[k])
        found, rows = principal_components(own, weights), slice(used, used + COMPONENTS)
        mean[:, k], mean_slope[:, k] = found.mean, found.mean_slope
        components[rows, :, k], component_slopes[rows, :, k] = found.components, found.component_slopes
        used += COMPONENTS
    mean[:, sensors:], mean_slope[:, sensors:] = plates
    return SectionPattern(*map(on_device, (np.log(diffusivity), mean, mean_slope, components, component_slopes)))


def _plates(case: Case, window: Window, diffusivity: float) -> tuple[np.ndarray, np.ndarray]:
    """The difference of the mean flux at each plate over the conductivity, K/m, and its derivative by ln(alpha)."""
    outputs = plate_outputs(case)
    if not outputs:
        return np.zeros((window.rows, 0)), np.zeros((window.rows, 0))
    data = with_filtered_faces(case, window, window_data(case, window))
    fourier = scales(case).fourier_number(diffusivity)
    systems = model_at(case, (), np.zeros(0), outputs), model_at(case.in_one_dimension(), (), np.zeros(0), outputs)
    (u, theta), (u_1, theta_1) = (map(np.asarray, explicit(system, on_device(fourier), data)) for system in systems)
    scale = float(data.temperature) / case.wall.length  # an output of flux is q L / k
    return scale * (u - u_1), scale * fourier * (theta - theta_1)
