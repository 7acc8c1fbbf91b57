"""`wallid diagnose`: what it writes, and its figures: the numbers drawn are those of the explanation."""

import json
from dataclasses import replace
from html import unescape

import jsonschema
import matplotlib.pyplot as plt
import numpy as np
import pytest
from axes import check_complete
from benchmarks.reference.simulator_with_effects import Spec, write_case
from legend_overlap import lines_in_legend
from matplotlib.text import Text
from pages import check
from results import DIAGNOSIS, SCHEMA
from typer.testing import CliRunner

import wallid
from wallid import plot, workflow
from wallid._internal.number_formats import format_text, terminal_text
from wallid.cli.commands import app
from wallid.discrepancy.next_measurement.actions import Action, Prescription
from wallid.discrepancy.selection.acceptance import FIRST_EFFECT_LEVEL
from wallid.discrepancy.unexplained_heat import UnexplainedHeat
from wallid.plot import missing_effects as drawn
from wallid.plot import residuals as remainder
from wallid.plot.house_style import contrast
from wallid.report import figures
from wallid.report.captions import alternative_text
from wallid.report.next_steps import next_steps
from wallid.report.page import render_page as page_of
from wallid.report.result_json import result_entries
from wallid.report.svg import draw_figure
from wallid.workflow import Run


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """The command on ten days in which a sensor lags by 40 minutes, by the independent simulator: the case's file,
    how it ended, and what its search found."""
    folder = tmp_path_factory.mktemp("hidden")
    hidden = (("sensor_lag", "T1", {"time_constant": 2400.0}),)
    write_case(Spec(days=10.0, positions=(0.06, 0.2), effects=hidden), folder)
    path, found = folder / "case.toml", []
    path.write_text(path.read_text() + "[choices]\ndiagnose_days = 9\n")

    def explain(case, progress):
        found.append(wallid.diagnose(case, progress=progress))
        return found[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workflow, "diagnose", explain)
        ended = CliRunner().invoke(app, ["diagnose", str(path), "--json", "--out", str(folder / "out")])
    return path, ended, found


@pytest.fixture(scope="module")
def explanation(diagnosed):
    """What the command found, once for all that is told of it."""
    _, ended, found = diagnosed
    assert ended.exit_code == 0, ended.output
    (explanation,) = found
    assert explanation.effects, explanation
    return explanation


@pytest.fixture(scope="module")
def adequate(explanation):
    """The same, as if nothing had been found beside the plain model."""
    gap = explanation.gap
    gap = replace(gap, after=gap.before, held_out_after=gap.held_out_before, noise_floor=gap.before)
    case = explanation.problem.case
    wide = replace(case.choices, largest_interval_factor=1e3)  # its plain interval is that of a model that is wrong
    return replace(
        explanation,
        problem=replace(explanation.problem, case=replace(case, choices=wide)),
        after=explanation.before,
        effects=(),
        residual_tests_after=replace(explanation.residual_tests_before, p_value=0.5),
        trials=(),
        rivals=(),
        gap=gap,
    )


@pytest.fixture
def ax():
    with plot.style():
        yield plot.figure()[1]


def test_the_waterfall_goes_from_the_plain_model_to_what_is_left(ax, explanation):
    plot.waterfall(explanation, ax=ax)
    first, *between, last = ax.patches
    gap = explanation.gap
    assert first.get_y() == 0 and first.get_height() == gap.before
    assert last.get_y() == 0 and last.get_height() == gap.after
    assert len(between) == len(explanation.effects)
    ends = [gap.before]
    for bar in between:
        assert bar.get_y() == pytest.approx(ends[-1])
        ends.append(bar.get_y() + bar.get_height())
    assert ends[-1] == pytest.approx(gap.after)
    lines = {line.get_label(): line for line in ax.lines}
    (floor,) = [line for label, line in lines.items() if label.startswith("noise alone")]
    assert set(floor.get_ydata()) == {gap.noise_floor}
    assert list(lines["on days left out of the fit"].get_ydata()) == [gap.held_out_before, gap.held_out_after]


