"""Validation of a configuration as a whole, before anything slow is imported and anything is written."""

import os
import stat
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from repro.cli.config import TRAINING_TASKS, Config, to_typed
from repro.cli.limits import cpu_errors, recording_seconds
from repro.cli.suggestions import with_suggestion
from repro.config import EVERY_PART, RECURRENT, Encoding, EncodingParameters, NetworkParameters
from repro.fields import OLDEST_GRAY, ConfigError, config_errors_of
from repro.networks.model import NETWORKS, PAPER_ENCODER, Model
from repro.parallel import has_gpu
from repro.simulation.schema import world_errors
from repro.world_config import world_spec

MIT_ENCODERS = tuple(f"mit_b{size}" for size in range(6))
MIT_WEIGHTS = (None, "imagenet")  # the weights that smp has for each of them
LONG_RECORDING_MINUTES = 30


def all_errors(values: dict[str, Any]) -> list[ConfigError]:
    """Return everything that is wrong with a configuration.

    Args:
        values: the whole configuration as plain values.

    Returns:
        the errors. Checks that need a slow import are made for unusual values only, when everything else is right.
    """
    errors = config_errors(values) + [with_suggestion(error, values) for error in world_errors(values["world"])]
    if errors:
        return errors
    config = to_typed(values)
    errors = _path_errors(config.outputs, config.recordings) + _library_errors(config)
    errors = errors or _encoding_errors(config.encoding) + _device_errors(config.runtime.accelerator)
    return errors or _window_errors(config)


def config_errors(values: dict[str, Any]) -> list[ConfigError]:
    """Return everything that is wrong with a configuration except for `world`, see `simulation.schema.world_errors`.

    Args:
        values: the whole configuration as plain values.

    Returns:
        the errors of single values; where there are none, those of their combinations.
    """
    try:
        config = to_typed(values)
    except ValidationError as error:
        errors = [with_suggestion(found, values) for found in config_errors_of(error)]
        keys = {found.key for found in errors}  # conf/train takes some of its values from the scale
        return [e for e in errors if not (e.key.startswith("train.") and e.key.replace("train", "scale") in keys)]
    errors = []
    experiments = config.world.get("experiments")
    if isinstance(experiments, dict) and experiments and config.exp not in experiments:
        errors.append(ConfigError("exp", config.exp, f"must be one of {', '.join(experiments)}"))
    if config.task in (*TRAINING_TASKS, "plan") and config.train.batch_size > config.scale.pairs.train:
        expected = f"must be at most the {config.scale.pairs.train} training pairs"
        errors.append(ConfigError("train.batch_size", config.train.batch_size, expected))
    if not config.decay and "decay" not in config.encoding.parameters:
        errors.append(ConfigError("decay", "false", f"the encoding {config.encoding.name} has no decay"))
    if config.encoding.parameters.get("decay") is (not config.decay):
        errors.append(ConfigError("encoding.parameters.decay", config.encoding.decay, "set decay instead"))
    if config.oldest_gray != OLDEST_GRAY and "oldest_gray" not in config.encoding.parameters:
        expected = f"the encoding {config.encoding.name} has no oldest gray"
        errors.append(ConfigError("oldest_gray", config.oldest_gray, expected))
    if config.runtime.part >= config.runtime.parts:
        expected = f"must be below runtime.parts={config.runtime.parts}"
        errors.append(ConfigError("runtime.part", config.runtime.part, expected))
    if config.runtime.parts > 1 and config.task != "record":
        errors.append(ConfigError("runtime.parts", config.runtime.parts, "is for task=record only"))
    for key, task in (("scans", "predict"), ("floor_map", "floor")):
        value = getattr(config, key)
        if (config.task == task) != (value is not None):
            expected = f"is needed with task={task}" if value is None else f"is for task={task} only"
            errors.append(ConfigError(key, value, expected))
    architecture = config.model.kind
    if architecture in RECURRENT and "frames" not in config.encoding.parameters:
        expected = f"model {architecture} takes a series of images: encoding=series10 or encoding=stack10"
        errors.append(ConfigError("encoding", config.encoding.name, expected))
    if config.train.loss == "visible" and not (architecture in EVERY_PART and "series" in config.encoding.name):
        expected = f"visible is for model={', '.join(EVERY_PART)} with encoding=series10 or encoding=series100"
        errors.append(ConfigError("train.loss", config.train.loss, expected))
    return errors


