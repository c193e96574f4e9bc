"""The parameters of the nodes, and those of Nav2 in the example."""

import pytest
import yaml
from conftest import ROOT

from repro.prediction.node import PARAMETERS, create_mapper
from repro.prediction.ros import OCCUPIED_ABOVE

DEFAULTS = {name: default for name, (default, _) in PARAMETERS.items()}
WINDOW_S = (0.1, 100)
# Parameters by their types, as Nav2 (branches jazzy and main) and spatio_temporal_voxel_layer declare them.
NAV2 = {
    str: "global_frame robot_base_frame map_topic observation_sources data_type topic",
    bool: "rolling_window use_maximum track_unknown_space trinary_costmap map_subscribe_transient_local "
    "subscribe_to_updates footprint_clearing_enabled marking clearing",
    int: "width height lethal_cost_threshold decay_model combination_method",
    float: "resolution update_frequency publish_frequency robot_radius inflation_radius cost_scaling_factor "
    "voxel_decay voxel_size obstacle_range",
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
    mapper = create(mounting=mounting, frame="odom", center="25,-3.5", range_max_m=12.0, steps=50, weights="rooms")
    assert mapper.transforms.mounting == pytest.approx((0.5, -1, 0))
    assert mapper.transforms.frame == "odom"
    assert mapper.settings.center == (25, -3.5)
    assert (mapper.settings.range_max_m, mapper.settings.steps) == (12, 50)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("steps", 20_000, "expected 1 to 10000 steps"),
        ("steps", 0.5, "steps: expected a value such as 0, got 0.5"),
        ("range_max_m", "far", "range_max_m: expected a value such as 0.0 from 0 to 1000, got 'far'"),
        ("odometry", "yes", "odometry: expected a value such as False, got 'yes'"),
        ("mounting", "1,2", "mounting: expected 3 finite numbers"),
        ("mounting", "0,0,inf", "mounting: expected 3 finite numbers"),
        ("mounting", "a,b,c", "mounting: expected 3 finite numbers"),
        ("frame", 5, "frame: expected a value such as '', got 5"),
        ("threads", 10**6, "threads: expected a value such as 1 from 1 to 64"),
        ("center", "", "center: expected robot or x,y"),
        ("weights", "nowhere", "nowhere"),
    ],
)
def test_wrong_values_are_refused(name, value, message):
    with pytest.raises(ValueError, match=message):
        create(**{name: value})


def test_the_parameters_of_nav2_are_those_that_it_declares():
    content = yaml.safe_load((ROOT / "examples" / "nav2_costmap.yaml").read_text())
    costmap = content["local_costmap"]["local_costmap"]["ros__parameters"]
    layers = [costmap[name] for name in costmap["plugins"]]
    values = [(name, value) for part in (costmap, *layers, layers[0]["scan"]) for name, value in part.items()]
    found = {
        name: type(value) for name, value in values if name not in ("plugin", "plugins") and type(value) is not dict
    }
    assert found == {name: kind for kind, names in NAV2.items() for name in names.split()}
    assert [layer["plugin"] for layer in layers] == [
        "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer",
        *("nav2_costmap_2d::StaticLayer", "nav2_costmap_2d::InflationLayer"),
    ]
    assert costmap["rolling_window"]
    assert not costmap["track_unknown_space"]
    assert layers[1]["map_topic"] == "/predicted_map"
    assert costmap["lethal_cost_threshold"] == 100 * OCCUPIED_ABOVE
