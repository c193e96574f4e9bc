"""Names and titles of the baselines; imports no numerical library."""

from repro.runs.model import NETWORKS

BASELINES = {
    "all_free": "All free",
    "mean_map": "Mean map",
    "last_seen": "Last seen",
    "occupancy": "Occupancy grid",
    "transitional": "Transitional grid",
    "tracker": "Tracker",
    "privileged": "Upper bound",  # of reproduce/upper_bound.py; no task evaluates it
}
OTHER_BOUNDS = {  # published rows only, their code is in older versions (docs/analysis.md, DEVIATIONS D25)
    "with_unseen": "Upper bound, with unseen obstacles",
    "without_shapes": "Upper bound, without shapes",
    "without_velocities": "Upper bound, without velocities",
    "positions": "Upper bound, positions only",
    "inference": "Inference from scans",
}
BOUNDS = ("privileged", *OTHER_BOUNDS)
LIMITS = ("privileged", "inference")  # the best prediction from scans lies between them
QUICK_BASELINES = ("all_free", "last_seen")  # evaluated together with every network; task=analysis evaluates the others


def rank(model: str) -> int:
    """Return the position of a model in tables: the paper's networks, their average, other networks, baselines."""
    order = [*NETWORKS, "average", None, *BASELINES, *OTHER_BOUNDS]
    return order.index(model if model in order else None)
