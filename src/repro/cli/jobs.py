"""A call with everything resolved: the only place that turns the configuration into runs, directories and specs."""

from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from repro.cli.config import Config
from repro.learning.budget import Budget
from repro.recordings.format import spec_fingerprint
from repro.runs.config import Data, RunConfig
from repro.runs.directories import Run
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.world_config import WorldSpec, world_spec

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "reproduce" / "results"


@dataclass(frozen=True)
class Job:
    """A resolved call.

    Args:
        call: the whole configuration.
        config: everything that decides the result of the run.
        outputs: the outputs directory.
        spec: what decides the worlds of the experiment.
    """

    call: Config
    config: RunConfig
    outputs: Outputs
    spec: WorldSpec

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
        return asdict(self.call.scale.pairs)

    @property
    def published(self) -> Path:
        """Directory of the published results of the outputs directory."""
        return RESULTS / self.outputs.path.resolve().name

    @property
    def reference(self) -> Path:
        """Directory of the published results to compare with: of the outputs directory, else of the scale."""
        return self.published if (self.published / "runs.csv").is_file() else RESULTS / self.call.scale.name


def resolve(config: Config) -> Job:
    """Resolve a checked configuration."""
    spec = world_spec(config.world, config.exp)
    data = Data(config.scale.name, config.scale.size_px, spec.world.width, config.scale.pairs, spec_fingerprint(spec))
    run = RunConfig(config.exp, config.seed, config.model, config.encoding, data, config.train)
    return Job(config, run, Outputs(Path(config.outputs), Path(config.recordings)), spec)


@cache
def process_budget(minutes: float | None) -> Budget:
    """Return the time budget that all jobs of this process share."""
    return Budget(minutes)
