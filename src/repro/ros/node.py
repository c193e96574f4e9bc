"""The node without ROS: its parameters, and maps as messages."""

import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any

from pydantic import Field, StrictBool

from repro.logs.options import ReadOptions, convert_fields, window_of
from repro.logs.transforms import Transforms
from repro.networks.predictor import load_predictor
from repro.prediction.stream_map import StreamMap
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


@dataclass(frozen=True)
class _Options:
    """Parameters that are no settings of windows or poses."""

    weights: str
    scan_topic: str
    odometry: StrictBool
    threads: Annotated[int, Field(strict=True, ge=1, le=64)]

    def __post_init__(self) -> None:
        convert_fields(self)


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
    options = _Options(**{field.name: values[field.name] for field in fields(_Options)})
    if values["center"] == "start":
        raise InputError("center: expected robot or x,y [m], got start: a node has no first pose")
    poses = ReadOptions(frame=_given(values, "frame"), mounting=_given(values, "mounting"))
    use_threads(options.threads)
    predictor = load_predictor(options.weights)
    known = {name: _given(values, name) for name in ("steps", "step_s", "range_max_m")}
    settings = window_of(predictor, **known, center=values["center"], misses=values["misses"])

    def send(header: Any, frame: str, predicted: StreamMap) -> None:
        data = array.array("b", occupancy(predicted.free, predicted.unknown).tobytes())
        publish(grid_message(types, data, predicted, header.stamp, frame))

    transforms = Transforms(KEEP_S, frame=poses.frame, mounting=poses.mounting)
    return LiveMapper(predictor, send, warn, settings, transforms)


def _given(values: Mapping[str, Any], name: str) -> Any:
    """Return a parameter; None for 0 and an empty text, which mean that it is not set."""
    value = values[name]
    return None if type(value) in (int, float, str) and value in (0, "") else value