@pytest.mark.parametrize("share", [0.9, 1.0, 1.001, 1.01, 1.03, 1.06, 1.1, 1.3])
@pytest.mark.parametrize("size", [(8.0, 3.2), (4.0, 2.0)])
def test_no_line_strikes_a_number_of_the_waterfall(adequate, share, size):
    """The noise alone may be just above a bar, where the bar's number would stand."""
    gap = replace(adequate.gap, noise_floor=share * adequate.gap.before)
    _, ax = plot.figure(width=size[0], height=size[1])
    plot.waterfall(replace(adequate, gap=gap), ax=ax)
    assert not lines_in_legend(ax)
    (number,) = ax.texts
    box, line = number.get_window_extent(), ax.transData.transform((0.0, gap.noise_floor))[1]
    assert not box.y0 < line < box.y1
    assert box.y1 <= ax.get_legend().get_window_extent().y0


def test_effects_without_a_model_between_them_come_in_together(explanation):
    """Two effects, of which the search has fitted the first alone, or has not."""
    (one, *_) = explanation.effects
    other = next(slot for slot in explanation.problem.library if slot.effect.name == "clock_shift")
    pair = replace(explanation, effects=(one, replace(one, effect_parameters=other)), trials=())
    labels = [pair.problem.label(named.effect_parameters.effect) for named in pair.effects]
    assert drawn.waterfall_steps(pair) == [
        ("plain model", pair.gap.before),
        (" and ".join(labels), pair.gap.after),
    ]
    alone = [trial for trial in explanation.trials if trial.fit.active == (one.effect_parameters,)]
    assert alone
    steps = drawn.waterfall_steps(replace(pair, trials=tuple(alone)))
    best = min(alone, key=lambda trial: trial.fit.cost)
    assert steps[1:] == [(labels[0], best.fit.gap), (labels[1], pair.gap.after)]


def test_the_ranked_gains_are_those_of_the_table(ax, explanation):
    plot.ranked_gains(explanation, ax=ax)
    rows = [row for row in explanation.table if row.expected_gain > 0][:12]
    assert [label.get_text() for label in ax.get_yticklabels()] == [row.label for row in rows]
    points = {}
    for line in ax.lines:
        if line.get_label() in ("in the model", "indistinguishable from it", "not selected"):
            points |= dict(zip(line.get_ydata(), line.get_xdata(), strict=True))
    assert [points[place] for place in range(len(rows))] == [row.expected_gain for row in rows]


def test_the_heatmap_is_symmetric_with_ones_on_its_diagonal(ax, explanation):
    mesh = plot.cosine_similarity(explanation, ax=ax).collections[0]
    alike = np.asarray(mesh.get_array())
    assert len(alike) == min(12, len(explanation.table))
    np.testing.assert_allclose(np.diag(alike), 1.0)
    np.testing.assert_array_equal(alike, alike.T)
    assert alike.min() >= 0 and alike.max() <= 1 + 1e-12
    labels = [label.get_text() for label in ax.get_xticklabels()]
    assert labels == [row.label for row in explanation.table[: len(labels)]]


def test_the_map_shows_the_remainder(ax, explanation):
    limit = plot.colour_limit(explanation)
    mesh = plot.residual_map(explanation.after, limit, "after", ax=ax).collections[0]
    np.testing.assert_array_equal(np.asarray(mesh.get_array()), explanation.after.residual_at_rows.T)
    assert mesh.get_clim() == (-limit, limit)
    assert f"{explanation.gap.after:.3g} K" in ax.get_title(loc="left")


def test_the_mean_residual_by_hour(ax, explanation):
    plot.hourly_residual(explanation.after, explanation.residual_tests_after.by_hour, "", ax=ax)
    first = explanation.after.residual_at_rows[:, 0].reshape(9, 24)  # whole days from midnight
    np.testing.assert_allclose(ax.lines[0].get_ydata(), first.mean(axis=0))


def test_the_worst_week_is_the_worst(explanation):
    rest = explanation.before.residual_at_rows
    week = drawn.worst_week(explanation.before)
    assert week.stop - week.start == 168
    sizes = [np.sum(rest[first : first + 168] ** 2) for first in range(len(rest) - 167)]
    assert week.start == int(np.argmax(sizes))


