"""Checks a configuration as a whole, before anything slow is imported and anything is written."""

import sys
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from repro.config import LEARNED, NETWORKS, Config, Model, to_typed
from repro.faults import Fault, faults_of
from repro.simulation.specs import world_faults

MIT_ENCODERS = tuple(f"mit_b{size}" for size in range(6))
MIT_WEIGHTS = (None, "imagenet")  # what smp has for each of them


def all_faults(values: dict[str, Any]) -> list[Fault]:
    """Finds everything that is wrong with a configuration.

    Args:
        values: the whole configuration as plain values.

    Returns:
        the faults. What only a slow import can tell, of values out of the ordinary, is asked when the rest is right.
    """
    faults = config_faults(values) + world_faults(values["world"])
    return faults or _library_faults(to_typed(values))


def config_faults(values: dict[str, Any]) -> list[Fault]:
    """Finds everything that is wrong with a configuration but for `world`, see `simulation.specs.world_faults`.

    Args:
        values: the whole configuration as plain values.

    Returns:
        the faults, each value by itself first, then what only shows together.
    """
    try:
        config = to_typed(values)
    except ValidationError as error:
        faults = faults_of(error)
        keys = {fault.key for fault in faults}  # conf/train takes some of its values from the scale
        return [f for f in faults if not (f.key.startswith("train.") and f.key.replace("train", "scale") in keys)]
    faults = []
    if config.exp not in config.world.get("experiments", {}):
        faults.append(Fault("exp", config.exp, f"there are {', '.join(config.world.get('experiments', {}))}"))
    if config.train.batch_size > config.scale.pairs.train:
        allowed = f"at most the {config.scale.pairs.train} training pairs"
        faults.append(Fault("train.batch_size", config.train.batch_size, allowed))
    if not config.decay and "decay" not in config.encoding.parameters:
        faults.append(Fault("decay", "false", f"the encoding {config.encoding.name} has no decay to be left out"))
    if config.runtime.part >= config.runtime.parts:
        faults.append(Fault("runtime.part", config.runtime.part, f"must be below runtime.parts={config.runtime.parts}"))
    if config.model.name not in LEARNED:
        faults.append(Fault("model.name", config.model.name, f"must be one of {', '.join(LEARNED)}"))
    if config.model.name == "convlstm" and "frames" not in config.encoding.parameters:
        allowed = "model convlstm takes a series of images, encoding=stack10 or encoding=stack4"
        faults.append(Fault("encoding", config.encoding.name, allowed))
    return faults


def remarks(config: Config) -> list[str]:
    """Says what is allowed and may surprise."""
    found = []
    if config.runtime.precision in ("16-mixed", "16-true", "bf16-true"):
        found.append(f"runtime.precision={config.runtime.precision} keeps few digits: losses may not stay finite")
    if config.model.encoder_name not in (None, "mit_b0"):
        found.append(f"model.encoder_name={config.model.encoder_name} is not the paper's, which is mit_b0")
    if config.model.encoder_weights is not None:
        found.append(
            f"model.encoder_weights={config.model.encoder_weights} are fetched from the internet the first time"
        )
    if config.exp in config.world["experiments"] and not config.world["experiments"][config.exp]["clear_radius_m"]:
        found.append(f"exp {config.exp} has no clear zone: recording stops where an obstacle reaches the robot")
    return found


def _library_faults(config: Config) -> list[Fault]:
    faults = _encoder_faults(config.model)
    for key, place in {"outputs": config.outputs, "recordings": config.recordings}.items():
        if Path(place).exists() and not Path(place).is_dir():
            faults.append(Fault(key, place, "is a file, a directory is needed"))
    if config.encoding.name != "projection" or set(config.encoding.parameters) != {"decay", "oldest_gray"}:
        from repro.maps.encodings import ENCODINGS, create_encoding

        try:
            create_encoding(config.encoding.name, config.encoding.parameters)
        except (TypeError, ValueError) as error:
            key = "encoding.parameters" if config.encoding.name in ENCODINGS else "encoding.name"
            faults.append(Fault(key, None, str(error)))
    if config.runtime.accelerator == "gpu" and not _has_gpu():
        faults.append(Fault("runtime.accelerator", "gpu", "no CUDA GPU is visible; use auto or cpu"))
    return faults


def _has_gpu() -> bool:
    if sys.platform == "linux" and not any(Path(path).exists() for path in ("/dev/nvidiactl", "/dev/dxg")):
        return False  # without the driver's device there is none to be asked for
    import torch

    return torch.cuda.is_available()


def _encoder_faults(model: Model) -> list[Fault]:
    name, weights = model.encoder_name, model.encoder_weights
    if model.name not in NETWORKS:
        given = {"encoder_name": name, "encoder_weights": weights}
        allowed = f"model {model.name} has an encoder of its own, leave it null"
        return [Fault(f"model.{key}", value, allowed) for key, value in given.items() if value is not None]
    if name in MIT_ENCODERS:
        wrong = weights not in MIT_WEIGHTS
        return [Fault("model.encoder_weights", weights, "must be null or imagenet")] if wrong else []
    print(f"looking up the encoder {name}", flush=True)  # some seconds, and only for one that is out of the ordinary
    from segmentation_models_pytorch.encoders import encoders

    if name not in encoders and not str(name).startswith("tu-"):
        close = ", ".join(sorted(known for known in encoders if known[:3] == str(name)[:3])[:8]) or "mit_b0"
        return [Fault("model.encoder_name", name, f"smp has no such encoder; it has {close} and others")]
    known = sorted(encoders.get(name, {}).get("pretrained_settings", {}))
    if weights is not None and name in encoders and weights not in known:
        return [Fault("model.encoder_weights", weights, f"must be null or one of {', '.join(known)}")]
    return []
