"""A call with everything resolved: the only place that turns the configuration into runs, directories and specs."""

from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

from repro.cli.call import Call
from repro.recordings.format import spec_fingerprint
from repro.runs.config import Data, RunConfig
from repro.runs.directories import Run
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.system.project import project_directory
from repro.worlds.spec import WorldSpec

ROOT = project_directory()
RESULTS = ROOT / "reproduce" / "results"


@dataclass(frozen=True)
class Job:
    """A resolved call; what a task does not ask for is not resolved, since the worlds need IR-SIM."""

    call: Call

    @cached_property
    def spec(self) -> WorldSpec:
        """What decides the worlds of the experiment."""
        return self.call.specs[self.call.exp]

    @cached_property
    def config(self) -> RunConfig:
        """Everything that decides the result of the run."""
        call, width = self.call, self.spec.world.width
        data = Data(call.scale.name, call.scale.size_px, width, call.scale.pairs, spec_fingerprint(self.spec))
        return RunConfig(call.exp, call.seed, call.model, call.encoding, data, call.train)

    @property
    def outputs(self) -> Outputs:
        """The outputs directory."""
        return Outputs(Path(self.call.outputs), Path(self.call.recordings))

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
