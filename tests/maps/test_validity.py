import numpy as np
import pytest

from repro.maps.grid import Grid
from repro.maps.validity import check_windows
from repro.scans import Scans

GRID = Grid(64, 50.0)
RANGES = np.full((20, 30), 12.0)
ANGLES = np.linspace(-0.78, 0.78, 30)
POSES = np.tile([25.0, 25.0, 0.0], (20, 1))


def with_value(array, value, index=(3, 2)):
    changed = array.copy()
    changed[index[: array.ndim]] = value
    return changed


def check(ranges=RANGES, angles=ANGLES, poses=POSES, **options):
    check_windows(Scans(ranges, angles, poses).batched(), GRID, **options)


@pytest.mark.parametrize(
    "scans",
    [
        {},
        {"ranges": with_value(RANGES, np.inf)},
        {"ranges": with_value(RANGES, np.nan)},
        {"poses": POSES + np.array([0, 0, 5 * np.pi])},
        {"ranges": RANGES.astype(np.float32)},
        {"ranges": np.where(np.arange(30) == 7, RANGES, np.inf)},
        {"ranges": RANGES + np.inf},  # an empty place
        {"ranges": RANGES + 60},  # one whose walls are beyond the map
        {"ranges": RANGES * 25},  # whose median is 300 m
        {"ranges": np.stack([RANGES, RANGES - 1]), "poses": np.stack([POSES, POSES])},
        {"poses": with_value(POSES, 51.0, (slice(9), 0))},  # it comes from outside the map
    ],
)
def test_scans_of_a_lidar_on_the_map_are_accepted(scans):
    check(**scans)


@pytest.mark.parametrize(
    ("scans", "message"),
    [
        ({"ranges": RANGES * np.nan}, "1 of 1 windows are without a valid reading: expected meters, inf for a miss"),
        ({"ranges": with_value(RANGES, -0.1)}, "1 of 600 ranges are zero or negative"),
        ({"ranges": with_value(RANGES, 0.0)}, "1 of 600 ranges are zero or negative"),
        ({"ranges": with_value(RANGES, -np.inf)}, "1 of 600 ranges are zero or negative"),
        ({"ranges": RANGES * 1000}, "1 of 1 windows are of ranges with a median beyond 300: expected meters"),
        ({"angles": np.degrees(ANGLES)}, "angles are beyond a full turn: expected radians"),
        ({"angles": ANGLES * np.nan}, "30 of 30 angles are not finite"),
        ({"poses": with_value(POSES, np.inf)}, "1 of 60 poses are not finite"),
        ({"poses": with_value(POSES, np.nan)}, "1 of 60 poses are not finite"),
        ({"poses": POSES + np.array([0, 0, 270])}, "headings are beyond ten turns: expected radians"),
        ({"poses": POSES - np.array([0, 0, 270])}, "headings are beyond ten turns: expected radians"),
        ({"poses": POSES + np.linspace(-50, 50, len(POSES))[:, None] * [0, 0, 1]}, "headings that jump at most steps"),
    ],
)
@pytest.mark.parametrize("allow_empty", [False, True])
def test_values_that_no_lidar_has_are_refused_always(scans, message, allow_empty):
    with pytest.raises(ValueError, match=message):
        check(**scans, allow_empty=allow_empty)


@pytest.mark.parametrize(
    ("scans", "message"),
    [
        ({"ranges": np.where(np.arange(30) == 7, RANGES, np.nan)}, "1 of 1 windows are with too few valid readings"),
        ({"poses": with_value(POSES, 51.0, (-1, 0))}, "1 of 1 windows are of a robot that is outside the map at"),
        ({"poses": with_value(POSES, 51.0, (slice(11), 0))}, "at most steps: .* x and y from 0 to 50 m"),
        ({"poses": POSES - [40, 0, 0]}, "expected the last pose and most others on the map"),
    ],
)
def test_windows_without_information_are_refused_unless_asked_for(scans, message):
    with pytest.raises(ValueError, match=message):
        check(**scans)
    check(**scans, allow_empty=True)


@pytest.mark.parametrize(("kept", "is_refused"), [(25, True), (35, False)])
def test_a_window_needs_a_twentieth_of_its_readings(kept, is_refused):
    ranges = np.full(RANGES.size, np.nan)
    ranges[:kept] = 12.0  # of 600
    if is_refused:
        with pytest.raises(ValueError, match=r"too few valid readings: expected at least 5% .* the fewest have 4.2%"):
            check(ranges=ranges.reshape(RANGES.shape))
    else:
        check(ranges=ranges.reshape(RANGES.shape))
