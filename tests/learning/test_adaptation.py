"""Networks that learn from the beams of a wide lidar outside of their view."""

import math
import resource
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from conftest import ROOT, read_calls

from repro.cli import log_adaptation
from repro.cli.jobs import Job
from repro.cli.main import perform
from repro.cli.tasks import adapt as task
from repro.learning import adaptation, rehearsal
from repro.learning.adaptation import PartialLoss, adapt, label
from repro.learning.held_out import View, labeled, turns_of
from repro.learning.labels import MOVER, UNKNOWN, Labeled
from repro.learning.networks.trained import load_trained, module_of
from repro.learning.platt import calibrate
from repro.learning.rehearsal import SHARES, recorded, rehearsed
from repro.logs.options import window_of
from repro.logs.scan_log import ScanLog
from repro.maps.series import Series
from repro.maps.statistics import Statistics
from repro.recordings.datasets import HIDDEN, Pairs
from repro.scans import wrapped
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import simulate
from repro.system.errors import InputError
from repro.worlds.spec import read_world, world_spec

PREDICTOR = load_trained("rooms")


@pytest.fixture(scope="module")
def log() -> ScanLog:
    """Return 50 s of a lidar of 180 degrees on a robot that drives through rooms."""
    world = read_world(ROOT / "conf" / "world" / "rooms.yaml")
    world["experiments"]["people"]["motion"] |= {"steps": 500}
    spec = world_spec(world, "people").with_lidar(angle_range=math.pi, number=181)
    scans = simulate(sample_world(spec, 100_011)).scans
    return ScanLog(np.arange(500) * 0.1, scans.ranges.astype(np.float32), scans.angles, scans.poses, range_max_m=30.0)


@pytest.fixture
def short_schedule(monkeypatch):
    monkeypatch.setattr(adaptation, "MAX_WINDOWS", 8)
    monkeypatch.setattr(adaptation, "DRAWS", 3)
    monkeypatch.setattr(adaptation, "TRAINED_WINDOWS", 1)
    monkeypatch.setattr(adaptation, "EPOCHS", (1,))
    monkeypatch.setattr(adaptation, "SCHEDULE", replace(adaptation.SCHEDULE, learning_rate=1e-4))


@pytest.mark.parametrize(("sees_deg", "turns_deg"), [(180, [-45, 0, 45]), (270, [-90, -45, 0, 45, 90])])
def test_views_are_within_the_lidar(log, sees_deg, turns_deg):
    wide = replace(log, angles=np.radians(np.linspace(-sees_deg / 2, sees_deg / 2, len(log.angles))))
    assert np.degrees(turns_of(wide, math.pi / 2)) == pytest.approx(turns_deg)


def test_a_lidar_that_sees_no_more_than_the_network_is_refused(log):
    with pytest.raises(ValueError, match=r"a lidar that sees 110 degrees or more.*, got 90 degrees"):
        turns_of(log.crop(math.pi / 2), math.pi / 2)


@pytest.mark.parametrize("turn", [-math.pi / 4, 0.0, math.pi / 4])
def test_a_view_has_the_beams_within_it_and_labels_are_of_the_others(log, turn):
    inside, bearings = np.abs(log.angles - turn) <= math.pi / 4 + 1e-6, []
    for window, shown in labeled(log, window_of(PREDICTOR), 50, PREDICTOR.grid, View(turn_rad=turn)):
        number = int(np.searchsorted(log.stamps, window.stamp))
        heading = log.poses[number, 2]
        assert np.array_equal(window.scans.ranges[-1], log.ranges[number, inside])
        directions = window.scans.poses[-1, 2] + window.scans.angles
        assert wrapped(directions - heading - log.angles[inside]) == pytest.approx(0, abs=1e-6)
        x, y = PREDICTOR.grid.centers()[np.flatnonzero(shown.hits)].T - PREDICTOR.grid.size_m / 2
        is_far = np.hypot(x, y) > 2  # a near pixel covers many directions
        bearings.append(wrapped(np.arctan2(y, x) - heading)[is_far])
    bearing = np.concatenate(bearings)
    assert len(bearing) > 50
    assert (np.abs(bearing - turn) > math.pi / 4 - 0.1).all()
    assert (np.abs(bearing) < math.pi / 2 + 0.1).all()


def test_labels_are_free_obstacle_or_unknown_and_of_separate_parts_of_the_log(log, short_schedule):
    train, val = label(log, window_of(PREDICTOR), PREDICTOR, View(), seed=0)
    assert 21 <= len(train.pairs) <= 27  # through three views
    assert 7 <= len(val.pairs) <= 9  # of the last 12 s
    for part in (train, val):
        assert part.pairs.maps.unique().tolist() == [0, 1, UNKNOWN]
        assert part.statistics.quantiles["fov_deg"][2] == pytest.approx(90, abs=1)


