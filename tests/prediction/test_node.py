"""The parameters of the nodes, and those of Nav2 in the example."""

import pytest
import yaml
from conftest import ROOT

from repro.prediction.node import PARAMETERS, create_mapper
from repro.prediction.ros import OCCUPIED_ABOVE

DEFAULTS = {name: parameter.default for name, parameter in PARAMETERS.items()}
WINDOW_S = (0.1, 100)
# Parameters with their types, as Nav2 (branches jazzy and main) and spatio_temporal_voxel_layer declare them.
COSTMAP = {
    **{"global_frame": str, "robot_base_frame": str, "rolling_window": bool, "width": int, "height": int},
    **{"resolution": float, "update_frequency": float, "publish_frequency": float, "robot_radius": float},
    **{"use_maximum": bool, "track_unknown_space": bool, "lethal_cost_threshold": int, "trinary_costmap": bool},
    "plugins": list,
}
STATIC = {
    **{"map_topic": str, "map_subscribe_transient_local": bool, "subscribe_to_updates": bool},
    "footprint_clearing_enabled": bool,
}
INFLATION = {"inflation_radius": float, "cost_scaling_factor": float}
VOXELS = {
    **{"decay_model": int, "voxel_decay": float, "voxel_size": float, "combination_method": int},
    "observation_sources": str,
}
SOURCE = {"data_type": str, "topic": str, "marking": bool, "clearing": bool, "obstacle_range": float}
LAYERS = {
    "nav2_costmap_2d::StaticLayer": STATIC,
    "nav2_costmap_2d::InflationLayer": INFLATION,
    "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer": VOXELS,
}


def create(**values):
    return create_mapper(DEFAULTS | values, {}, print, print)


def test_the_defaults_are_those_of_the_training():
    mapper = create()
    assert (mapper.settings.step_s, mapper.settings.steps) == WINDOW_S
    assert (mapper.settings.center, mapper.settings.range_max_m) == ("robot", None)
    assert (mapper.transforms.frame, mapper.transforms.mounting) == (None, None)


@pytest.mark.parametrize("mounting", ["0.5,-1,0", [0.5, -1, 0]])
def test_numbers_are_a_text_or_a_list(mounting):
    mapper = create(mounting=mounting, frame="odom", center="25,-3.5", range_max_m=12.0, steps=50)
    assert mapper.transforms.mounting == pytest.approx((0.5, -1, 0))
    assert mapper.transforms.frame == "odom"
    assert mapper.settings.center == (25, -3.5)
    assert (mapper.settings.range_max_m, mapper.settings.steps) == (12, 50)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("steps", 20_000, "steps: expected an integer from 0 to 10000, got 20000"),
        ("steps", 0.5, "steps: expected an integer"),
        ("range_max_m", "far", "range_max_m: expected a number from 0 to 1000, got 'far'"),
        ("threads", 0, "threads: expected an integer from 1 to 64, got 0"),
        ("odometry", "yes", "odometry: expected true or false, got 'yes'"),
        ("mounting", "1,2", "mounting: expected 3 numbers"),
        ("undecided", "a,b", "undecided: expected 2 numbers"),
        ("center", "", "center: expected robot or x,y"),
        ("weights", "nowhere", "nowhere"),
    ],
)
def test_wrong_values_are_refused(name, value, message):
    with pytest.raises(ValueError, match=message):
        create(**{name: value})


def check(content: dict, types: dict[str, type]) -> None:
    """Check the names and the types of parameters: ROS 2 takes no integer for a double."""
    assert {name: type(value) for name, value in content.items()} == {name: types.get(name) for name in content}


def test_the_parameters_of_nav2_are_those_that_it_declares():
    content = yaml.safe_load((ROOT / "examples" / "nav2_costmap.yaml").read_text())
    costmap = content["local_costmap"]["local_costmap"]["ros__parameters"]
    layers = {name: costmap.pop(name) for name in costmap["plugins"]}
    check(costmap, COSTMAP)
    for layer in layers.values():
        types = LAYERS[layer.pop("plugin")]
        check(layer.pop("scan", {}), SOURCE)
        check(layer, types)
    assert costmap["rolling_window"]
    assert not costmap["track_unknown_space"]
    assert layers["predicted_layer"]["map_topic"] == "/predicted_map"
    assert costmap["lethal_cost_threshold"] == 100 * OCCUPIED_ABOVE
