"""A call: the configuration that Hydra composes, typed once, with the rules that its parts must satisfy together."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from repro.cli.refusals import Refused, did_you_mean
from repro.cli.settings import Adaptation, Demo, Files, Navigation, Prediction, Publish, Runtime, UserPath
from repro.cli.tasks import Task, tasks
from repro.runs.config import RECURRENT, EncodingChoice, Scale, Training
from repro.runs.model import NETWORKS, PAPER_ENCODER, Model
from repro.runs.parallel import has_gpu, training_memory_gb
from repro.system.errors import InputError
from repro.system.fields import KNOWN_KEYS, OLDEST_GRAY, UNKNOWN_KEY, ConfigError, Gray, WrongValues, config_errors_of
from repro.system.memory import total_memory_gb
from repro.worlds.spec import WorldFile, WorldSpec


def _as_text(value: Any) -> Any:
    return str(value) if type(value) is int else value  # exp=3, which Hydra reads as a number


@lru_cache(8)
def _checked_world(text: str) -> WorldFile | WrongValues:
    """Return the world of a call, given as JSON, or what is wrong with it; the jobs of a sweep share it."""
    from repro.simulation.checks import checked_world  # samples worlds, which needs the study

    try:
        return checked_world(json.loads(text))
    except WrongValues as error:
        return error


@dataclass(frozen=True)
class Call:
    """The configuration of a call; conf/config.yaml explains its values.

    `_errors` has the rules on several of its values.
    """

    __pydantic_config__ = KNOWN_KEYS

    task: str
    world: WorldFile | None  # None for a task that ignores it
    exp: Annotated[str, BeforeValidator(_as_text)]
    decay: bool
    oldest_gray: Gray
    seed: Annotated[int, Field(ge=0, lt=2**32)]
    outputs: UserPath
    recordings: UserPath
    encoding: EncodingChoice
    model: Model
    scale: Scale
    train: Training
    runtime: Runtime
    format: Literal["torch", "onnx"]
    scans: Files | None
    prediction: Prediction
    adaptation: Adaptation
    navigation: Navigation
    demo: Demo
    publish: Publish

    @property
    def facts(self) -> Task:
        """What is known of the task."""
        return tasks()[self.task]

    @property
    def specs(self) -> dict[str, WorldSpec]:
        """What decides the worlds of each experiment; none for a task that ignores them."""
        return self.world.specs if self.world else {}

    @field_validator("task")
    @classmethod
    def _exists(cls, task: str) -> str:
        if task not in tasks():
            raise InputError(f"must be one of {', '.join(tasks())}")
        return task

    @field_validator("world", mode="before")
    @classmethod
    def _can_be_recorded(cls, world: Any, info: ValidationInfo) -> WorldFile | None:
        """Check the worlds, unless the task, which comes first, has none."""
        task = tasks().get(info.data.get("task", ""))
        if task and "world" in task.ignores:
            return None
        checked = _checked_world(json.dumps(world))
        if isinstance(checked, WrongValues):
            raise Refused(*checked.args)
        return checked

    @model_validator(mode="after")
    def _fits_together(self) -> "Call":
        usual = {"decay": self.decay, "oldest_gray": self.oldest_gray}  # of which torch need not be asked
        if self.encoding != EncodingChoice("projection", usual) and (error := _encoding_error(self.encoding)):
            raise Refused(error)
        if errors := list(self._errors()) or _model_errors(self.model):
            raise Refused(*errors)
        return self

    def _errors(self) -> Iterator[str]:
        """Yield what is wrong with values that are right alone."""
        specs, task, model, encoding = self.specs, self.facts, self.model, self.encoding
        if self.world and self.exp not in specs:
            yield f"exp={self.exp}: must be one of {', '.join(specs)}"
        elif task.place == "run" and encoding.frames > (steps := specs[self.exp].steps):
            expected = f"divides a window into {encoding.frames} parts, those of exp {self.exp} have {steps} steps"
            yield f"encoding={encoding.name}: {expected}"
        if not self.decay and "decay" not in encoding.parameters:
            yield f"decay=false: the encoding {encoding.name} has no decay"
        if encoding.parameters.get("decay") is (not self.decay):
            yield f"encoding.parameters.decay={str(not self.decay).lower()}: set decay instead"
        if self.oldest_gray != OLDEST_GRAY and "oldest_gray" not in encoding.parameters:
            yield f"oldest_gray={self.oldest_gray}: the encoding {encoding.name} has no oldest gray"
        if model.kind in RECURRENT and "frames" not in encoding.parameters:
            expected = f"model {model.kind} takes a series of images: encoding=series10, counts10 or stack10"
            yield f"encoding={encoding.name}: {expected}"
        if task.needs and attrgetter(task.needs)(self) is None:
            yield f"{task.needs}: is needed with task={self.task}"
        unknown = [name for name in self.navigation.experiments if name not in specs]
        if self.task == "navigate" and unknown:
            hint = "" if {"static", "slow", "fast"} <= set(specs) else ": set world=navigation"
            yield f"navigation.experiments: {', '.join(unknown)} is none of {', '.join(specs)}{hint}"
        batch, pairs = self.train.batch_size, self.scale.pairs.train
        if task.trains and batch > pairs:
            yield f"train.batch_size={batch}: must be at most the {pairs} training pairs"
        if task.trains and self.train.weights is not None and (error := _weights_error(self.train.weights)):
            yield f"train.weights: {error}"
        if "prediction" in task.own and (error := _weights_error(self.prediction.weights)):
            yield f"prediction.weights: {error}"
        if task.trains and (self.runtime.accelerator == "cpu" or not has_gpu()):
            size_px, total_gb = self.scale.size_px, total_memory_gb()
            needed = training_memory_gb(size_px, batch, pairs + self.scale.pairs.val, encoding.most_channels)
            if needed > total_gb:
                size = f"at {size_px} px and batches of {batch} a training takes about {needed:.0f} GB of memory"
                yield f"scale.pairs.train={pairs}: {size}, this machine has {total_gb:.0f} GB"


def _model_errors(model: Model) -> list[ConfigError]:
    """Return what is wrong with the network; imports smp for all but the paper's."""
    usual = model.kind in NETWORKS and model.encoder_name == PAPER_ENCODER
    if usual and model.encoder_weights in (None, "imagenet") and not model.parameters:
        return []
    from repro.learning.networks.create import architecture_errors  # takes some seconds

    return architecture_errors(model)


