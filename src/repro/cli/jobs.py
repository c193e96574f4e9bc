"""A call with everything resolved: the only place that turns the configuration into runs, directories and specs."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from repro.cli.config import Config, Demo, Prediction, Runtime
from repro.config import Scale, world_spec
from repro.learning.budget import Budget
from repro.recordings.format import spec_fingerprint
from repro.runs.config import Data, RunConfig
from repro.runs.directories import Outputs, Run
from repro.runs.keys import RunKey

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "reproduce" / "results"


@dataclass(frozen=True)
class Job:
    """A resolved call.

    Args:
        task: name of the task.
        config: everything that decides the result of the run.
        outputs: the outputs directory.
        spec: what decides the worlds of the experiment, see `worlds.sample_world`.
        experiments: all experiments of the world, by name.
        seed: seed of the training, or of the world for task=world and task=animate.
        scale: the scale.
        runtime: workers, accelerator, precision, time limit.
        force: whether published results may be replaced against the checks.
        add: whether runs are added to published results instead of replacing them.
        format: form of an exported network, torch or onnx.
        scans: the log of task=predict.
        floor_map: the map of task=floor.
        prediction: settings of task=predict.
        demo: settings of task=demo.
    """

    task: str
    config: RunConfig
    outputs: Outputs
    spec: dict[str, Any]
    experiments: Mapping[str, Any]
    seed: int
    scale: Scale
    runtime: Runtime
    force: bool
    add: bool
    format: str
    scans: str | None
    floor_map: str | None
    prediction: Prediction
    demo: Demo

    @property
    def key(self) -> RunKey:
        return self.config.key

    @property
    def run(self) -> Run:
        return self.outputs.run(self.key)

    @property
    def recordings(self) -> Path:
        return self.outputs.recordings(self.key.experiment)

    @property
    def pairs(self) -> dict[str, int]:
        return asdict(self.scale.pairs)

    @property
    def published(self) -> Path:
        """Directory of the published results of the outputs directory."""
        return RESULTS / self.outputs.path.name

    @property
    def reference(self) -> Path:
        """Directory of the published results to compare with: of the outputs directory, else of the scale."""
        return self.published if self.published.is_dir() else RESULTS / self.scale.name


def resolve(config: Config) -> Job:
    """Resolve a checked configuration."""
    spec = world_spec(config.world, config.exp)
    size_m = float(spec["world"]["width"])
    data = Data(config.scale.name, config.scale.size_px, size_m, config.scale.pairs, spec_fingerprint(spec))
    return Job(
        task=config.task,
        config=RunConfig(config.exp, config.seed, config.model, config.encoding, data, config.train),
        outputs=Outputs(Path(config.outputs), Path(config.recordings)),
        spec=spec,
        experiments=config.world["experiments"],
        seed=config.seed,
        scale=config.scale,
        runtime=config.runtime,
        force=config.publish.force,
        add=config.publish.add,
        format=config.format,
        scans=config.scans,
        floor_map=config.floor_map,
        prediction=config.prediction,
        demo=config.demo,
    )


@cache
def process_budget(minutes: float | None) -> Budget:
    """Return the time budget that all jobs of this process share."""
    return Budget(minutes)
