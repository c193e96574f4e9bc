"""What a call means: where its outputs, recordings and run directory lie, and what decides its result."""

from pathlib import Path

from repro.config import Config, world_spec
from repro.runs import Data, Outputs, Run, RunConfig

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "reproduce" / "results"


def outputs_of(config: Config) -> Outputs:
    return Outputs(Path(config.outputs), Path(config.recordings))


def recordings_of(config: Config) -> Path:
    return outputs_of(config).recordings(config.exp)


def run_of(config: Config) -> Run:
    return outputs_of(config).run(config.exp, config.model.name, config.encoding.variant, config.seed)


def run_config(config: Config) -> RunConfig:
    """Gathers what decides the result of a run; it becomes the run's config.yaml."""
    from repro.simulation.shards import spec_fingerprint

    spec = world_spec(config.world, config.exp)
    data = Data(
        config.scale.name,
        config.scale.size_px,
        float(spec["world"]["width"]),
        config.scale.pairs,
        spec_fingerprint(spec),
    )
    return RunConfig(config.exp, config.seed, config.model, config.encoding, data, config.train)
