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
    "inference": "Inference from scans",  # published rows only: DEVIATIONS D25
}
QUICK_BASELINES = ("all_free", "last_seen")  # evaluated together with every network; task=analysis evaluates the others


def rank(model: str) -> int:
    """Return the position of a model in tables: the paper's networks, their average, other networks, baselines."""
    order = [*NETWORKS, "average", None, *BASELINES]
    return order.index(model if model in order else None)