def test_sizes_by_window(ax, explanation):
    named = explanation.effects[0]
    plot.size_by_window(explanation, named, ax=ax)
    (bars,) = ax.containers
    points, _, (errors,) = bars.lines
    np.testing.assert_array_equal(points.get_ydata(), named.windows.size)
    half = [np.ptp(segment[:, 1]) / 2 for segment in errors.get_segments()]
    np.testing.assert_allclose(half, 1.96 * named.windows.std, rtol=1e-3)


def test_the_periodogram_of_white_noise_keeps_to_its_band(ax, explanation):
    """Ninety-five in a hundred, within what 400 draws tell; a daily wave leaves it at one a day."""
    rng = np.random.default_rng(11)
    plot.cumulative_periodogram(explanation.before, "", ax=ax)
    (band,) = ax.collections
    assert band.get_alpha() == 0.25, "a shade on white and on the dark page"
    corners = band.get_paths()[0].vertices
    frequency, _ = remainder.cumulative_power(rng.normal(size=216), 3600.0)
    lower, upper = ([f(corners[corners[:, 0] == x, 1]) for x in frequency[:-1]] for f in (np.min, np.max))
    inside = 0
    for _ in range(400):
        _, share = remainder.cumulative_power(rng.normal(size=216), 3600.0)
        inside += bool(np.all((share[:-1] >= lower) & (share[:-1] <= upper)))
    assert inside / 400 == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / 400))
    frequency, share = remainder.cumulative_power(np.sin(2 * np.pi * np.arange(216) / 24), 3600.0)
    assert share[frequency < 0.99].max() < 1e-12 and share[np.argmin(np.abs(frequency - 1))] > 1 - 1e-12