def test_a_log_that_is_too_short_is_refused(log):
    with pytest.raises(ValueError, match=r"the log has 3\.0 s of scans, a window of 100 steps takes 9\.9 s"):
        label(adaptation._part(log, log.stamps < 15), window_of(PREDICTOR), PREDICTOR, View(), seed=0)


def test_the_loss_is_that_of_known_pixels_and_windows_count_alike():
    logits = torch.tensor([[[[-1.0, 3, 9, 8]]], [[[2.0, 7, -5, 1]]]], requires_grad=True)
    target = torch.tensor([[[[1, UNKNOWN, UNKNOWN, UNKNOWN]]], [[[0, 1 + MOVER, 1 + HIDDEN, UNKNOWN + HIDDEN]]]])
    loss = PartialLoss()(logits, target)
    loss.backward()
    softplus = torch.nn.functional.softplus(torch.tensor([1.0, 2, -7, 5]))
    second = (softplus[1] + 5 * softplus[2] + 0.1 * softplus[3]) / 6.1
    assert loss.item() == pytest.approx(float(softplus[0] + second) / 2)
    assert logits.grad.flatten().nonzero().flatten().tolist() == [0, 4, 5, 6]


def test_windows_of_a_log_are_drawn_by_their_labels(log, monkeypatch):
    """So that all labels of a log count alike, though the loss is a mean over those of a window."""
    monkeypatch.setattr(adaptation, "MAX_WINDOWS", 40)
    monkeypatch.setattr(adaptation, "DRAWS", 1)
    train, _ = label(log, window_of(PREDICTOR), PREDICTOR, View(), seed=0)
    known = (train.pairs.maps != UNKNOWN).sum((1, 2, 3))
    times = {int(count): int((known == count).sum()) for count in known.unique()}
    assert max(times.values()) > 1  # drawn more than once
    large = sum(number for count, number in times.items() if count > known.float().mean())
    assert large > len(known) / 2


def test_a_calibrated_network_has_the_frequencies_of_the_labels():
    """Logits that are twice too large and shifted are corrected; what the label is depends on the image alone."""
    network = torch.nn.Sequential(torch.nn.Conv2d(20, 4, 1), torch.nn.Conv2d(4, 1, 1)).eval()
    with torch.no_grad():
        for layer in network:
            layer.weight.fill_(0.25)
            layer.bias.zero_()
        network[1].weight.mul_(6)
        network[1].bias.fill_(-2)
    rng, shares = torch.Generator().manual_seed(0), torch.linspace(0, 1, 21)
    stored = torch.zeros(21, 20, 64, 8, dtype=torch.uint8)
    for number, images in enumerate(stored):
        images[number:] = 255
    free = torch.rand(21, 1, 64, 64, generator=rng) < torch.sigmoid(3 * shares - 1).flip(0)[:, None, None, None]
    pairs = Pairs(stored, free.to(torch.uint8), Series(10))
    calibrate(network, pairs)
    with torch.inference_mode():
        predicted = torch.cat([network(pairs.batch(torch.tensor([n]))[0]).sigmoid().mean((1, 2, 3)) for n in range(21)])
    assert (predicted - free.float().mean((1, 2, 3))).abs().max() < 0.02


def test_simulated_windows_have_the_robot_in_the_middle_and_nothing_known_outside():
    simulated = recorded(PREDICTOR, 6)
    codes = simulated.pairs.maps[:, 0]
    assert isinstance(simulated, Labeled)
    assert set((codes & ~MOVER).unique().tolist()) <= {0, 1, UNKNOWN, HIDDEN, 1 + HIDDEN}
    assert (codes[:, 63:65, 63:65] & ~MOVER == 1).all()  # the robot stands in the open, and is seen
    outside = (codes == UNKNOWN).float().mean((1, 2))
    assert ((outside > 0) & (outside < 0.8)).all()  # of the world
    assert 0.002 < (codes == 0).float().sum() / (codes < HIDDEN).float().sum() < 0.5


def test_each_round_rehearses_in_windows_of_its_own(monkeypatch):
    monkeypatch.setattr(rehearsal, "recorded", lambda predictor, count: count)
    assert list(rehearsed(PREDICTOR, 100)) == [round(100 * share) for share in SHARES]
    assert len(SHARES) == len(adaptation.EPOCHS)


