"""Sections: rectangles, pictures, patterns, the table of a case, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import wallid
from wallid.case import load_section
from wallid.case.section import (
    Region,
    Section,
    SectionMaterial,
    brick_with_joints,
    coursed_rubble,
    section_of_picture,
    section_of_regions,
)

STONE = SectionMaterial("stone", 1.7, 2.1e6, color="#b09a7a")
MORTAR = SectionMaterial("mortar", 0.6, 1.5e6, color="#e8e0d0")

CASE = """
[wall]
length = 0.4

[section]
height = 0.2
bottom = "adiabatic"

[[section.material]]
name = "stone"
conductivity = 1.7
heat_capacity = 2.1e6

[[section.material]]
name = "mortar"
conductivity = 0.6
conductivity_y = 0.5
heat_capacity = 1.5e6
uncertainty = 0.2

[[section.region]]
material = "stone"
x = [0.0, 0.4]
y = [0.0, 0.2]

[[section.region]]
material = "mortar"
x = [0.0, 0.4]
y = [0.09, 0.11]

[[sensor]]
name = "T1"
position = 0.1
height = 0.1
noise_std = 0.05
"""


def written(tmp_path, text=CASE):
    path = tmp_path / "case.toml"
    path.write_text(text, "utf-8")
    return path


def pixels_of(section, columns, rows):
    """A picture of a section, drawn pixel by pixel."""
    picture = np.zeros((rows, columns, 3), np.uint8)
    for row in range(rows):
        for column in range(columns):
            x, y = (column + 0.5) / columns * section.length, (row + 0.5) / rows * section.height
            colour = section.material_at(x, y).color
            picture[rows - 1 - row, column] = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return picture


def test_later_regions_lie_over_earlier_ones():
    section = section_of_regions(
        0.4, 0.2, [STONE, MORTAR], [Region("stone", (0, 0.4), (0, 0.2)), Region("mortar", (0.1, 0.2), (-1.0, 0.1))]
    )
    assert section.x_lines == pytest.approx([0.0, 0.1, 0.2, 0.4]) and section.y_lines == pytest.approx([0.0, 0.1, 0.2])
    assert section.material_at(0.15, 0.05) is MORTAR and section.material_at(0.15, 0.15) is STONE
    assert section.areas == pytest.approx([0.875, 0.125])
    assert section.mean_heat_capacity == pytest.approx(0.875 * 2.1e6 + 0.125 * 1.5e6)


def test_a_picture_is_the_section_that_was_drawn():
    drawn = section_of_regions(0.4, 0.3, [STONE, MORTAR], coursed_rubble(0.4, 0.3, joint=0.02, grid=0.01, seed=4))
    read = section_of_picture(0.4, 0.3, [STONE, MORTAR], pixels_of(drawn, 40, 30))
    x, y = np.meshgrid(np.arange(0.005, 0.4, 0.01), np.arange(0.005, 0.3, 0.01))
    for a, b in zip(x.ravel(), y.ravel(), strict=True):
        assert read.material_at(a, b) is drawn.material_at(a, b)
    assert read.areas == pytest.approx(drawn.areas, abs=1e-12)


def test_a_pictures_lines_lie_on_its_joints_only():
    picture = pixels_of(
        section_of_regions(
            0.4, 0.2, [STONE, MORTAR], [Region("stone", (0, 0.4), (0, 0.2)), Region("mortar", (0.2, 0.24), (0, 0.2))]
        ),
        40, 20,
    )  # fmt: skip
    section = section_of_picture(0.4, 0.2, [STONE, MORTAR], picture)
    assert section.x_lines == pytest.approx([0.0, 0.2, 0.24, 0.4]) and section.y_lines == pytest.approx([0.0, 0.2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p.__setitem__((3, 4), (1, 2, 3)), "no material has the color #010203 (1 pixels)"),
        (lambda p: p.__setitem__(..., np.arange(p.size, dtype=np.uint8).reshape(p.shape)), "a photograph"),
    ],
)
def test_a_colour_without_a_material_is_named(change, message):
    picture = np.full((20, 40, 3), (0xB0, 0x9A, 0x7A), np.uint8)
    change(picture)
    with pytest.raises(wallid.InputError) as refused:
        section_of_picture(0.4, 0.2, [STONE, MORTAR], picture)
    assert message in str(refused.value)


def test_a_picture_of_other_proportions_is_refused_with_the_height_that_fits():
    with pytest.raises(wallid.InputError, match=r"with square pixels the height is 0\.2 m"):
        section_of_picture(0.4, 0.3, [STONE], np.full((20, 40, 3), (0xB0, 0x9A, 0x7A), np.uint8))


@pytest.mark.parametrize(
    ("materials", "message"),
    [
        ([SectionMaterial("stone", 1.0, 1e6)], "has no color"),
        (
            [STONE, SectionMaterial("render", 1.0, 1e6, color="#B09A7A")],
            'materials "stone" and "render" have one color',
        ),
    ],
)
def test_materials_of_a_picture_need_colours_of_their_own(materials, message):
    with pytest.raises(wallid.InputError, match=message):
        section_of_picture(0.4, 0.2, materials, np.zeros((20, 40, 3), np.uint8))


def test_a_file_that_is_no_picture_is_refused(tmp_path):
    (tmp_path / "wall.png").write_text("no picture")
    with pytest.raises(wallid.InputError, match="is not a picture"):
        section_of_picture(0.4, 0.2, [STONE], tmp_path / "wall.png")
    with pytest.raises(wallid.InputError, match="cannot be read"):
        section_of_picture(0.4, 0.2, [STONE], tmp_path / "absent.png")


@pytest.mark.parametrize(
    ("regions", "message"),
    [
        ([Region("stone", (0, 0.4), (0, 0.1))], "there is no material at x = 0.2 m, y = 0.15 m"),
        ([Region("ston", (0, 0.4), (0, 0.2))], 'did you mean "stone"'),
        ([Region("stone", (0, 0.4), (0, 0.2)), Region("stone", (0.5, 0.6), (0, 0.2))], "outside the section"),
    ],
)
def test_regions_that_do_not_fit_are_refused(regions, message):
    with pytest.raises(wallid.InputError) as refused:
        section_of_regions(0.4, 0.2, [STONE], regions)
    assert message in str(refused.value)


def test_the_thinnest_part_is_the_joint_and_half_a_joint_at_a_mirror_counts_twice():
    bed = [Region("stone", (0, 0.4), (0, 0.2)), Region("mortar", (0, 0.4), (0.09, 0.11))]
    material, thickness = section_of_regions(0.4, 0.2, [STONE, MORTAR], bed).thinnest_part()
    assert material is MORTAR and thickness == pytest.approx(0.02)
    half = [Region("stone", (0, 0.4), (0, 0.2)), Region("mortar", (0, 0.4), (0.0, 0.01))]
    assert section_of_regions(0.4, 0.2, [STONE, MORTAR], half).thinnest_part()[1] == pytest.approx(0.02)
    held = section_of_regions(0.4, 0.2, [STONE, MORTAR], half, bottom="left")
    assert held.thinnest_part()[1] == pytest.approx(0.01)


@given(st.integers(0, 10_000), st.floats(0.005, 0.03), st.integers(1, 6))
def test_rubble_fills_its_section_with_stones_and_joints(seed, joint, courses):
    regions = coursed_rubble(0.5, 0.6, joint=joint, courses=courses, seed=seed)
    section = section_of_regions(0.5, 0.6, [STONE, MORTAR], regions)
    assert 0.0 < section.areas[0] < 1.0
    assert section.material_at(0.25, 0.25 * joint) is MORTAR  # half a joint at the bottom
    low, high = section.conductivity_bounds
    assert low <= section.diffusivity_prior * section.mean_heat_capacity <= high


def test_bricks_are_in_running_bond():
    section = section_of_regions(
        0.5, 0.332, [SectionMaterial("brick", 0.6, 1.4e6), MORTAR], brick_with_joints(0.5, 0.332)
    )
    assert section.material_at(0.246, 0.04).name == "mortar" and section.material_at(0.246, 0.12).name == "brick"
    assert section.areas[0] == pytest.approx(0.8, abs=0.05)


def test_a_case_has_its_section(tmp_path):
    case = load_section(written(tmp_path))
    assert isinstance(case.section, Section) and case.sensors[0].height == 0.1
    mortar = case.section.materials[1]
    assert mortar.anisotropy == pytest.approx(0.5 / 0.6) and mortar.uncertainty == 0.2
    assert case.wall.diffusivity_prior == pytest.approx(case.section.diffusivity_prior)


def test_a_picture_lies_beside_its_case(tmp_path):
    Image.fromarray(np.full((20, 40, 3), (0xB0, 0x9A, 0x7A), np.uint8)).save(tmp_path / "wall.png")
    regions = CASE[CASE.index("[[section.region]]") : CASE.index("[[sensor]]")]
    text = CASE.replace(regions, "").replace('bottom = "adiabatic"', 'image = "wall.png"')
    text = text.replace('name = "stone"', 'name = "stone"\ncolor = "#b09a7a"').replace(
        'name = "mortar"', 'name = "mortar"\ncolor = "#e8e0d0"'
    )
    assert load_section(written(tmp_path, text)).section.areas == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("height = 0.1\n", "height = 0.3\n", "outside the section"),
        ("height = 0.2", "hight = 0.2", 'unknown key "hight"'),
        ('bottom = "adiabatic"', 'image = "a.png"', "needs either image"),
        ('bottom = "adiabatic"', 'bottom = "middle"', 'it must be "adiabatic" or "left" or "right"'),
        ("conductivity = 1.7", "conductivity = -1.7", '[[section.material]] 1 "stone": conductivity = -1.7'),
        ("x = [0.0, 0.4]", "x = [0.4]", "[[section.region]] 1: x"),
        ("length = 0.4", 'length = 0.4\n[[wall.layer]]\nthickness = 0.4\nconductivity = 1\nheat_capacity = 1e6',
         "has layers"),
        ("height = 0.1\n", "height_std = 0.1\n", "height_std is given, but no height"),
    ],
)  # fmt: skip
def test_a_section_that_does_not_fit_is_refused_with_the_reason(tmp_path, old, new, message):
    assert old in CASE
    with pytest.raises(wallid.InputError) as refused:
        load_section(written(tmp_path, CASE.replace(old, new, 1)))
    assert message in str(refused.value)


def test_without_a_record_only_the_section_is_solved(tmp_path):
    path = written(tmp_path)
    with pytest.raises(wallid.InputError, match="`wallid section` solves its section"):
        wallid.load(path)


def test_a_height_needs_a_section(tmp_path):
    record = "time,L,R,T1\n" + "".join(f"{3600 * k},{k % 5},{k % 7},{k % 3}\n" for k in range(60))
    (tmp_path / "record.csv").write_text(record)
    table = '[record]\nfile = "record.csv"\ntime = "time"\nleft = "L"\nright = "R"\n'
    text = CASE[: CASE.index("[section]")] + "diffusivity_prior = 1e-6\n" + table + CASE[CASE.index("[[sensor]]") :]
    with pytest.raises(wallid.InputError, match="the case has no"):
        wallid.load(written(tmp_path, text))