def warnings_of(config: Config) -> list[str]:
    """Return warnings of values that are allowed and may surprise."""
    found = []
    if config.runtime.precision in ("16-mixed", "16-true", "bf16-true"):
        found.append(f"runtime.precision={config.runtime.precision} has few digits: losses may not stay finite")
    if config.model.encoder_name not in (None, PAPER_ENCODER):
        found.append(f"model.encoder_name={config.model.encoder_name} is not the paper's, which is {PAPER_ENCODER}")
    if config.model.encoder_weights is not None:
        found.append(
            f"model.encoder_weights={config.model.encoder_weights} are downloaded from the internet the first time"
        )
    pairs = config.scale.pairs
    spec = world_spec(config.world, config.exp)
    minutes = recording_seconds(spec, pairs.train + pairs.val + pairs.test) / 60
    if config.task in ("all", "record") and minutes > LONG_RECORDING_MINUTES:
        found.append(f"recording exp {config.exp} takes about {minutes:.0f} min per core")
    if not spec.clear_radius_m:
        found.append(f"exp {config.exp} has no clear zone: recording stops where an obstacle reaches the robot")
    if config.task in TRAINING_TASKS and config.train.flip_augmentation:
        if spec.fixed:
            found.append("train.flip_augmentation=true also shows the network the fixed obstacles upside down")
        if spec.motion.name == "waypoints":
            found.append("train.flip_augmentation=true also shows the network the robot's path upside down")
    return found


def _path_errors(outputs_path: str, recordings_path: str) -> list[ConfigError]:
    outputs, recordings = Path(outputs_path).absolute(), Path(recordings_path).absolute()
    errors = _directory_errors("outputs", outputs)
    if not (errors and recordings.is_relative_to(outputs)):
        errors += _directory_errors("recordings", recordings)
    return errors


def _library_errors(config: Config) -> list[ConfigError]:
    """Return what is wrong with the network, the parameters of the encoding, and the sizes that the CPU can train."""
    errors = _model_errors(config.model)
    errors += _parameter_errors(EncodingParameters, "encoding.parameters.", config.encoding.parameters)
    if config.model.kind in RECURRENT:
        errors += _parameter_errors(NetworkParameters, "model.parameters.", config.model.parameters)
    on_cpu = config.task in TRAINING_TASKS and (config.runtime.accelerator == "cpu" or not has_gpu())
    if not errors and on_cpu:
        errors += cpu_errors(config.scale, config.train, config.encoding, config.runtime.precision)
    return errors


def _encoding_errors(encoding: Encoding) -> list[ConfigError]:
    """Return why an encoding cannot be created; imports torch for all but the paper's."""
    if encoding.name == "projection" and set(encoding.parameters) == {"decay", "oldest_gray"}:
        return []
    from repro.maps.encodings import ENCODINGS, create_encoding

    try:
        create_encoding(encoding.name, encoding.parameters)
    except (TypeError, ValueError) as error:
        key = "encoding.parameters" if encoding.name in ENCODINGS else "encoding.name"
        return [ConfigError(key, None, str(error))]
    return []


def _window_errors(config: Config) -> list[ConfigError]:
    """Return an error if the windows of the experiment have fewer steps than the encoding has parts."""
    frames = config.encoding.parameters.get("frames", 1)
    steps = world_spec(config.world, config.exp).steps
    if config.task not in (*TRAINING_TASKS, "evaluate") or frames <= steps:
        return []
    expected = f"divides a window into {frames} parts, those of exp {config.exp} have {steps} steps"
    return [ConfigError("encoding", config.encoding.name, expected)]


def _device_errors(accelerator: str) -> list[ConfigError]:
    if accelerator == "gpu" and not has_gpu():
        return [ConfigError("runtime.accelerator", "gpu", "no CUDA GPU is visible; use auto or cpu")]
    return []


def _directory_errors(key: str, directory: Path) -> list[ConfigError]:
    """Return why a directory can neither exist nor be created; whether it can be written shows when it is."""
    try:
        if os.path.lexists(directory) and not stat.S_ISDIR(os.stat(directory).st_mode):
            return [ConfigError(key, directory, "is a file, a directory is needed")]
        os.stat(directory)
    except FileNotFoundError:
        pass
    except OSError as error:  # a loop of links, a name that is too long, a file on the way
        return [ConfigError(key, directory, str(error.strerror))]
    if directory.is_relative_to("/proc") or directory.is_relative_to("/sys"):
        return [ConfigError(key, directory, "holds no files of users")]
    return []


def _parameter_errors(kind: Any, prefix: str, parameters: dict[str, Any]) -> list[ConfigError]:
    try:
        TypeAdapter(kind).validate_python(parameters)
    except ValidationError as error:
        return config_errors_of(error, prefix)
    return []


def _model_errors(model: Model) -> list[ConfigError]:
    """Return what is wrong with architecture, encoder and weights; imports smp for all but the paper's."""
    if model.kind in NETWORKS and model.encoder_name in MIT_ENCODERS and not model.parameters:
        wrong = model.encoder_weights not in MIT_WEIGHTS
        return (
            [ConfigError("model.encoder_weights", model.encoder_weights, "must be null or imagenet")] if wrong else []
        )
    from repro.networks.create import architecture_errors  # takes some seconds

    return architecture_errors(model)
