import math

import numpy as np
import pytest
import yaml
from conftest import world_spec

from repro.simulation.sampling import reverse_direction, sample_world, write_world
from repro.simulation.shapes import shape_radius
from repro.simulation.simulator import check_replay, drive_robot, simulate


@pytest.mark.parametrize("seed", range(20))
def test_obstacles_are_apart_inside_the_map_and_outside_the_zone(spec, seed):
    obstacles = sample_world(spec, seed)["obstacle"]
    low, high = spec.obstacles.count
    assert low <= len(obstacles) <= high
    places = [(np.array(o["state"][:2]), shape_radius(o["shape"])) for o in obstacles]
    for index, (place, radius) in enumerate(places):
        assert (place >= radius).all()
        assert (place <= 50 - radius).all()
        assert math.hypot(*(place - 25)) >= spec.clear_radius_m + radius
        assert all(math.hypot(*(place - other)) >= radius + r for other, r in places[:index])


def test_twins_share_obstacles_and_differ_in_direction_only(spec):
    world = sample_world(spec, 3)
    twin = reverse_direction(world)
    assert twin["obstacle"] == world["obstacle"]
    assert twin["robot"]["behavior"] == {**world["robot"]["behavior"], "direction": -1}
    assert reverse_direction(twin) == world


def test_the_twin_drives_the_mirrored_path(spec):
    (there, back) = (drive_robot(w)[:, :2] for w in (sample_world(spec, 0), reverse_direction(sample_world(spec, 0))))
    assert np.allclose(there * [1, -1] + [0, 50], back, atol=1e-9)


def test_rectangles_have_the_area_of_their_disc():
    spec = world_spec("1", obstacles={"radius_m": [2.0, 2.0], "disc_share": 0.0})
    for obstacle in sample_world(spec, 0)["obstacle"]:
        assert obstacle["shape"]["length"] * obstacle["shape"]["width"] == pytest.approx(4 * math.pi)


def test_written_world_is_plain_yaml(spec, tmp_path):
    world = sample_world(spec, 1)
    write_world(world, tmp_path / "world.yaml")
    assert yaml.safe_load((tmp_path / "world.yaml").read_text()) == world


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("1", {"obstacles": {"count": [80, 80]}}, r"no room for \[80, 80\] obstacles"),
        ("2", {"motion": {"side_m": 30.0}}, r"reaches 21\.71 m .* clear_radius_m=8\.5"),
        ("1", {"world": {"width": 100}}, r"must be square, got world\.world\.width=100 and height=50"),
    ],
)
def test_a_world_that_cannot_be_is_refused(name, changes, message):
    with pytest.raises(ValueError, match=message):
        sample_world(world_spec(name, **changes), 0)


def test_an_experiment_may_have_any_name():
    office, lobby = (world_spec("3", experiment=name) for name in ("office", "lobby"))
    assert sample_world(office, 5) == sample_world(office, 5)
    assert sample_world(office, 5) != sample_world(lobby, 5)
    assert sample_world(office, 5) != sample_world(world_spec("3"), 5)


@pytest.mark.parametrize("experiment", ["3", "4"])
def test_a_turned_motion_is_the_same_motion_about_the_center_among_the_same_obstacles(experiment):
    spec = world_spec(experiment)
    turned = world_spec(experiment, motion={"turned_rad": [-math.pi, math.pi]})
    plain, worlds = sample_world(spec, 5), [sample_world(turned, seed) for seed in (5, 5, 6)]
    assert worlds[0] == worlds[1]
    assert worlds[0]["obstacle"] == plain["obstacle"]
    angle = worlds[0]["robot"]["behavior"]["turned_rad"]
    assert angle != worlds[2]["robot"]["behavior"]["turned_rad"]
    back = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    for plain_twin, twin in ((plain, worlds[0]), (reverse_direction(plain), reverse_direction(worlds[0]))):
        upright, poses = drive_robot(plain_twin), drive_robot(twin)
        assert np.allclose((poses[:, :2] - 25) @ back + 25, upright[:, :2], atol=1e-9)
        assert np.allclose(np.exp(1j * (poses[:, 2] - angle)), np.exp(1j * upright[:, 2]))
    check_replay(worlds[0], simulate(worlds[0]))
