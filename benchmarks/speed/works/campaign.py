"""The hourly campaign: 2670 rows of the twin, 100 nodes, field and sensitivity."""

import numpy as np

import wallid
from benchmarks.speed.works.direct import Direct
from benchmarks.speed.works.ratio import Asked, Results, faster

TITLE = "hourly campaign: 2670 rows, 100 nodes, 3 sensors, field and sensitivity"
DAY = 86400.0


def _direct() -> Direct:
    case = wallid.load("saint_julien")
    fourier = wallid.case.scales(case).fourier_number(1.06e-6)
    # Heun is stable up to 2 / (4 Fo / dx^2): 8.9 s
    return Direct(
        case, 100, wallid.Window(0, case.record.rows), np.array([fourier]), 10, heun_step=8.0 / DAY, longest=3600 / DAY
    )


def _large():
    direct = _direct()
    return direct.ours(direct.nodal.modal())


def _reduced():
    direct = _direct()
    return direct.ours(direct.reduced)


CONTENDERS = {
    "exact LOM": _large,
    "MIM 10": _reduced,
    "lsim": lambda: _direct().lsim(),
    "BDF": lambda: _direct().bdf(once=True),
    "diffrax Heun 8 s": lambda: _direct().heun(once=True),
    "C recurrence of order 10": lambda: _direct().limit(),
}
# as it comes, without what wallid asks of XLA
PLAIN = ("diffrax Heun 8 s",)


def asked(results: Results) -> list[Asked]:
    """What the issue asks."""
    return [faster(results, "exact LOM", "diffrax Heun 8 s", 100)]
