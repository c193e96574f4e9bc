import math

import numpy as np
import pytest
from conftest import world_spec
from scipy.stats import kstest, norm

from repro.baselines import particles
from repro.baselines.association import observe, parameter_bounds
from repro.baselines.draws import newest_hit
from repro.baselines.laws import turned
from repro.baselines.particles import ASPECT, HEADING, IS_DISC, PARAMETERS, RADIUS, SPEED, TURN, X, Y
from repro.baselines.tempering import resample, temper
from repro.maps.grid import Grid
from repro.recordings.recorded import load_recorded
from repro.simulation.obstacle_motions import obstacle_states
from repro.simulation.recorder import record_experiment
from repro.simulation.shapes import shape_radius
from repro.simulation.worlds import sample_world

STEPS = 100


@pytest.fixture(scope="module")
def recorded_one(tmp_path_factory):
    directory = tmp_path_factory.mktemp("recordings") / "exp"
    record_experiment(directory, world_spec("3"), {"train": 2, "val": 2, "test": 2}, workers=1)
    return load_recorded(directory, "test", Grid(64, 50.0))


def as_particle(obstacle, states, reference, spec):
    """Return the particle of an obstacle of a world, None if it turns more often than a particle can."""
    particle, shape = np.zeros(PARAMETERS), obstacle["shape"]
    particle[[IS_DISC, RADIUS, ASPECT]] = 1.0, shape.get("radius", 0), 1.0
    if shape["name"] == "rectangle":
        area = shape["length"] * shape["width"]
        particle[[IS_DISC, RADIUS, ASPECT]] = 0.0, math.sqrt(area / math.pi), shape["length"] / shape["width"]
    particle[[X, Y]], particle[HEADING] = states[reference, :2], states[0, 2]
    start = np.array([obstacle["state"][:2]])
    moves = np.diff(np.concatenate([start, states[:, :2]]), axis=0)  # move k leads to state k
    bearing = np.arctan2(moves[:, 1], moves[:, 0])
    particle[SPEED], particle[TURN] = np.linalg.norm(moves[0]) / 0.1, STEPS
    particle[particles.BEARING] = particle[particles.NEXT_BEARING] = bearing[max(reference, 1)]
    bounces = 0
    for step in 1 + np.flatnonzero(np.abs(np.sin((bearing[1:] - bearing[:-1]) / 2)) > 5e-3):
        away = states[step - 1, :2] - 25
        ahead = np.linalg.norm(away + moves[step - 1])
        if ahead < spec.clear_radius_m + shape_radius(shape) and away @ moves[step - 1] < 0:
            particle[particles.FIRST_BOUNCE + min(bounces, 1)] = bearing[step] - math.atan2(away[1], away[0])
            bounces += 1
            if step <= reference:
                return None  # before the reference a particle has no turns at the zone
        else:
            particle[TURN] = step
            particle[particles.NEXT_BEARING], particle[particles.BEARING] = bearing[step], bearing[step - 1]
    return (particle, bounces) if bounces <= 2 else None


@pytest.mark.parametrize("reference", [0, 40, 99])
def test_the_paths_of_particles_are_those_of_the_simulation(reference):
    spec, compared, bounced = world_spec("4"), 0, 0
    for seed in range(40):
        for obstacle in sample_world(spec, seed)["obstacle"]:
            states = obstacle_states(obstacle, STEPS, 0.1)
            found = as_particle(obstacle, states, reference, spec)
            if found is None or (found[1] and found[0][TURN] < STEPS):
                continue
            path = particles.path(found[0], (0.1, 25.0, 25.0, spec.clear_radius_m, reference), STEPS)
            assert np.allclose(path, states[:, :2], atol=1e-6)
            compared, bounced = compared + 1, bounced + (found[1] > 0)
    assert compared > 200
    assert bounced > 0 or reference == 99


def test_moves_without_hits_keep_the_prior():
    rng, bounds = np.random.default_rng(0), parameter_bounds(world_spec("3"))
    bounds[:, [X, Y]] = [[19.0, 21.0], [31.0, 29.0]]
    population = rng.uniform(bounds[0], bounds[1], (3000, PARAMETERS))
    population[:, IS_DISC] = rng.random(3000) < 0.5
    before = population.copy()
    # the reference is near the middle of a large map without a zone, so that every start is lawful
    scans = (np.zeros((4, 5)), np.linspace(-0.7, 0.7, 5), np.tile([25.0, 25.0, 1.0, 0.0], (4, 1)), np.zeros((4, 5, 2)))
    known = ((0.1, 25.0, 25.0, -100.0, 2), (np.zeros(0, dtype=np.int64), np.zeros((0, 2))), scans)
    energy = particles.energies(population, *known)
    assert (energy == 0).all()
    for _ in range(40):
        particles.move(population, energy, 0.5, bounds, *known, rng)
    assert (population[:, 1:] != before[:, 1:]).all(1).mean() > 0.9
    assert np.array_equal(population[:, IS_DISC], before[:, IS_DISC])
    for kind in (0, 1):
        for number in range(1, PARAMETERS):
            values = population[population[:, IS_DISC] == kind, number]
            low, high = bounds[:, number]
            assert kstest((values - low) / (high - low), "uniform").pvalue > 1e-3, (kind, number)


