"""Every result prints a table in a notebook, and gives its numbers as a dict that JSON can hold and as a DataFrame."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import wallid
from wallid import experiment_design, workflow
from wallid._internal.html import html_frame
from wallid._internal.result_object import ResultObject, plain_value
from wallid.case import check
from wallid.inference.quantity import Quantity

STAGES = ("check", "design", "learn", "orders", "estimate", "reliability", "lengths", "places")


@pytest.fixture(scope="module")
def run():
    case = wallid.load("saint_julien")
    part = case.record.window(0, 14 * 24)
    case = replace(case, record=part, choices=replace(case.choices, nodes=41, order=4))
    return workflow.run(case, stages=STAGES)


@pytest.fixture(scope="module")
def with_flux():
    """A steady slab with a flux plate, so that the arrays of a flux are in the results too."""
    time = np.arange(4 * 24) * 3600.0
    outside = 5.0 + 4.0 * np.sin(2 * np.pi * time / 86400.0)
    rng = np.random.default_rng(1)
    frame = pd.DataFrame({"in": 20.0 + 0 * time, "out": outside, "q": 30.0 - 2.0 * np.sin(2 * np.pi * time / 86400.0)})
    frame += 0.05 * rng.standard_normal(frame.shape)
    frame.index = pd.Index(pd.date_range("2024-01-05", periods=len(time), freq="h"), name="when")
    case = wallid.Case.from_dataframe(
        frame, left="in", right="out", length=0.3, diffusivity_prior=5e-7, regressors={"flux_left": "q"}, nodes=31
    )
    return case, wallid.estimate(case)


@pytest.fixture(scope="module")
def results(run, with_flux):
    case, fit = with_flux
    model = wallid.full_order_model(run.case)
    named = {
        "run": run, "case": run.case, "record": run.case.record, "cleaning": run.case.record.cleaning,
        "window": run.design.best, "model": model, "modes": model.modal(), "flux fit": fit, "thermal": fit.thermal,
        "average": fit.thermal.average_methods[0], "check of fluxes": check(case), **run.parts,
        "quantity": Quantity(1.0, np.nan, (np.nan, np.nan), "m"),
        "heat": run.prediction.loads,
        "walls": wallid.WallEstimates(*(jnp.array([1.0, np.inf]),) * 3, jnp.array([3, 4]), jnp.array([True, False])),
        "forecast": wallid.forecast(case, str(case.record.stamp(72)), 12.0),
        "campaign": wallid.campaign(replace(run.case, choices=replace(run.case.choices, window_days=7.0))),
    }  # fmt: skip
    return {name: one for name, one in named.items() if one is not None}


def test_all_public_results_are_among_those_tested(results):
    public = {one for name in wallid.__all__ if isinstance(one := getattr(wallid, name), type)}
    inputs = {wallid.Wall, wallid.Layer, wallid.Sensor, wallid.InputError, wallid.PlannedCampaign}
    tested = {type(one) for one in results.values()}
    elsewhere = {wallid.Diagnosis, wallid.CampaignPlan}  # in the tests of discrepancy and experiment_design
    assert public - inputs - tested == elsewhere
    assert all(issubclass(one, ResultObject) for one in elsewhere)
    assert {experiment_design.LengthComparison, experiment_design.SamplingComparison, workflow.Run} <= tested


def test_each_has_a_table_without_dumps_of_arrays(results):
    for name, one in results.items():
        html = one._repr_html_()
        assert html.count("<table>") == html.count("</table>") >= 1, name
        assert "array(" not in html and "nan" not in html, name
        longest = 20_000 if one is results["run"] else 5_000
        assert len(html) < longest, (name, len(html))
        assert len(repr(one)) < 20_000, (name, len(repr(one)))


def test_each_dict_is_json_without_nan(results):
    for name, one in results.items():
        entries = one.to_dict()
        assert entries == json.loads(json.dumps(entries, allow_nan=False)), name
        assert entries, name


def test_each_frame_has_rows(results):
    for name, one in results.items():
        frame = one.to_frame()
        assert isinstance(frame, pd.DataFrame), name
        assert len(frame) or name in ("cleaning", "check", "check of fluxes"), name


def test_the_frame_of_an_estimate_has_one_row_for_each_quantity(run, with_flux):
    frame = run.fit.to_frame()
    assert list(frame.columns) == ["value", "std", "low", "high", "unit"] and frame.index.name == "quantity"
    row = frame.loc["diffusivity"]
    assert (row["value"], row["std"], row["low"], row["high"]) == (run.fit.value, run.fit.std, *run.fit.interval_95)
    shift, std = run.fit.positions["T1"]
    row = frame.loc["position error of T1"]
    assert (
        row["value"] == shift and row["unit"] == "m" and np.isclose(row["high"] - row["value"], 1.96 * std, rtol=1e-4)
    )
    thermal = with_flux[1].to_frame()
    assert thermal.loc["transmittance", "unit"] == "W/m2/K"
    assert thermal.loc["transmittance", "value"] == with_flux[1].thermal.transmittance.value
    assert run.to_frame().equals(frame)


def test_the_time_series_have_the_times_of_the_record(run):
    case = run.case
    frame = run.fit.readings_to_frame(case)
    rows = run.fit.window.as_slice
    assert frame.index.equals(case.to_frame().index[rows])
    assert np.allclose(frame["T2"]["measured"], case.record.sensors[rows, 1], rtol=0, atol=1e-9)
    assert np.allclose(frame["T2"]["measured"] - frame["T2"]["predicted"], frame["T2"]["residual"])
    whole = run.prediction.to_frame()
    assert whole.index.equals(case.to_frame().index)
    assert np.array_equal(whole["T1"]["measured"], case.record.sensors[:, 0], equal_nan=True)
    assert np.array_equal(whole["inner face"]["flux"], run.prediction.loads.flux, equal_nan=True)
    with pytest.raises(wallid.InputError, match="must be the case of this estimate"):
        run.fit.readings_to_frame(replace(case, sensors=case.sensors[:2], record=replace(
            case.record, sensors=case.record.sensors[:, :2], names=case.record.names[:2])))  # fmt: skip


def test_the_frame_of_fluxes_has_their_plates(with_flux):
    case, fit = with_flux
    frame = fit.readings_to_frame(case)
    assert list(frame.columns.get_level_values(0).unique()) == ["flux_left"]
    assert np.allclose(frame["flux_left"]["measured"], case.record.regressors["flux_left"])


@pytest.mark.parametrize("zone", [None, "UTC", "+02:00"])
def test_a_record_goes_through_a_frame_and_back(zone):
    """The truth is the frame itself, with a missing reading and a zone."""
    times = pd.date_range("2024-03-01", periods=48, freq="30min", tz=zone, name="when")
    phases = np.arange(48)[:, None] / 24.0 + np.arange(3)
    frame = pd.DataFrame(10.0 + 2.0 * np.sin(phases), index=times, columns=["left", "right", "T1"])
    frame.iloc[5, 2] = np.nan

    def case_of(data):
        return wallid.Case.from_dataframe(
            data, left="left", right="right", length=0.3, diffusivity_prior=5e-7, sensors={"T1": 0.1}, noise_std=0.1,
            window_days=0.5,
        )  # fmt: skip

    case = case_of(frame)
    again = case_of(case.to_frame())
    assert np.array_equal(again.record.sensors, case.record.sensors, equal_nan=True)
    assert np.array_equal(case.to_frame().to_numpy(), frame.to_numpy(), equal_nan=True)
    assert list(case.to_frame().index) == list(frame.index)
    assert again.record.zone == case.record.zone


def test_the_frame_of_a_design_names_the_best_window(run):
    frame = run.design.to_frame()
    best = frame["relative_criterion"].idxmax()
    assert frame.loc[best, "row"] == run.design.best.row and f"{best:%Y-%m-%dT%H:%M:%S}" in run.design.labels[0]
    assert np.isclose(frame["expected_relative_std"].min(), run.design.expected_relative_std)


def test_the_frame_of_a_model_has_one_row_for_each_mode(run):
    frame = run.learned.to_frame()
    assert np.array_equal(frame["rate"], run.learned.system.A) and (frame["rate"] < 0).all()
    assert np.array_equal(frame["C of T1"], run.learned.system.C[0])


def test_a_stack_of_models_has_a_table(run):
    model = run.learned.system
    assert "<td>3</td>" in wallid.models.stack([model] * 3)._repr_html_()


def test_a_run_shows_all_its_parts_and_its_reason(run):
    html = run._repr_html_()
    for part in run.parts.values():
        assert part._repr_html_() in html
    doubtful = replace(run, fit=replace(run.fit, reliable=False, reason="too <short>"))
    assert "Not to be relied on: too &lt;short&gt;" in doubtful._repr_html_()
    assert set(run.to_dict()) == {"case", *run.parts, "unreliable_reason", "seconds"}


def test_long_tables_are_cut_and_texts_escaped():
    html = html_frame("a < b", pd.DataFrame({"x_y": np.linspace(0, 1, 50), "text": ["<i>"] * 50}))
    assert html.count("<tr>") == 22 and "and 30 more rows" in html
    assert "a &lt; b" in html and "&lt;i&gt;" in html and "<th>x y</th>" in html


def test_plain_values():
    day = np.array(["2024-01-01"], "datetime64[D]")
    given = {"a": np.inf, 1: (np.float64(2.0), np.bool_(True)), "t": day, "d": day[0], "n": np.array([[1, 2]])}
    assert plain_value(given) == {
        "a": None, "1": [2.0, True], "t": ["2024-01-01"], "d": "2024-01-01", "n": [[1, 2]],
    }  # fmt: skip
