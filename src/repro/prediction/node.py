"""What the nodes of ROS 1 and ROS 2 share: their parameters, and maps as messages."""

import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch

from repro.networks.predictor import load_predictor
from repro.prediction.live import KEEP_S, LiveMapper
from repro.prediction.ros import grid_message, occupancy
from repro.prediction.stream import StreamMap
from repro.prediction.times import MAX_STEPS, window_of
from repro.prediction.transforms import Transforms
from repro.system.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """A parameter of the nodes.

    Args:
        default: the default, whose type is that of the parameter; a text of numbers may also be a list of them.
        description: what it is, with its unit.
        limits: its smallest and its largest value; None if it is no number.
    """

    default: bool | int | float | str
    description: str
    limits: tuple[float, float] | None = None


PARAMETERS = {
    "weights": Parameter("buildings", "name or directory of the weights"),
    "scan_topic": Parameter("scan", "topic of the LaserScan messages"),
    "odometry": Parameter(False, "take the poses from the topic odom, not from /tf"),
    "frame": Parameter("", "frame of the poses and of the map, such as odom; empty for the topmost one"),
    "mounting": Parameter("", "x,y,heading of the lidar on the robot [m, rad], in place of its transforms"),
    "center": Parameter("robot", "center of the map: robot, or x,y in the frame of the poses [m]"),
    "undecided": Parameter("", "low,high: probabilities of an obstacle between these are unknown, -1"),
    "steps": Parameter(0, "steps of a window; 0 for those of the training", (0, MAX_STEPS)),
    "step_s": Parameter(0.0, "time of a step [s]; 0 for that of the training", (0.0, 60.0)),
    "range_max_m": Parameter(0.0, "maximum range of the lidar [m]; 0 for that of the scans", (0.0, 1000.0)),
    "threads": Parameter(1, "threads of the network", (1, 64)),
}


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
    for name, parameter in PARAMETERS.items():
        _check(name, values[name], parameter)
    undecided, mounting = _numbers(values, "undecided", 2), _numbers(values, "mounting", 3)
    center = "robot" if values["center"] == "robot" else _numbers(values, "center", 2)
    if center is None:
        raise InputError("center: expected robot or x,y [m], got an empty text")
    torch.set_num_threads(values["threads"])
    predictor = load_predictor(values["weights"])
    steps, step_s, range_max_m = (values[name] or None for name in ("steps", "step_s", "range_max_m"))
    settings = window_of(predictor, center, steps, step_s, range_max_m)

    def send(header: Any, frame: str, predicted: StreamMap) -> None:
        data = array.array("b", occupancy(predicted.free, undecided, predicted.unknown).tobytes())
        publish(grid_message(types, data, predicted, header.stamp, frame))

    transforms = Transforms(KEEP_S, frame=values["frame"] or None, mounting=mounting)
    return LiveMapper(predictor, send, warn, settings, transforms)


def _check(name: str, value: Any, parameter: Parameter) -> None:
    """Check that a value has the type and the limits of its parameter."""
    if isinstance(parameter.default, bool) and not isinstance(value, bool):
        raise InputError(f"{name}: expected true or false, got {value!r}")
    if parameter.limits is not None:
        kinds, noun = (int, "an integer") if isinstance(parameter.default, int) else (int | float, "a number")
        low, high = parameter.limits
        if not isinstance(value, kinds) or isinstance(value, bool) or not low <= value <= high:
            raise InputError(f"{name}: expected {noun} from {low:g} to {high:g}, got {value!r}")


def _numbers(values: Mapping[str, Any], name: str, count: int) -> Any:
    """Return a parameter as a tuple of numbers, which is a text with commas or a list; None for an empty text."""
    value = values[name]
    if value == "":
        return None
    try:
        found = tuple(float(word) for word in (value.split(",") if isinstance(value, str) else value))
    except (TypeError, ValueError):
        found = ()
    if len(found) != count:
        raise InputError(f"{name}: expected {count} numbers with commas between them, got {value!r}")
    return found