def test_the_noise_expected_is_that_of_the_covariance(explanation):
    """Rows were not binned here: the fit's own covariance, taken to frequencies, gives the same shares."""
    fit = explanation.before
    rows, assumed = fit.problem.record.rows, remainder.expected_cumulative_power(fit)
    assert fit.problem.bins.rows_per_bin == 1
    wave = np.exp(-2j * np.pi * np.outer(np.arange(1, (rows + 1) // 2), np.arange(rows)) / rows)
    for s in range(fit.problem.sensor_count):
        own = slice(s * rows, (s + 1) * rows)
        power = np.einsum("fi,ij,fj->f", wave, fit.noise.covariance[own, own], wave.conj()).real
        np.testing.assert_allclose(assumed[:, s], np.cumsum(power) / power.sum(), atol=0.02)


def test_a_missing_reading_moves_no_frequency():
    values = np.random.default_rng(5).normal(20.0, 1.0, 240)
    values[30:60] = np.nan
    frequency, share = remainder.cumulative_power(values, 3600.0)
    assert np.isfinite(share).all() and share[-1] == pytest.approx(1.0) and frequency[0] == pytest.approx(0.1)
    assert np.isfinite(remainder.cumulative_power(np.full(240, np.nan), 3600.0)[1]).all()


@pytest.fixture(scope="module")
def unnamed(explanation):
    """The same, as if something were left."""
    return replace(explanation, residual_tests_after=replace(explanation.residual_tests_after, p_value=1e-6))


@pytest.mark.parametrize(("found", "panels"), [("explanation", 2), ("adequate", 1), ("unnamed", 2)])
def test_every_figure_is_drawn_with_units_on_its_axes(request, tmp_path, found, panels):
    explanation = request.getfixturevalue(found)
    made = dict(figures.diagnosis_figures(explanation))
    assert set(made) == {"missing", "residuals", "fit", "periodogram"} | (
        {"windows"} if explanation.effects else set()
    ) | ({"remainder"} if found == "unnamed" else set()) | ({"confusable"} if found != "adequate" else set())
    assert len(made["periodogram"].axes) == panels
    for stem, figure in made.items():
        figure.savefig(tmp_path / f"{stem}.png")
        for ax in figure.axes:
            for label, ticks in ((ax.get_xlabel(), ax.get_xticklabels()), (ax.get_ylabel(), ax.get_yticklabels())):
                named = any(tick.get_text() and not tick.get_text()[0].isdigit() for tick in ticks)
                assert "(" in label or "day" in label or "time" in label or named or not ticks, (stem, ax)


@pytest.mark.parametrize(
    "draw",
    [
        lambda ax, found: plot.waterfall(found, ax=ax),
        lambda ax, found: plot.ranked_gains(found, ax=ax),
        lambda ax, found: plot.week_readings(found, 0, ax=ax),
        lambda ax, found: plot.week_residuals(found, 0, ax=ax),
        lambda ax, found: plot.hourly_residual(found.before, found.residual_tests_before.by_hour, "by hour", ax=ax),
        lambda ax, found: plot.cumulative_periodogram(found.before, "periodogram", ax=ax),
        lambda ax, found: plot.smooth_residual(found.before, found.residual_tests_before, ax=ax),
        lambda ax, found: plot.size_by_window(found, found.effects[0], ax=ax),
        lambda ax, found: plot.residual_map(found.before, plot.colour_limit(found), "map", ax=ax),
        lambda ax, found: plot.cosine_similarity(found, ax=ax),
    ],
)
def test_a_figure_of_a_diagnosis_on_plain_axes_is_complete(explanation, draw):
    """A legend, or a colour bar with its label."""
    with plt.rc_context(plt.rcParamsDefault):
        figure, ax = plt.subplots()
        draw(ax, explanation)
        colours = len(figure.axes) == 2
        assert colours == (ax.get_legend() is None) and (not colours or figure.axes[1].get_ylabel())
        assert not lines_in_legend(ax)
        check_complete(ax, legend=not colours, named=not ax.get_xlabel() and bool(ax.get_xticklabels()))
        plt.close(figure)


def test_panels_that_share_a_legend_have_none_of_their_own(explanation):
    for stem, figure in figures.diagnosis_figures(explanation):
        if stem in ("residuals", "fit", "periodogram"):
            assert len(figure.legends) == 1 and all(ax.get_legend() is None for ax in figure.axes), stem
        if stem == "residuals":
            assert sum("minus simulated (K)" in ax.get_ylabel() for ax in figure.axes) == 1


def test_chance_is_what_the_tables_reasons_say(ax, explanation):
    plot.ranked_gains(explanation, ax=ax)
    (line,) = [line for line in ax.lines if line.get_label() == "threshold, 3 % false-alarm rate"]
    assert FIRST_EFFECT_LEVEL == 0.03 and set(line.get_xdata()) == {explanation.scores.threshold(FIRST_EFFECT_LEVEL)}


def test_a_size_has_its_unit_as_a_person_writes_it(ax, explanation):
    slot = next(slot for slot in explanation.problem.library if "m2" in slot.effect.parameters[0].unit)
    size = slot.effect.parameters[0]
    plot.size_by_window(
        explanation, replace(explanation.effects[0], effect_parameters=slot, values={size.name: (1.0, 0.1)}), ax=ax
    )
    assert "m²" in ax.get_ylabel() and "m2" not in ax.get_ylabel()


def test_one_window_alone_is_the_same_as_no_other(ax, explanation):
    named = explanation.effects[0]
    plot.size_by_window(explanation, named, ax=ax)
    assert "p = " in ax.get_title(loc="left")
    alone = replace(named.windows, size=np.where(np.arange(4) == 1, named.windows.size, np.nan))
    plot.size_by_window(explanation, replace(named, windows=alone), ax=ax)
    assert "p = " not in ax.get_title(loc="left")


def test_numbers_stand_out_on_their_cells_and_keep_their_colour(ax, explanation):
    """WCAG 2.2, 1.4.3: 4.5:1 on every cell; the dark page leaves them as they are."""
    mesh = plot.cosine_similarity(explanation, ax=ax).collections[0]
    alike = np.asarray(mesh.get_array())
    assert len(ax.texts) == alike.size
    for text, value in zip(ax.texts, alike.ravel(), strict=True):
        assert contrast(text.get_color(), mesh.to_rgba(value)) >= 4.5 and text.get_gid() == "keep-colour"


def test_a_missing_reading_is_neither_warm_nor_cold(ax, explanation):
    mesh = plot.residual_map(explanation.after, 1.0, "after", ax=ax).collections[0]
    grey = mesh.to_rgba(np.nan)
    assert grey[3] == 1.0 and grey[0] == grey[1] == grey[2] < 0.8


def test_the_smooth_remainder_is_drawn_with_the_days_means(ax, unnamed):
    fit, left = unnamed.after, unnamed.residual_tests_after
    plot.smooth_residual(fit, left, ax=ax)
    lines = [line for line in ax.lines if line.get_label() in ("T1", "T2")]
    for s, line in enumerate(lines):
        np.testing.assert_allclose(line.get_ydata(), left.smooth_residual[:, s])
    dots = [line for line in ax.lines if line.get_marker() == "."]
    assert len(dots) == 2 * 9
    first = fit.residual_at_rows[: 86400 // int(fit.problem.record.step), 0]
    assert dots[0].get_ydata()[0] == pytest.approx(np.nanmean(first))


def test_where_nothing_was_added_there_is_one_model(adequate):
    _, axes = plot.figure(1, 3)
    plot.waterfall(adequate, ax=axes[0])
    assert len(axes[0].patches) == 1
    plot.week_readings(adequate, 0, ax=axes[1])
    assert [line.get_label() for line in axes[1].lines] == ["measured", "plain model"]
    plot.week_residuals(adequate, 0, ax=axes[2])
    assert len(axes[2].lines) == 2  # and the zero


def test_an_effect_that_may_not_stand_is_nowhere_told_as_found(explanation):
    """Legends, titles, table, captions: the nearest known effect, and that it was refused."""
    unnamed = replace(explanation, residual_tests_after=replace(explanation.residual_tests_after, p_value=1e-9))
    assert unnamed.verdict == "unnamed" and unnamed.effects
    drawn_ = dict(figures.diagnosis_figures(unnamed))
    seen = {text.get_text() for made in drawn_.values() for text in made.findobj(Text)}
    assert not [text for text in seen if "ith the effect" in text or text == "in the model"]
    assert {"nearest effect, refused", "with the nearest effect, refused"} <= seen
    run = Run(unnamed.problem.case, diagnosis=unnamed)
    text = check(page_of(run, result_entries(run), [draw_figure(*one) for one in drawn_.items()])).text
    assert ">in the model<" not in text and "the nearest known effect, refused" in text
    assert all("refused" in alternative_text(stem, run) for stem in ("missing", "residuals"))


def test_one_quarter_that_tells_a_size_is_compared_with_none(explanation):
    (named, *_) = explanation.effects
    sizes = np.full(len(named.windows.size), np.nan)
    sizes[1] = 2400.0
    alone = replace(explanation, effects=(replace(named, windows=replace(named.windows, size=sizes, p_value=1.0)),))
    title = dict(figures.diagnosis_figures(alone))["windows"].axes[0].get_title(loc="left")
    assert "p =" not in title and "1 of 4 quarters" in title
    assert "(1 of 4 are informative)" in str(alone) and alone.to_dict()["effects"][0]["windows"]["p_value"] is None


def test_the_similarity_of_effects_is_shown_only_where_one_may_be_missing(adequate, unnamed):
    """Where the record is explained, every effect of the matrix is chance."""
    for found, shown in ((adequate, False), (unnamed, True)):
        run = Run(found.problem.case, diagnosis=found)
        drawn_ = [draw_figure(*one) for one in figures.diagnosis_figures(found)]
        text = page_of(run, result_entries(run), drawn_)
        assert (found.verdict == "adequate") != shown and ("Similarity of the effects" in text) == shown


def page_with(found):
    """The report of a diagnosis, its text and its figures."""
    run, made = Run(found.problem.case, diagnosis=found), dict(figures.diagnosis_figures(found))
    html = page_of(run, result_entries(run), [draw_figure(*one) for one in made.items()])
    return run, check(html).text, made


def effect_of(found, name):
    return next(one for one in found.problem.library if one.effect.name == name)


def test_the_report_says_what_to_measure_next(adequate, unnamed):
    """One question with a sensor's place, and two columns that were not logged, which share a panel."""
    two = effect_of(unnamed, "sensor_offset"), effect_of(unnamed, "face_offset")
    sensor = Action("sensor", {"position": 0.1}, 10.0, 3.0, 0.8)
    question = Prescription(two, ("one", "other"), 0.2, (sensor,), ("sensor",), ((0.05, 0.6), (0.1, 0.8)))
    columns = tuple(
        Prescription((effect_of(unnamed, name),), (name,), 0.0, (action,), ("column",), column=column)
        for name, column in (("solar_gain", "irradiance"), ("lateral_loss", "air_outdoor"))
        for action in [Action("column", {"column": column}, 10.0, 1.0, 0.9)]
    )
    asked = (question, *columns)
    run, text, made = page_with(replace(unnamed, prescriptions=asked))
    assert "What would settle it" in text and all(format_text(one.sentence) in text for one in asked)
    assert "Left: with one more temperature sensor" in text and "For a column that was not logged" in text
    place, action, empty, logged = made["next"].axes
    assert place.lines[0].get_ydata().tolist() == [0.6, 0.8] and not empty.axison
    assert [label.get_text() for label in action.get_yticklabels()] == ["sensor at 10 cm"]
    assert [label.get_text() for label in logged.get_yticklabels()] == ["log irradiance", "log air outdoor"]
    assert logged.get_title(loc="left") == "Columns that were not logged"
    assert [one.step in next_steps(run) for one in asked] == [True, True, True]
    run, text, made = page_with(replace(adequate, prescriptions=columns))
    assert "What else could be tested" in text and "What would settle it" not in text and "next" in made
    assert "Left: with one more temperature sensor" not in text and "For a column that was not logged" in text
    assert not any(one.step in next_steps(run) for one in columns)


def test_the_report_shows_what_is_left_as_heat(unnamed):
    heat = UnexplainedHeat(unnamed.before).course()
    _, text, made = page_with(replace(unnamed, unknown_heat=heat))
    assert "What is left, as heat" in text and format_text(heat.sentence) in text
    assert len(made["heat"].axes) == 3 and made["heat"].axes[0].lines[0].get_ydata() == pytest.approx(heat.course)


def test_the_figures_of_a_diagnosis_have_dates(explanation):
    """Nine days from 6 February 2023."""
    made = dict(figures.diagnosis_figures(explanation))
    for stem in ("residuals", "fit", "windows"):
        ax = made[stem].axes[0]
        made[stem].draw_without_rendering()
        texts = {label.get_text() for label in ax.get_xticklabels()}
        assert ax.get_xlabel() == "time" and texts & {"09", "11", "13"}, (stem, texts)
        assert ax.xaxis.get_offset_text().get_text() == "2023-Feb"


def test_the_alternative_of_a_single_panel_speaks_of_one(adequate):
    told = alternative_text("residuals", Run(adequate.problem.case, diagnosis=adequate))
    assert "before and after" not in told and " to " not in told


# ------------------------------------------------------------------------------------------ the command


@pytest.fixture
def explained(monkeypatch, diagnosed, explanation):
    """The command's search replaced by what it found before."""
    monkeypatch.setattr(workflow, "diagnose", lambda case, progress: explanation)
    return diagnosed[0]


@pytest.fixture
def command(tmp_path):
    def call(*words):
        return CliRunner().invoke(app, [*map(str, words), "--out", str(tmp_path / "out")])

    return call


def test_diagnose_names_what_is_hidden(diagnosed, explanation):
    """The command in full, from file to files."""
    path, ended, _ = diagnosed
    found = explanation
    assert ended.exit_code == 0, ended.output
    result = json.loads(ended.stdout)  # nothing else there
    jsonschema.validate(result, SCHEMA)
    assert result["verdict"] in ("named", "confusable") and result["iterations"] is None
    (effect,) = result["effects"]
    assert ("sensor_lag", "T1") in {(one["name"], one["target"]) for one in [effect, *effect["alternatives"]]}
    # the rows used: nine days of ten
    assert result["window"] == {"start": "2023-02-06T00:00:00", "end": "2023-02-15T00:00:00", "criterion": None}
    assert set(result["seconds"]) == {"diagnose"} and result["reason"] is None
    assert result["diffusivity"]["value"] == pytest.approx(found.after.diffusivity)
    assert result["diffusivity_before"]["value"] == pytest.approx(found.plain.diffusivity)
    assert result["gap"]["after_K"] == pytest.approx(found.gap.after)
    ranked = result["ranked"]
    assert len(ranked) == len(found.table)
    assert [row["expected_gain"] for row in ranked] == sorted((row["expected_gain"] for row in ranked), reverse=True)
    assert "smallest" not in result and result["left_over"]["p_after"] > 1e-3
    out = path.parent / "out"
    assert {file.name for file in out.iterdir()} == DIAGNOSIS | {"wall.png", "record.png", "report.html", "result.json"}
    assert json.loads((out / "result.json").read_text()) == result
    page = check((out / "report.html").read_text("utf-8"))
    assert format_text(found.sentence) in unescape(page.text)
    assert page.text.count('<th scope="row">') > len(ranked) and 'class="in"' in page.text


def test_diagnose_prints_what_it_found(command, tmp_path, explained, explanation):
    ended = command("diagnose", explained)
    assert ended.exit_code == 0
    assert terminal_text(str(explanation), "utf-8") in ended.stdout and "missing.png" in ended.stdout
    # what is not this result's goes, what is not ours stays
    (tmp_path / "out" / "design.png").write_text("of an earlier run")
    entries = json.loads((tmp_path / "out" / "result.json").read_text())
    (tmp_path / "out" / "result.json").write_text(json.dumps(entries | {"files": [*entries["files"], "design.png"]}))
    (tmp_path / "out" / "notes.txt").write_text("mine")
    quiet = command("diagnose", explained, "--quiet")
    assert quiet.exit_code == 0 and quiet.output == ""
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == DIAGNOSIS | {"wall.png", "record.png", "report.html", "result.json", "notes.txt"}


def test_an_adequate_model_is_told_with_what_would_have_shown(command, tmp_path, monkeypatch, diagnosed, explanation):
    """As if the search had added nothing and nothing were left."""
    path, found = diagnosed[0], explanation
    nothing = replace(
        found,
        after=found.before,
        effects=(),
        trials=(),
        rivals=(),
        residual_tests_after=replace(found.residual_tests_after, p_value=0.5),
    )
    monkeypatch.setattr(workflow, "diagnose", lambda case, progress: nothing)
    ended = command("diagnose", path, "--json")
    assert ended.exit_code == 0
    result = json.loads(ended.stdout)
    jsonschema.validate(result, SCHEMA)
    assert result["verdict"] == "adequate" and len(result["smallest"]) == len(result["ranked"])
    assert all(size["value"] > 0 for size in result["smallest"].values())
    assert not (tmp_path / "out" / "windows.png").exists()


def test_a_diagnosis_without_a_diffusivity_ends_with_status_1(command, monkeypatch, diagnosed, explanation):
    path, found = diagnosed[0], explanation
    case = found.problem.case
    strict = replace(case, choices=replace(case.choices, largest_interval_factor=1.0001))
    wide = replace(found, problem=replace(found.problem, case=strict))
    monkeypatch.setattr(workflow, "diagnose", lambda case, progress: wide)
    ended = command("diagnose", path, "--json")
    assert ended.exit_code == 1
    result = json.loads(ended.stdout)
    jsonschema.validate(result, SCHEMA)
    assert result["verdict"] == "uninformative" and result["reason"]


def test_a_figure_that_fails_leaves_nothing_half_written(command, tmp_path, monkeypatch, explained):
    from matplotlib.figure import Figure

    count = iter(range(100))
    save = Figure.savefig

    def once_too_often(figure, *args, **kwargs):
        if next(count) == 3:
            raise OSError(28, "No space left on device")
        save(figure, *args, **kwargs)

    monkeypatch.setattr(Figure, "savefig", once_too_often)
    ended = command("diagnose", explained)
    assert ended.exit_code == 2 and "--out" in ended.stderr and ended.stdout == ""
    assert not (tmp_path / "out").exists()
