"""The direct problem that the works share: a model, its inputs, the contenders at field and sensitivity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import wallid
from benchmarks.reference.c_recurrence import compiled
from benchmarks.reference.integrators import by_bdf, by_heun, by_lsim
from benchmarks.speed.learned_models import learned
from benchmarks.speed.measure import Prepared


@dataclass(frozen=True)
class Direct:
    """A wall's large model under a record, and what is run on it.

    **Arguments:** `fouriers`: at which; the answers compared are the last one's; `order`: of the reduced model;
    `heun_step`: in t_ref; `longest`: step of BDF, in t_ref.
    """

    case: wallid.Case
    nodes: int
    window: wallid.Window
    fouriers: np.ndarray
    order: int
    heun_step: float
    longest: float

    @cached_property
    def data(self) -> wallid.models.WindowData:
        """The window's, with straight lines between rows as lsim has them."""
        data = wallid.models.window_data(self.case, self.window)
        return replace(data, inputs=data.inputs[:, :2])

    @cached_property
    def nodal(self) -> wallid.StateSpace:
        outputs = [wallid.models.Output(sensor.position) for sensor in self.case.sensors]
        degree = int(self.data.initial.shape[0]) - 1
        return wallid.models.finite_volume_model(self.case.wall, outputs, nodes=self.nodes, profile_degree=degree)

    @cached_property
    def reduced(self) -> wallid.StateSpace:
        return learned(self.case, self.window, self.order)

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, inputs, profile."""
        return np.asarray(self.data.time), np.asarray(self.data.inputs), np.asarray(self.data.initial)

    @cached_property
    def reference(self) -> tuple[np.ndarray, np.ndarray]:
        """lsim's answer on the same mesh at the last Fourier number: exact in time by another way."""
        return by_lsim(self.nodal, *self.arrays)(float(self.fouriers[-1]))

    def error(self, pick: Callable[[Any], tuple]) -> Callable[[Any], dict[str, float]]:
        """Largest differences of u and theta from the reference."""

        def of(answer: Any) -> dict[str, float]:
            want = self.reference
            u, theta = (np.asarray(part) for part in pick(answer))
            return {"u": np.abs(u - want[0]).max(), "theta": np.abs(theta - want[1]).max()}

        return of

    def ours(self, system: wallid.StateSpace, *, anew: bool = False, sweep: str | None = None) -> Prepared:
        """`propagate`: one number by itself, or all of them swept; `anew`: with the eigenvalues in every run."""
        data, fouriers = self.data, jnp.asarray(self.fouriers)
        rows = data.step, data.inputs, data.initial

        def one(model: wallid.StateSpace, fo: jax.Array) -> tuple:
            return wallid.models.propagate(model, fo, *rows, sensitivity=True)

        if sweep is None:
            last = fouriers[-1]  # taking it out of the others is a call too
            return Prepared(
                lambda: jax.block_until_ready(one(system.modal() if anew else system, last)),
                self.error(lambda answer: answer),
            )
        over = jax.vmap if sweep == "vmap" else lambda f: lambda many: jax.lax.map(f, many)
        swept = jax.jit(lambda many: over(lambda fo: one(system, fo))(many))
        return Prepared(
            lambda: jax.block_until_ready(swept(fouriers)),
            self.error(lambda answer: (answer[0][-1], answer[1][-1])),
            units=len(fouriers),
        )

    def rival(self, run: Callable[[float], tuple], *, once: bool = False) -> Prepared:
        """A rival that takes one number after the other."""

        def every() -> tuple:
            for fourier in self.fouriers:
                answer = run(float(fourier))
            return answer

        return Prepared(every, self.error(lambda answer: answer), units=len(self.fouriers), once=once)

    def lsim(self, *, once: bool = False) -> Prepared:
        """SciPy's exact integration."""
        return self.rival(by_lsim(self.nodal, *self.arrays), once=once)

    def bdf(self, *, once: bool = False) -> Prepared:
        """SciPy's BDF."""
        return self.rival(by_bdf(self.nodal, *self.arrays, self.longest), once=once)

    def heun(self, *, once: bool = False) -> Prepared:
        """Plain diffrax."""
        start = np.asarray(self.nodal.P @ self.data.initial)
        time, inputs, _ = self.arrays
        C, D = np.asarray(self.nodal.C), np.asarray(self.nodal.D)
        return self.rival(by_heun(1.0 / (self.nodes - 1), C, D, time, inputs, start, self.heun_step), once=once)

    def limit(self) -> Prepared:
        """The C recurrence of the reduced model."""
        run = compiled(self.reduced, float(self.data.step), *map(np.asarray, (self.data.inputs, self.data.initial)))
        run(self.fouriers)  # JAX makes its matrices, which are no part of it
        last = self.error(lambda answer: (answer[0][-1], answer[1][-1]))
        return Prepared(lambda: run(self.fouriers), last, units=len(self.fouriers))
