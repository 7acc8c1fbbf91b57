"""What to measure: the days, the sensors' positions, the sampling step and the length that give most information."""

from .campaign_plan.plan_result import CampaignPlan
from .sampling_step import SamplingComparison, compare_sampling_steps
from .sensor_placement import SensorPlacement, place_sensors
from .window_lengths import LengthComparison, compare_lengths
from .window_selection import Design, design

__all__ = [
    "CampaignPlan",
    "Design",
    "LengthComparison",
    "SamplingComparison",
    "SensorPlacement",
    "compare_lengths",
    "compare_sampling_steps",
    "design",
    "place_sensors",
]
