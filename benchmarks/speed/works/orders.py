"""Learning for the case study's window, orders to 20: the paper took three days of computing."""

import jax

import wallid
from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.ratio import Asked, Results, seconds_of

TITLE = "learning for the case study's window, all orders from 1 to 20"


def _orders() -> Prepared:
    case = wallid.load("saint_julien")
    window = wallid.design(case).best
    lom, signals = wallid.full_order_model(case), wallid.reduction.training_signals(case, window)

    def run() -> list[wallid.LearnedModel]:
        return list(wallid.reduction.sweep_orders(lom, range(1, 21), signals))

    def error(learned: list[wallid.LearnedModel]) -> dict[str, float]:
        jax.block_until_ready(learned[-1].system)
        return {f"order {one.system.order}": one.eps_inf[0] for one in learned if one.system.order in (5, 10, 20)}

    return Prepared(run, error, once=True)


CONTENDERS = {"wallid, compilation included": _orders}


def asked(results: Results) -> list[Asked]:
    """What the issue asks."""
    return [Asked("all orders", seconds_of(results, "wallid, compilation included"), 60, at_least=False, unit="s")]
