"""task=navigate: drive a robot to goals by the maps of one arm, tuned alone, and compare the arms."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from repro.cli.jobs import Job
from repro.cli.settings import NETWORK_ARMS
from repro.cli.tasks import NETWORK_KEYS, Task
from repro.system.errors import InputError

if TYPE_CHECKING:
    from repro.maps.grid import Grid
    from repro.navigation.arms import Arm
    from repro.navigation.study import Study


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

    def study_of(arm: str) -> Study:
        return Study(directory, *_arm(job, grid, arm), specs, grid, **options)

    study = study_of(settings.arm)
    with few_threads():
        study.run(seeds, environment())
    for row in write_results(directory, job.outputs.analysis).itertuples():
        print(f"{row.experiment:8} {row.title:32} success {row.success:.3f} [{row.low:.3f}, {row.high:.3f}]")
    if settings.arm in NETWORK_ARMS:
        _draw_replay(study, study_of, job.outputs.analysis)


def _draw_replay(study: "Study", study_of: Callable[[str], "Study"], analysis: Path) -> None:
    """Draw a course in which the robot reaches its goals by this arm, and collides by the best classical one."""
    import pandas as pd

    from repro.navigation.study import TEST
    from repro.reporting.animation import REPLAY, telling_course, watch, write_replay
    from repro.reporting.navigation import BEST_OF, best_classical, title_of

    directory = study.directory.parent
    rows = {name: directory / name / TEST for name in (study.name, *BEST_OF)}
    tests = {name: pd.read_csv(path).assign(arm=name) for name, path in rows.items() if path.is_file()}
    best = best_classical(pd.concat(tests.values()))
    course = telling_course(tests[study.name], tests[best]) if best else None
    if not best or not course:
        return
    studies = (study_of(best), study)
    fleets = [one.fleet([course], one.tested()) for one in studies]
    drives = [watch(fleet, title_of(one.name)) for fleet, one in zip(fleets, studies, strict=True)]
    goals, range_max_m = fleets[0].courses[0].goals, fleets[0].range_max_m
    path = analysis / REPLAY
    write_replay(drives, goals, path, size_m=study.grid.size_m, range_max_m=range_max_m)
    print(f"{path}: experiment {course[0]}, course {course[1]}")


def _arm(job: Job, grid: "Grid", name: str) -> tuple[str, "Arm"]:
    """Return the name and the arm of a call; that of a network has the name of its architecture and encoding."""
    from repro.baselines.registry import TRACKER
    from repro.cli.inputs import find
    from repro.evaluation.evaluate import evaluate_baseline
    from repro.navigation.arms import CLASSICAL, HITS, network_arm, tracker_arm
    from repro.networks.predictor import load_predictor

    if name in NETWORK_ARMS:
        path = find("prediction.weights", job.call.prediction.weights)
        predictor = load_predictor(path)
        if predictor.grid != grid:
            expected, found = (f"{one.size_px} px, {one.size_m:g} m" for one in (grid, predictor.grid))
            raise InputError(f"prediction.weights: its maps have {found}, expected those of the call, {expected}")
        if predictor.is_centered:
            raise InputError(
                "prediction.weights: an adapted network needs the robot in the middle, and these maps stand"
            )
        with_hits = name == "network_hits"
        label = f"{type(predictor.network).__name__.lower()}-{predictor.encoding.name}{HITS if with_hits else ''}"
        return label, network_arm(predictor, with_hits=with_hits, weights=_checksum(path))
    if name == "tracker":
        evaluate_baseline(job.outputs, job.config, name)
        tuned = job.outputs.run(job.config.of_baseline(name).key).provenance().last("evaluated") or {}
        return name, tracker_arm({key: tuned[key] for key in (*TRACKER, "free_steps")})
    return name, CLASSICAL[name]


def _checksum(path: Path) -> str:
    """Return the checksums of the files with weights."""
    from repro.system.files import sha256

    files = [path] if path.is_file() else sorted([*path.rglob("*.safetensors"), *path.rglob("*.onnx")])
    return " ".join(map(sha256, files))


TASK = Task(
    run,
    own=("navigation", "prediction"),
    ignores=NETWORK_KEYS,
    instead="whose networks are those of prediction.weights",
)
