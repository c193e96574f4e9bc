"""The parameters of the nodes, and those of Nav2 in the example."""

import runpy
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest
import yaml
from conftest import ROOT, refuse

from repro.logs.options import WindowSettings
from repro.prediction.map_files import OCCUPIED_ABOVE
from repro.ros.node import PARAMETERS, create_mapper
from repro.system.errors import InputError

DEFAULTS = {name: default for name, (default, _) in PARAMETERS.items()}
WINDOW_S = (0.1, 100)


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
        ("steps", 20_000, "steps=20000: must be less than or equal to 10000"),
        ("steps", 0.5, "steps=0.5: must be a valid integer"),
        ("range_max_m", "far", "range_max_m=far: must be a number"),
        ("odometry", "yes", "odometry=yes: must be a valid boolean"),
        ("mounting", "1,2", r"must be \[x,y,heading\]"),
        ("mounting", "0,0,inf", r"must be \[x,y,heading\]"),
        ("mounting", "a,b,c", r"must be \[x,y,heading\]"),
        ("frame", 5, "frame=5: must be a valid string"),
        ("threads", 10**6, "threads=1000000: must be less than or equal to 64"),
        ("center", "", "center=: must be robot, start, or"),
        ("center", "start", "a node has no first pose"),
        ("weights", "nowhere", "nowhere"),
    ],
)
def test_wrong_values_are_refused(name, value, message):
    with pytest.raises(ValueError, match=message):
        create(**{name: value})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("steps", 10_001, "steps=10001: must be less than or equal to 10000"),
        ("step_s", 1001.0, "step_s=1001.0: must be less than or equal to 1000"),
        ("range_max_m", 10_001.0, "range_max_m=10001.0: must be less than or equal to 10000"),
        ("center", "here", "center=here: must be robot, start, or [x,y] in meters"),
        ("misses", "lost", "misses=lost: must be 'free' or 'invalid'"),
    ],
)
def test_a_node_a_stream_and_a_call_have_the_same_limits(name, value, message):
    with pytest.raises(InputError) as node:
        create(**{name: value})
    with pytest.raises(InputError) as settings:
        WindowSettings(**{name: value})
    quoted = f"'{value}'" if isinstance(value, str) else value
    (call,) = refuse("task=predict", "scans=examples/rooms.npz", f"prediction.{name}={quoted}")
    assert (str(node.value), str(settings.value), call) == (message, message, f"prediction.{message}")


def test_an_obstacle_for_nav2_is_one_for_map_server():
    content = yaml.safe_load((ROOT / "examples" / "nav2_costmap.yaml").read_text())
    costmap = content["local_costmap"]["local_costmap"]["ros__parameters"]
    assert costmap["lethal_cost_threshold"] == 100 * OCCUPIED_ABOVE
    assert "/predicted_map" in [costmap[name].get("map_topic") for name in costmap["plugins"]]


def test_the_package_of_ros_2_has_the_parameters_of_the_node_and_the_version_of_the_project():
    folder = ROOT / "ros" / "repro_ros"
    content = yaml.safe_load((folder / "config" / "map_prediction.yaml").read_text())
    assert content["map_prediction"]["ros__parameters"] == DEFAULTS
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    package = ElementTree.parse(folder / "package.xml").getroot()
    assert package.findtext("version") == project["version"]
    (script,) = (line for line in (folder / "setup.py").read_text().splitlines() if "console_scripts" in line)
    assert project["scripts"]["repro-ros2-node"] in script


def test_the_launch_file_starts_the_node_of_the_package(monkeypatch):
    """With stand-ins for `launch` and `launch_ros`, which record what the file asks of them."""
    folder = ROOT / "ros" / "repro_ros"
    modules = {
        "launch": "LaunchDescription",
        "launch.actions": "DeclareLaunchArgument",
        "launch.substitutions": "LaunchConfiguration",
        "launch_ros": "",
        "launch_ros.actions": "Node",
    }
    for name, wanted in modules.items():
        module = ModuleType(name)
        if wanted:
            setattr(module, wanted, lambda *args, **options: (args, options))
        monkeypatch.setitem(sys.modules, name, module)
    path = folder / "launch" / "map_prediction.launch.py"
    ((actions,), _) = runpy.run_path(str(path))["generate_launch_description"]()
    *arguments, (_, node) = actions
    defaults = {name: options["default_value"] for (name,), options in arguments}
    content = yaml.safe_load(Path(defaults["params_file"]).read_text())
    assert list(content) == [node["name"]]
    assert node["package"] == ElementTree.parse(folder / "package.xml").getroot().findtext("name")
    assert f'"{node["executable"]} = ' in (folder / "setup.py").read_text()
    assert node["remappings"][0][0] == content["map_prediction"]["ros__parameters"]["scan_topic"] == defaults["scan"]
    asked = [*node["parameters"], *(topic for _, topic in node["remappings"])]
    assert [name for ((name,), _) in asked] == list(defaults)
