"""What the nodes of ROS 1 and ROS 2 share: their parameters, and maps as messages."""

import array
import math
from collections.abc import Callable, Mapping
from typing import Any

from repro.logs.times import window_of
from repro.logs.transforms import Transforms
from repro.networks.predictor import load_predictor
from repro.prediction.stream import StreamMap
from repro.ros.live_mapper import KEEP_S, LiveMapper
from repro.ros.map_message import grid_message, occupancy
from repro.system.errors import InputError
from repro.system.threads import use_threads

PARAMETERS: dict[str, tuple[Any, str]] = {  # by name: default, of the type of the parameter, and description
    "weights": ("indoor", "name or directory of the weights"),
    "scan_topic": ("scan", "topic of the LaserScan messages"),
    "odometry": (False, "take the poses from the topic odom, not from /tf"),
    "frame": ("", "frame of the poses and of the map, such as odom; empty for the topmost one"),
    "mounting": ("", "x,y,heading of the lidar on the robot [m, rad], in place of its transforms"),
    "center": ("robot", "center of the map: robot, or x,y in the frame of the poses [m]"),
    "steps": (0, "steps of a window; 0 for those of the training"),
    "step_s": (0.0, "time of a step [s]; 0 for that of the training"),
    "range_max_m": (0.0, "maximum range of the lidar [m]; 0 for that of the scans"),
    "misses": ("free", "what a miss shows: free; or invalid, if lost beams arrive as misses"),
    "threads": (1, "threads of the network"),
}
NUMBERS = ("mounting", "center")  # parameters whose text of numbers may also be a list of them
LIMITS = {"threads": (1, 64), "step_s": (0, 60), "range_max_m": (0, 1000)}


def create_mapper(
    values: Mapping[str, Any], types: dict[str, Any], publish: Callable[[Any], None], warn: Callable[[str], None]
) -> LiveMapper:
    """Create the mapper of a node.

    Args:
        values: the value of each of `PARAMETERS`.
        types: the message classes that `grid_message` needs, by name.
        publish: is called with each OccupancyGrid.
        warn: is called with the reason for which a scan is skipped or has no map.

    Raises:
        InputError: a value is not one of its parameter, or there are no such weights.
    """
    for name in PARAMETERS:
        _check(name, values[name])
    mounting = _numbers(values, "mounting", 3)
    center = "robot" if values["center"] == "robot" else _numbers(values, "center", 2)
    if center is None:
        raise InputError("center: expected robot or x,y [m], got an empty text")
    use_threads(values["threads"])
    predictor = load_predictor(values["weights"])
    steps, step_s, range_max_m = (values[name] or None for name in ("steps", "step_s", "range_max_m"))
    others = {"center": center, "range_max_m": range_max_m, "misses": values["misses"]}
    settings = window_of(predictor, steps, step_s, **others)

    def send(header: Any, frame: str, predicted: StreamMap) -> None:
        data = array.array("b", occupancy(predicted.free, predicted.unknown).tobytes())
        publish(grid_message(types, data, predicted, header.stamp, frame))

    transforms = Transforms(KEEP_S, frame=values["frame"] or None, mounting=mounting)
    return LiveMapper(predictor, send, warn, settings, transforms)


def _check(name: str, value: Any) -> None:
    """Check that a value has the type and the limits of its parameter."""
    default, _ = PARAMETERS[name]
    kinds = {float: (float, int), str: (str, list, tuple) if name in NUMBERS else (str,)}
    has_kind = type(value) in kinds.get(type(default), (type(default),))
    low, high = LIMITS.get(name, (None, None))
    limits = "" if low is None else f" from {low} to {high}"
    if not has_kind or (low is not None and not low <= value <= high):
        raise InputError(f"{name}: expected a value such as {default!r}{limits}, got {value!r}")


def _numbers(values: Mapping[str, Any], name: str, count: int) -> Any:
    """Return a parameter as a tuple of numbers, which is a text with commas or a list; None for an empty text."""
    value = values[name]
    if value == "":
        return None
    try:
        found = tuple(float(word) for word in (value.split(",") if isinstance(value, str) else value))
    except (TypeError, ValueError):
        found = ()
    if len(found) != count or not all(map(math.isfinite, found)):
        raise InputError(f"{name}: expected {count} finite numbers with commas between them, got {value!r}")
    return found
