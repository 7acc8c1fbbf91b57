"""Direct simulation of the validation case: 2881 rows of 30 s, 75 nodes, 5 sensors, field and sensitivity."""

import numpy as np

import wallid
from benchmarks.speed.works.direct import Direct
from benchmarks.speed.works.ratio import Asked, Results, faster, within

TITLE = "direct simulation, validation case: 2881 rows of 30 s, 75 nodes, 5 sensors, field and sensitivity"
DAY = 86400.0


def _direct() -> Direct:
    case = wallid.load("validation")
    fourier = wallid.case.scales(case).fourier_number(5.21e-7)
    window = wallid.Window(0, case.record.rows)
    return Direct(case, 75, window, np.array([fourier]), order=5, heun_step=30 / DAY, longest=600 / DAY)


def _large(anew: bool = False):
    direct = _direct()
    return direct.ours(direct.nodal if anew else direct.nodal.modal(), anew=anew)


def _reduced():
    direct = _direct()
    return direct.ours(direct.reduced)


CONTENDERS = {
    "exact LOM": _large,
    "exact LOM, eigenvalues anew": lambda: _large(anew=True),
    "MIM 5": _reduced,
    "lsim": lambda: _direct().lsim(),
    "BDF": lambda: _direct().bdf(),
    "diffrax Heun 30 s": lambda: _direct().heun(),
    "C recurrence of order 5": lambda: _direct().limit(),
}
IN_TURNS = ("exact LOM", "MIM 5", "C recurrence of order 5")
# as it comes, without what wallid asks of XLA
PLAIN = ("diffrax Heun 30 s",)


def asked(results: Results) -> list[Asked]:
    """What the issue asks."""
    return [
        faster(results, "exact LOM", "lsim", 30),
        faster(results, "exact LOM", "diffrax Heun 30 s", 15),
        within(results, "MIM 5", "C recurrence of order 5", 3),
    ]
