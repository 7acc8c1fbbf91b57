"""The same simulation for 50 diffusivities at once."""

import numpy as np

import wallid
from benchmarks.speed.works.direct import Direct
from benchmarks.speed.works.ratio import Asked, Results, within

TITLE = "the same for 50 diffusivities at once (seconds of one diffusivity)"
DAY = 86400.0


def _direct() -> Direct:
    case = wallid.load("validation")
    fouriers = np.array([wallid.case.scales(case).fourier_number(alpha) for alpha in np.linspace(2.03e-7, 6.37e-7, 50)])
    return Direct(
        case, 75, wallid.Window(0, case.record.rows), fouriers, order=5, heun_step=30 / DAY, longest=600 / DAY
    )


def _large(sweep: str):
    direct = _direct()
    return direct.ours(direct.nodal.modal(), sweep=sweep)


def _reduced(sweep: str):
    direct = _direct()
    return direct.ours(direct.reduced, sweep=sweep)


CONTENDERS = {
    "exact LOM, vmap": lambda: _large("vmap"),
    "exact LOM, lax.map": lambda: _large("map"),
    "MIM 5, vmap": lambda: _reduced("vmap"),
    "MIM 5, lax.map": lambda: _reduced("map"),
    "loop of lsim": lambda: _direct().lsim(),
    "loop of the C recurrence": lambda: _direct().limit(),
}
IN_TURNS = ("MIM 5, vmap", "MIM 5, lax.map", "loop of the C recurrence")


def asked(results: Results) -> list[Asked]:
    """What the issue asks, of the better of the two sweeps."""
    both = [name for name in ("MIM 5, vmap", "MIM 5, lax.map") if name in results]
    best = min(both, key=lambda name: results[name].each, default="MIM 5, vmap")
    return [within(results, best, "loop of the C recurrence", 2)]