def test_starts_are_lawful_where_the_path_begins_on_the_map():
    rng, bounds = np.random.default_rng(0), parameter_bounds(world_spec("3"))
    bounds[:, [X, Y]] = [[0.0, 0.0], [12.0, 50.0]]
    motion, lawful = (0.1, 25.0, 25.0, 4.0, 70), 0
    for particle in rng.uniform(bounds[0], bounds[1], (300, PARAMETERS)):
        particle[IS_DISC] = 1.0
        path = particles.path(particle, motion, STEPS)
        start = path[0] - 0.1 * particle[SPEED] * np.array(
            [np.cos(particle[particles.BEARING]), np.sin(particle[particles.BEARING])]
        )
        expected = particle[RADIUS] <= start.min() and start.max() <= 50 - particle[RADIUS]
        assert particles.starts_on_map(particle, motion) == expected
        lawful += expected
    assert 50 < lawful < 250


def test_a_longer_width_is_another_rectangle_where_the_laws_allow_it():
    """Moved sides keep the prior of aspects below 1, too."""
    spec = world_spec("1", obstacles={"aspect": [0.5, 2.0]})
    rng, bounds = np.random.default_rng(0), parameter_bounds(spec)
    bounds[:, [X, Y]] = [[15.0, 15.0], [35.0, 35.0]]
    population = rng.uniform(bounds[0], bounds[1], (3000, PARAMETERS))
    population[:, IS_DISC] = 0.0
    scans = (np.zeros((4, 5)), np.linspace(-0.7, 0.7, 5), np.tile([25.0, 25.0, 1.0, 0.0], (4, 1)), np.zeros((4, 5, 2)))
    known = ((0.1, 25.0, 25.0, -100.0, 2), (np.zeros(0, dtype=np.int64), np.zeros((0, 2))), scans)
    energy = particles.energies(population, *known)
    for _ in range(40):
        particles.move(population, energy, 0.5, bounds, *known, rng)
    assert kstest((population[:, ASPECT] - 0.5) / 1.5, "uniform").pvalue > 1e-3
    assert (population[:, SPEED] == 0).all()


def test_the_true_obstacles_agree_with_the_scans(recorded_one):
    spec = recorded_one.truth.spec
    ranges, angles, poses = (
        np.asarray(part, dtype=float)
        for part in (recorded_one.scans.ranges[0], recorded_one.scans.angles, recorded_one.scans.poses[0])
    )
    seen = observe((ranges, angles, poses), 30.0, spec, np.random.default_rng(0))
    outlines, states = recorded_one.truth.of_recording(0)
    known = turned(outlines, states)
    compared = 0
    for corners, own, path, state in zip(known.corners, outlines.astype(float), known.paths, states, strict=True):
        if not newest_hit(corners, path, ranges, angles, poses):
            continue
        sides = np.unique(own.round(4), axis=0)
        shape = {"name": "circle", "radius": np.linalg.norm(own, axis=1).max()}
        if len(sides) == 4:
            length, width = np.ptp(own, axis=0)
            shape = {"name": "rectangle", "length": length, "width": width}
        moves = np.diff(path, axis=0)
        found = as_particle({"shape": shape, "state": path[0] - moves[0]}, np.c_[path, state[:, 2]], 0, spec)
        if found is None:
            continue
        motion = seen.motion(0)
        share = particles.near(found[0][None], motion, (seen.steps, seen.points), 0.02, STEPS)
        mine = np.flatnonzero(share)
        hits = (seen.steps[mine], seen.points[mine])
        assert len(mine) > 5
        assert particles.energies(found[0][None], motion, hits, seen.scans)[0] < 1.5
        beside = found[0] + 0.5 * np.isin(np.arange(PARAMETERS), (X, Y))
        assert particles.energies(beside[None], motion, hits, seen.scans)[0] > 20
        compared += 1
    assert compared >= 4


def test_tempering_ends_at_the_posterior():
    rng = np.random.default_rng(0)
    values = rng.uniform(-10, 10, (4000, 1))

    def energies(values):
        return 0.5 * ((values[:, 0] - 3) / 0.2) ** 2

    def move(values, energy, weight):
        proposed = values + 0.3 * rng.normal(size=values.shape)
        new = energies(proposed)
        taken = (np.abs(proposed[:, 0]) <= 10) & (np.log(rng.random(len(new))) < weight * (energy - new))
        values[taken], energy[taken] = proposed[taken], new[taken]

    energy = energies(values)
    temper(values, energy, move, rng)
    assert np.array_equal(energy, energies(values))
    assert kstest(values[:, 0], norm(3, 0.2).cdf).statistic < 0.05


def test_particles_are_resampled_in_proportion_to_their_weights():
    chosen = resample(np.array([0.0, 1.0, 3.0, 0.0]), np.random.default_rng(0))
    assert sorted(chosen) == [1, 2, 2, 2]
