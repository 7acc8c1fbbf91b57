"""Mutilated files: each ends with status 0, 1 or 2, with nothing broken behind it."""

import json
import shutil

import pytest
from benchmarks.stress.fuzz import examine, outcome, plain_record, write_case
from benchmarks.stress.mutilations import ENCODINGS, LINES, RECORD_KEYS, mutilate
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import wallid

SPOILT = st.lists(st.sampled_from(LINES), min_size=1, max_size=3)
WRITTEN = st.sampled_from(["utf-8"] * 6 + list(ENCODINGS))


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    return tmp_path_factory.mktemp("house")


def test_the_plain_file_is_in_order(house):
    write_case(house, plain_record().encode(), "")
    assert examine(house) == 0
    assert wallid.load(house).record.cleaning.unchanged


@settings(max_examples=600, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32), which=SPOILT, encoding=WRITTEN, extra=st.sampled_from(RECORD_KEYS))
def test_600_mutilated_files_are_looked_through(house, seed, which, encoding, extra):
    """What `wallid check` does, its figure apart, which takes half a second."""
    write_case(house, mutilate(plain_record(), seed, which, encoding), extra)
    examine(house)


@settings(max_examples=3, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32), which=SPOILT, encoding=WRITTEN, extra=st.sampled_from(RECORD_KEYS))
def test_mutilated_files_are_checked_from_the_command_line(house, seed, which, encoding, extra):
    write_case(house, mutilate(plain_record(), seed, which, encoding), extra)
    outcome(house, "check")
    shutil.rmtree(house / "out", ignore_errors=True)


SAME_ROWS = ["words", "empty_cells", "swapped_rows", "stuck_sensor"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SAME_ROWS)
def test_a_run_on_a_mutilated_file(house, name):
    """Mutilations that leave the rows as many, so that what one run compiled serves the next; more in benchmarks."""
    which = next(one for one in LINES if one.__name__ == name)
    write_case(house, mutilate(plain_record(), 7, [which], "utf-8"), "")
    assert outcome(house, "run") in (0, 1)
    result = json.loads((house / "out" / "result.json").read_text())
    assert result["record"]["rows"] == 120
    shutil.rmtree(house / "out")


@pytest.mark.parametrize("name", ["no_header", "zones"])
def test_a_run_that_is_refused(house, name):
    which = next(one for one in LINES if one.__name__ == name)
    write_case(house, mutilate(plain_record(), 11, [which], "utf-8"), "")
    assert outcome(house, "run") == 2
