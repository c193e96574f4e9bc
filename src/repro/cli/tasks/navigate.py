"""task=navigate: drive a robot to goals by the maps of one mapper, tuned alone, and compare the mappers."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from repro.cli.jobs import Job
from repro.cli.settings import NETWORK
from repro.cli.tasks import NETWORK_KEYS, Task
from repro.system.errors import InputError

if TYPE_CHECKING:
    from repro.maps.grid import Grid
    from repro.navigation.mappers import Mapper
    from repro.networks.predictor import Predictor


def run(job: Job) -> None:
    """Tune a mapper, drive its courses, and write the tables and the figure of all mappers that are finished.

    Raises:
        InputError: the network is of another map, or a world has no room for courses.
    """
    print(f"loading what drives a robot by the maps of {job.call.navigation.mapper}", flush=True)
    from repro.navigation.trials import Seeds, Trials
    from repro.recordings.datasets import grid_of
    from repro.reporting.navigation_tables import write_results
    from repro.runs.devices import few_threads
    from repro.runs.provenance import environment

    settings, directory = job.call.navigation, job.outputs.path / "navigation"
    specs = {name: job.call.specs[name] for name in settings.experiments}
    seeds = Seeds(settings.validation_seeds, settings.test_seeds)
    grid = grid_of(job.config)
    name, mapper = mapper_of(job, grid, settings.mapper)
    with few_threads():
        Trials(directory, name, mapper, specs, grid).run(seeds, environment())
    for row in write_results(directory, job.outputs.analysis).itertuples():
        success = f"{row.success:.3f} [{row.low:.3f}, {row.high:.3f}]"
        print(f"{row.experiment:8} {row.title:40} success {success} of {row.episodes} courses")
    print(f"{job.outputs.analysis}/navigation.csv has all, with the settings that were chosen")


def mapper_of(job: Job, grid: "Grid", name: str) -> tuple[str, "Mapper"]:
    """Return the name and the mapper of a call; that of a network has the name of its architecture and encoding."""
    from repro.baselines.registry import TRACKER
    from repro.evaluation.scoring import evaluate_baseline
    from repro.learning.networks.trained import load_trained, module_of
    from repro.navigation.mappers import CLASSICAL, network_mapper, tracker_mapper
    from repro.networks.predictor import load_predictor
    from repro.networks.weights import locate

    if name == NETWORK:
        path = locate(job.call.prediction.weights)
        predictor = load_predictor(path) if path.is_file() else load_trained(path)
        if predictor.grid != grid:
            expected, found = (f"{one.size_px} px, {one.size_m:g} m" for one in (grid, predictor.grid))
            hint = "reproduce/results/navigation/expmixed-convgru has 64 px, 50 m"
            raise InputError(f"prediction.weights={path}: expected maps of {expected}, got {found}; {hint}")
        if predictor.is_centered:
            raise InputError(
                "prediction.weights: an adapted network needs the robot in the middle, and these maps stand"
            )
        kind = "onnx" if path.is_file() else type(module_of(predictor)).__name__.lower()
        mapper = network_mapper(_in_onnx_runtime(predictor), weights=_checksum(path))
        return f"{kind}-{predictor.encoding.name}", mapper
    if name == "tracker":
        evaluate_baseline(job.outputs, job.config, name)
        tuned = job.outputs.run(job.config.of_baseline(name).key).provenance().last("evaluated") or {}
        return name, tracker_mapper({key: tuned[key] for key in (*TRACKER, "free_steps")})
    return name, CLASSICAL[name]


def _in_onnx_runtime(predictor: "Predictor") -> "Predictor":
    """Return a predictor whose network is in ONNX Runtime, where a window takes less than half the time."""
    from repro.learning.networks.trained import TorchNetwork, export_onnx
    from repro.networks.predictor import load_predictor

    if not isinstance(predictor.network, TorchNetwork):
        return predictor
    with TemporaryDirectory() as directory:
        export_onnx(predictor, path := Path(directory, "network.onnx"))
        return load_predictor(path)


def _checksum(path: Path) -> str:
    """Return the checksums of the files with weights."""
    from repro.system.files import sha256

    files = [path] if path.is_file() else sorted(path.rglob("*.safetensors"))
    return " ".join(map(sha256, files))


def _target(job: Job) -> Path:
    mapper = job.call.navigation.mapper
    name = f"{mapper} {job.call.prediction.weights}" if mapper == NETWORK else mapper
    return job.outputs.path / "navigation" / name.replace("/", " ")


TASK = Task(
    run,
    target=_target,
    own=("navigation", "prediction"),
    ignores=NETWORK_KEYS,
    instead="whose networks are those of prediction.weights",
)
