"""The thermal properties of one window, of many windows, of many walls."""

from .diffusivity import estimate, seconds_of_estimate
from .forecast_result import Forecast, StepErrors
from .forecasting import forecast
from .heat_flux import ThermalProperties
from .iso_9869 import AverageMethod, average_method, resistance_over_time
from .many_walls import WallEstimates, estimate_walls
from .many_windows import CampaignEstimate, campaign
from .one_dimension import CostOfOneDimension, HeightBias, cost_of_one_dimension
from .prediction import HeatLoads, Prediction, predict
from .result_objects import Estimate
from .unknown_heat import Follows, UnknownHeat, smoothed_disturbance

__all__ = [
    "AverageMethod",
    "CampaignEstimate",
    "CostOfOneDimension",
    "Estimate",
    "Follows",
    "Forecast",
    "HeatLoads",
    "HeightBias",
    "Prediction",
    "StepErrors",
    "ThermalProperties",
    "UnknownHeat",
    "WallEstimates",
    "average_method",
    "campaign",
    "cost_of_one_dimension",
    "estimate",
    "estimate_walls",
    "forecast",
    "predict",
    "resistance_over_time",
    "seconds_of_estimate",
    "smoothed_disturbance",
]
