"""A classical tracker: clusters of hits, assigned to tracks with constant velocity, drawn at the last step.

The clusters come from scikit-learn's DBSCAN, the assignment from SciPy and the Kalman filter from Stone Soup.
"""

import datetime
from dataclasses import dataclass

import joblib
import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from sklearn.cluster import DBSCAN
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater
from torch import Tensor

from repro.maps.grid import Grid
from repro.parallel import count_cores, process_pool
from repro.recordings.recorded import Recorded
from repro.scans import Scans

NEAR_M = 1.5  # hits closer than this belong to one cluster
GATE_M = 3.0  # a cluster farther than this from every track starts a new one
NOISE_M = 0.5  # standard deviation of a cluster's center
SPEED_M_S = 0.5  # standard deviation of the initial speed
EVERY = 2  # steps from one update to the next; the paper's obstacles move at most 0.14 m in between
FEW = 64  # recordings that are tracked faster than processes start
START = datetime.datetime(2000, 1, 1)


@dataclass(frozen=True)
class Cluster:
    """A cluster of hits of one step: estimated obstacle center [m], (2,), and whether the field of view cuts it."""

    center: np.ndarray
    is_cut: bool


def track(recorded: Recorded, depth_m: float) -> list[np.ndarray]:
    """Track the obstacles of every recording up to the last step.

    Args:
        recorded: recordings, (M, T, N).
        depth_m: distance of an obstacle's center behind the mean of its hits, as seen from the robot [m].

    Returns:
        the positions of the tracks of each recording at the last step [m], (tracks, 2).
    """
    scans, step_s = recorded.scans, recorded.step_s
    ranges, poses, angles = scans.ranges.numpy(), scans.poses.numpy(), scans.angles.numpy()
    jobs = (joblib.delayed(_track_one)(r, angles, p, depth_m, step_s) for r, p in zip(ranges, poses, strict=True))
    with process_pool(count_cores() if len(ranges) > FEW else 1, batch_size=16) as parallel:
        return parallel(jobs)


def draw(tracks: list[np.ndarray], grid: Grid, radius_m: float) -> Tensor:
    """Draw a disc around every track; return the probability of free, (M, 1, H, W)."""
    centers = grid.centers().numpy()
    free = np.ones((len(tracks), len(centers)), dtype=np.float32)
    for image, positions in zip(free, tracks, strict=True):
        for position in positions:
            image[np.square(centers - position).sum(-1) <= radius_m**2] = 0
    return torch.as_tensor(free).view(len(tracks), 1, grid.size_px, grid.size_px)


def clusters(ranges: np.ndarray, angles: np.ndarray, poses: np.ndarray, depth_m: float) -> list[list[Cluster]]:
    """Compute the clusters of each scan of a recording.

    Args:
        ranges: ranges [m], inf for a miss, (T, N).
        angles: beam angles [rad], (N,).
        poses: x, y [m], heading [rad], (T, 3).
        depth_m: see `track`.
    """
    per_step: list[list[Cluster]] = [[] for _ in ranges]
    points, hit = Scans(ranges, angles, poses).points()
    step, beam = np.nonzero(hit)
    if not len(step):
        return per_step
    points = points[hit]
    separated = np.column_stack([points, 10 * NEAR_M * step])  # a third axis keeps the scans apart in one call
    label = DBSCAN(eps=NEAR_M, min_samples=2).fit_predict(separated)
    for number in range(label.max() + 1):
        members = label == number
        when, mean = int(step[members][0]), points[members].mean(0)
        away = mean - poses[when, :2]
        is_cut = bool(np.isin(beam[members], (0, len(angles) - 1)).any())
        per_step[when].append(Cluster(mean + depth_m * away / max(float(np.linalg.norm(away)), 1e-9), is_cut))
    return per_step


def _track_one(ranges: np.ndarray, angles: np.ndarray, poses: np.ndarray, depth_m: float, step_s: float) -> np.ndarray:
    """Track one recording, (T, N); a cluster that the field of view cuts starts a track but never updates one."""
    predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel([ConstantVelocity(0.01)] * 2))
    measured = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=np.eye(2) * NOISE_M**2)
    updater = KalmanUpdater(measured)
    tracks: list[GaussianState] = []
    chosen = slice((len(ranges) - 1) % EVERY, None, EVERY)  # includes the last step
    steps = np.arange(len(ranges))[chosen]
    for step, current in zip(steps, clusters(ranges[chosen], angles, poses[chosen], depth_m), strict=True):
        now = START + datetime.timedelta(seconds=step * step_s)
        pairs = _assign(np.array([each.center for each in current]), np.array([_position(t, now) for t in tracks]))
        for index, cluster in enumerate(current):
            detection = Detection(cluster.center[:, None], timestamp=now, measurement_model=measured)
            if index not in pairs:
                mean = [cluster.center[0], 0, cluster.center[1], 0]
                spread = np.diag([NOISE_M**2, SPEED_M_S**2] * 2)
                tracks.append(GaussianState(np.array(mean)[:, None], spread, timestamp=now))
            elif not cluster.is_cut:
                prior = predictor.predict(tracks[pairs[index]], timestamp=now)
                tracks[pairs[index]] = updater.update(SingleHypothesis(prior, detection))
    end = START + datetime.timedelta(seconds=(len(ranges) - 1) * step_s)
    return np.array([_position(each, end) for each in tracks]).reshape(-1, 2)


def _assign(centers: np.ndarray, positions: np.ndarray) -> dict[int, int]:
    """Assign clusters to tracks, one to one, with the smallest sum of distances and none beyond the gate."""
    if not len(centers) or not len(positions):
        return {}
    distance = np.linalg.norm(centers[:, None] - positions, axis=-1)
    rows, columns = linear_sum_assignment(np.minimum(distance, 10 * GATE_M))
    return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if distance[r, c] <= GATE_M}


def _position(state: GaussianState, now: datetime.datetime) -> np.ndarray:
    """Return the position of a track at a time, predicted by its velocity [m], (2,)."""
    x, vx, y, vy = np.asarray(state.state_vector, dtype=float).ravel()
    passed = (now - state.timestamp).total_seconds()
    return np.array([x + vx * passed, y + vy * passed])
