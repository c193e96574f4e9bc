"""Messages about the maximum range of a lidar."""

import numpy as np
import pytest

from repro.logs.readings import note_on_repeats, readings


def ranges(misses: float, count: int) -> np.ndarray:
    """Return readings to the centimeter, of which some are misses."""
    found = np.random.default_rng(0).uniform(1, 11.9, (50, 40)).round(2).astype(np.float32)
    found[0, 0], found[0, 1] = np.nan, np.inf
    found[1:].flat[:count] = misses
    return found


@pytest.mark.parametrize(("misses", "option"), [(12.0, "12"), (12.3, "12.3"), (29.999998, "29.999998")])
def test_readings_that_repeat_at_the_largest_value_look_like_the_maximum_range(misses, option):
    note = note_on_repeats(ranges(misses, 120))
    assert note is not None
    assert note.startswith("120 readings are exactly ")
    assert note.endswith(f"set prediction.range_max_m={option}")


def test_masked_readings_are_invalid():
    masked = np.ma.array([2.0, 5.0, 31.0], mask=[False, True, False])
    np.testing.assert_array_equal(readings(masked, 0.0, 30.0), np.array([2.0, np.nan, np.inf], np.float32))


@pytest.mark.parametrize(
    "values", [ranges(12.0, 3), ranges(5.0, 120), np.full((3, 4), np.inf), np.full((3, 4), np.nan)]
)
def test_readings_without_a_largest_value_that_repeats_do_not(values):
    assert note_on_repeats(values.astype(np.float32)) is None
