"""task=navigate: drive a robot to goals by the maps of one arm, tuned alone, and compare the arms."""

from typing import Any

from repro.cli.jobs import Job
from repro.cli.settings import NETWORK_ARMS
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Tune an arm, drive its courses, and write the tables and the figure of all arms that are finished.

    Raises:
        InputError: the network of the arm is not trained, or a world has no room for courses.
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
    study = Study(directory, *_arm(job), specs, grid_of(job.config))
    with few_threads():
        study.run(seeds, environment())
    for row in write_results(directory, job.outputs.analysis).itertuples():
        print(f"{row.experiment:8} {row.title:32} success {row.success:.3f} [{row.low:.3f}, {row.high:.3f}]")


def _arm(job: Job) -> tuple[str, Any]:
    """Return the name and the arm of a call; that of a network has the name of its model and encoding."""
    from repro.baselines.registry import TRACKER
    from repro.evaluation.evaluate import check_trained, evaluate_baseline
    from repro.navigation.arms import CLASSICAL, HITS, network_arm, tracker_arm
    from repro.networks.predictor import load_predictor

    name = job.call.navigation.arm
    if name in NETWORK_ARMS:
        job.run.check(job.config)
        check_trained(job.run)
        with_hits = name == "network_hits"
        label = f"{job.key.model}-{job.key.encoding}{HITS if with_hits else ''}"
        return label, network_arm(load_predictor(job.run.model), with_hits=with_hits)
    if name == "tracker":
        evaluate_baseline(job.outputs, job.config, name)
        tuned = job.outputs.run(job.config.of_baseline(name).key).provenance().last("evaluated") or {}
        return name, tracker_arm({key: tuned[key] for key in (*TRACKER, "free_steps")})
    return name, CLASSICAL[name]


TASK = Task(run, own=("navigation",))
