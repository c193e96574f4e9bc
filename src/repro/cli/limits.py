"""What a call takes on this machine, estimated before anything slow begins."""

from repro.config import Encoding, Scale, Training
from repro.fields import ConfigError
from repro.parallel import training_memory_gb
from repro.system.memory import total_memory_gb
from repro.world_config import WorldSpec

SECONDS_PER_READING = 2e-6  # of the recorder on one core


def cpu_errors(scale: Scale, train: Training, encoding: Encoding, precision: str) -> list[ConfigError]:
    """Return an error if a training on the CPU cannot compute in a precision or does not fit into the memory."""
    if precision.startswith("16"):
        return [ConfigError("runtime.precision", precision, "float16 needs a GPU, use auto, 32-true or bf16-mixed")]
    pairs, channels = scale.pairs.train + scale.pairs.val, encoding.most_channels
    needed = training_memory_gb(scale.size_px, train.batch_size, pairs, channels, train.loss)
    there = total_memory_gb()
    if needed <= there:
        return []
    expected = (
        f"at {scale.size_px} px and batches of {train.batch_size} a training takes about {needed:.0f} GB of memory, "
        f"this machine has {there:.0f} GB"
    )
    return [ConfigError("scale.pairs.train", scale.pairs.train, expected)]


def recording_seconds(spec: WorldSpec, recordings: int) -> float:
    """Estimate the time to record an experiment on one core [s].

    Args:
        spec: what decides the worlds.
        recordings: number of recordings.
    """
    readings = spec.steps * spec.lidar.number
    return recordings * readings * SECONDS_PER_READING
