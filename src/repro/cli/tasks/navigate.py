"""task=navigate: drive a robot to goals by the maps of one arm, tuned alone, and compare the arms."""

from typing import TYPE_CHECKING, Any

from repro.cli.jobs import Job
from repro.cli.settings import NETWORK_ARMS
from repro.cli.tasks import NETWORK_KEYS, Task
from repro.system.errors import InputError

if TYPE_CHECKING:
    from repro.maps.grid import Grid
    from repro.navigation.arms import Arm


def run(job: Job) -> None:
    """Tune an arm, drive its courses, and write the tables and the figure of all arms that are finished.

    Raises:
        InputError: the network is of another map, or a world has no room for courses.
    """
    from repro.navigation.study import Seeds, Study
    from repro.recordings.datasets import grid_of
    from repro.reporting.navigation import write_results
    from repro.runs.provenance import environment
    from repro.system.devices import few_threads
    from repro.world_config import world_spec

    settings, directory = job.call.navigation, job.outputs.path / "navigation"
    specs = {name: world_spec(job.call.world, name) for name in settings.experiments}
    seeds = Seeds(settings.validation_seeds, settings.test_seeds, settings.curve_seeds)
    grid = grid_of(job.config)
    options: dict[str, Any] = {"inflations_m": settings.inflations_m, "people": settings.people}
    study = Study(directory, *_arm(job, grid), specs, grid, **options)
    with few_threads():
        study.run(seeds, environment())
    for row in write_results(directory, job.outputs.analysis).itertuples():
        print(f"{row.experiment:8} {row.title:32} success {row.success:.3f} [{row.low:.3f}, {row.high:.3f}]")


def _arm(job: Job, grid: "Grid") -> tuple[str, "Arm"]:
    """Return the name and the arm of a call; that of a network has the name of its architecture and encoding."""
    from repro.baselines.registry import TRACKER
    from repro.cli.inputs import find
    from repro.evaluation.evaluate import evaluate_baseline
    from repro.navigation.arms import CLASSICAL, HITS, network_arm, tracker_arm
    from repro.networks.predictor import load_predictor

    name = job.call.navigation.arm
    if name in NETWORK_ARMS:
        predictor = load_predictor(find("prediction.weights", job.call.prediction.weights))
        if predictor.grid != grid:
            expected, found = (f"{one.size_px} px, {one.size_m:g} m" for one in (grid, predictor.grid))
            raise InputError(f"prediction.weights: its maps have {found}, expected those of the call, {expected}")
        with_hits = name == "network_hits"
        label = f"{type(predictor.network).__name__.lower()}-{predictor.encoding.name}{HITS if with_hits else ''}"
        return label, network_arm(predictor, with_hits=with_hits)
    if name == "tracker":
        evaluate_baseline(job.outputs, job.config, name)
        tuned = job.outputs.run(job.config.of_baseline(name).key).provenance().last("evaluated") or {}
        return name, tracker_arm({key: tuned[key] for key in (*TRACKER, "free_steps")})
    return name, CLASSICAL[name]


TASK = Task(
    run,
    own=("navigation", "prediction"),
    ignores=NETWORK_KEYS,
    instead="whose networks are those of prediction.weights",
)
