"""A call with everything resolved: the only place that turns the configuration into runs, directories and specs."""

from dataclasses import asdict, dataclass
from pathlib import Path

from repro.cli.call import Call
from repro.recordings.format import spec_fingerprint
from repro.runs.config import Data, RunConfig
from repro.runs.directories import Run
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.system.places import project_directory
from repro.world_config import WorldSpec, world_spec

ROOT = project_directory()
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

    call: Call
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


def resolve(call: Call) -> Job:
    """Resolve a call."""
    spec = world_spec(call.world, call.exp)
    data = Data(call.scale.name, call.scale.size_px, spec.world.width, call.scale.pairs, spec_fingerprint(spec))
    run = RunConfig(call.exp, call.seed, call.model, call.encoding, data, call.train)
    return Job(call, run, Outputs(Path(call.outputs), Path(call.recordings)), spec)