def test_where_something_that_moves_can_be_is_marked():
    """Open worlds are taken that lose somebody, and whoever was in view lately is within the marked pixels."""
    spec, grid, lost = rehearsal._spec("rooms", "crossing"), PREDICTOR.grid, 0
    for seed in range(6):
        recording = rehearsal._recorded(spec, range(seed, seed + 40, 10))
        codes = rehearsal._window(recording, spec, grid)[1]
        seen = list(rehearsal._seen(recording, spec))
        lost += any(mover.is_lost for mover in seen)
        marked, known = (codes & MOVER) > 0, codes & UNKNOWN == 0
        obstacles = known & (codes & 1 == 0)
        assert marked.any() == (len(seen) > 0)
        assert not seen or obstacles[marked].mean() > 3 * obstacles[known & ~marked].mean()
    assert lost >= 5


def test_statistics_are_widened_and_keep_their_median():
    one = Statistics(10, {"path_m": (1.0, 2.0, 3.0, 4.0, 5.0)})
    other = Statistics(5, {"path_m": (0.5, 0.6, 0.7, 6.0, 7.0), "valid_share": (0.5, 0.6, 0.7, 0.8, 0.9)})
    both = one.widened(other)
    assert both.windows == 15
    assert both.quantiles == {"path_m": (0.5, 2.0, 3.0, 4.0, 7.0), "valid_share": (0.5, 1.0, 1.0, 1.0, 1.0)}


def test_too_few_windows_are_refused_before_worlds_are_recorded(tmp_path, monkeypatch):
    monkeypatch.setattr(log_adaptation, "_labeled", lambda *_, seed: (SimpleNamespace(pairs=[0]), None))
    monkeypatch.setattr(log_adaptation, "rehearsed", None)
    (call,) = read_calls("task=adapt", "adaptation.logs=examples/rooms.npz", f"outputs={tmp_path}")
    with pytest.raises(InputError, match="the logs have 1 windows for training, expected 4 or more"):
        task.run(Job(call))


def test_outputs_that_take_no_network_are_refused_before_logs_are_read(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(log_adaptation, "_labeled", None)
    (call,) = read_calls("task=adapt", "adaptation.logs=examples/rooms.npz", f"outputs={tmp_path}")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limits[1]))  # as a full disk
    try:
        assert perform(call).startswith(f"{tmp_path}/adapted")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "rooms: File too large: free some space" in capsys.readouterr().err
    assert not list((tmp_path / "adapted").iterdir())


@pytest.mark.slow
def test_an_adapted_network_predicts_the_held_out_beams_better(log, short_schedule, monkeypatch):
    monkeypatch.setattr(adaptation, "MAX_WINDOWS", 40)
    monkeypatch.setattr(adaptation, "VALIDATION_SHARE", 0.4)
    monkeypatch.setattr(adaptation, "EPOCHS", (2, 1))
    monkeypatch.setattr(adaptation, "SCHEDULE", replace(adaptation.SCHEDULE, ema_decay=0.9))
    before = {name: value.clone() for name, value in module_of(PREDICTOR).state_dict().items()}
    data = [label(log, window_of(PREDICTOR), PREDICTOR, View(), seed=0)]
    adapted, loss, less = adapt(PREDICTOR, data, seed=0)
    assert less < 0.95 * loss
    assert all(torch.equal(value, before[name]) for name, value in module_of(PREDICTOR).state_dict().items())
    assert adapted.statistics.windows > PREDICTOR.statistics.windows


@pytest.mark.slow
def test_the_task_writes_a_network_that_the_prediction_takes_and_overwrites_none(tmp_path, short_schedule, log):
    content = {"ranges": log.ranges, "angles": log.angles, "poses": log.poses, "stamps": log.stamps}
    np.savez(tmp_path / "wide.npz", **content, range_max_m=30.0)
    (call,) = read_calls("task=adapt", f"adaptation.logs=[{tmp_path / 'wide.npz'}]", f"outputs={tmp_path}")
    task.run(Job(call))
    target = tmp_path / "adapted" / "wide"
    assert sorted(path.name for path in target.parent.iterdir() if path.is_dir()) == ["wide"]
    window = next(labeled(log, window_of(PREDICTOR), 100, PREDICTOR.grid, View()))[0]
    one, other = (load_trained(weights).predict(window.scans) for weights in (target, "rooms"))
    assert not np.array_equal(one, other)
    written = {path: path.read_bytes() for path in Path(target).iterdir()}
    with pytest.raises(ValueError, match=r"wide exists: set adaptation.name to another one"):
        task.run(Job(call))
    assert {path: path.read_bytes() for path in target.iterdir()} == written
