"""A reduced-order model, learned from the full-order model by the Modal Identification Method."""

from .modal_identification import LearnedModel, choose_order, learn_system, sweep_orders
from .training_signals import learn, training_signals
from .variable_projection import TrainingSignals

__all__ = [
    "LearnedModel",
    "TrainingSignals",
    "choose_order",
    "learn",
    "learn_system",
    "sweep_orders",
    "training_signals",
]
