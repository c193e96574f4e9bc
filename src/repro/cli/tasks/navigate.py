"""task=navigate: drive a robot to goals by the maps of one arm, tuned alone, and compare the arms."""

from typing import Any

from repro.cli.jobs import Job
from repro.cli.tasks import Task

NETWORK_ARMS = ("network", "network_hits")


def run(job: Job) -> None:
    """Tune an arm, drive its courses, and write the tables and the figure of all arms that are finished.

    Raises:
        InputError: the arm is unknown, its network is not trained, or a world has no room for courses.
    """
    from repro.navigation.study import Seeds, Study
    from repro.reporting.navigation import write_results
    from repro.runs.provenance import environment
    from repro.system.devices import few_threads
    from repro.system.errors import InputError
    from repro.world_config import world_spec

    settings, directory = job.call.navigation, job.outputs.path / "navigation"
    unknown = [name for name in settings.experiments if name not in job.call.world["experiments"]]
    if unknown:
        known = ", ".join(job.call.world["experiments"])
        raise InputError(f"navigation.experiments: {', '.join(unknown)} is none of {known}: set world=navigation")
    specs = {name: world_spec(job.call.world, name) for name in settings.experiments}
    name, arm = _arm(job, settings.arm)
    seeds = Seeds(settings.validation_seeds, settings.test_seeds, settings.curve_seeds)
    study = Study(directory, name, arm, specs, _grid(job))
    with few_threads():
        study.run(seeds, environment())
    for row in write_results(directory, job.outputs.analysis).itertuples():
        print(f"{row.experiment:8} {row.title:32} success {row.success:.3f} [{row.low:.3f}, {row.high:.3f}]")


def _grid(job: Job) -> Any:
    from repro.maps.grid import Grid

    return Grid(job.config.data.size_px, job.config.data.size_m)


def _arm(job: Job, name: str) -> tuple[str, Any]:
    """Return an arm and its name, which for a network is that of its model."""
    from repro.baselines.registry import TRACKER
    from repro.navigation.arms import CLASSICAL, network_arm, tracker_arm
    from repro.networks.predictor import load_predictor
    from repro.system.errors import InputError

    if name in NETWORK_ARMS:
        from repro.evaluation.evaluate import check_trained

        job.run.check(job.config)
        check_trained(job.run)
        with_hits = name == "network_hits"
        label = f"{job.key.model}_hits" if with_hits else job.key.model
        return label, network_arm(load_predictor(job.run.model), with_hits=with_hits)
    if name == "tracker":
        from repro.evaluation.evaluate import evaluate_baseline

        evaluate_baseline(job.outputs, job.config, name)
        tuned = job.outputs.run(job.config.of_baseline(name).key).provenance().last("evaluated") or {}
        return name, tracker_arm({key: tuned[key] for key in (*TRACKER, "free_steps")})
    if name not in CLASSICAL:
        known = ", ".join([*CLASSICAL, "tracker", *NETWORK_ARMS])
        raise InputError(f"navigation.arm: expected one of {known}, got {name}")
    return name, CLASSICAL[name]


TASK = Task(run, own=("navigation",))