def _weights_error(weights: str) -> str | None:
    """Return why there are no such weights, None if there are."""
    from repro.networks.weights import locate, onnx_file

    try:
        path = locate(weights)
    except InputError as error:
        return str(error)
    described = [path / "predictor.json", path / "model" / "predictor.json"]
    if path.is_dir() and not onnx_file(path) and not any(file.is_file() for file in described):
        return f"{path}: expected a trained run or an exported network, got a directory without predictor.json"
    return None


def _encoding_error(encoding: EncodingChoice) -> str | None:
    """Return why an encoding cannot be created, None if it can."""
    from repro.maps.encodings import ENCODINGS, create_encoding, kind_of

    if missing := [key for key, value in encoding.parameters.items() if value is None]:
        return f"encoding.parameters.{missing[0]}=null: expected a value"
    try:
        create_encoding(encoding.name, encoding.parameters)
    except (TypeError, ValueError) as error:
        key = "encoding.parameters" if kind_of(encoding.name) in ENCODINGS else "encoding.name"
        return f"{key}: {error}"
    return None


CALL: TypeAdapter[Call] = TypeAdapter(Call)


def read_call(values: dict[str, Any]) -> Call:
    """Return a call from the composed configuration as plain values.

    Raises:
        Refused: something is wrong with it, with all reasons.
    """
    try:  # as JSON, for strict types; other values of YAML become text
        return CALL.validate_json(json.dumps(values, default=str, skipkeys=True), strict=True)
    except ValidationError as error:
        raise Refused(*dict.fromkeys(_reasons(error, values))) from error


def _reasons(error: ValidationError, values: dict[str, Any]) -> Iterator[str]:
    found = config_errors_of(error)
    keys = {wrong.key for wrong in found}
    for wrong, detail in zip(found, error.errors(), strict=True):
        refused = detail.get("ctx", {}).get("error")
        if isinstance(refused, Refused):
            for reason in refused.args:
                is_unknown = isinstance(reason, ConfigError) and reason.expected == UNKNOWN_KEY
                yield f"{reason}{did_you_mean(reason.key, values) if is_unknown else ''}"
        elif not (wrong.key.startswith("train.") and wrong.key.replace("train", "scale") in keys):
            is_number = detail["type"] == "string_type" and wrong.value is not None
            quoted = f"; for a name, quote it: '{wrong.key}=\"...\"'" if is_number else ""
            yield f"{wrong}{did_you_mean(wrong.key, values) if wrong.expected == UNKNOWN_KEY else quoted}"
