"""A call: the configuration that Hydra composes, typed once, with the rules that its parts must satisfy together."""

import difflib
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from repro.cli.errors import Refused
from repro.cli.settings import Adaptation, Demo, Directory, Navigation, Prediction, Publish, Runtime, Source
from repro.cli.tasks import Task, tasks
from repro.config import RECURRENT, Encoding, EncodingParameters, NetworkParameters, Scale, Training
from repro.fields import KNOWN_KEYS, OLDEST_GRAY, UNKNOWN_KEY, ConfigError, Gray, choice, config_errors_of
from repro.networks.model import NETWORKS, PAPER_ENCODER, Model
from repro.parallel import has_gpu, training_memory_gb
from repro.simulation.schema import world_errors
from repro.system.errors import InputError
from repro.system.memory import total_memory_gb
from repro.world_config import world_spec

OPTIONAL = ("noise", "std", "angle_std", "fixed", "rooms", "parameters")  # keys that the files of conf/ may leave out


def _as_text(value: Any) -> Any:
    return str(value) if type(value) is int else value  # exp=3, which Hydra reads as a number


def _can_be_recorded(world: dict[str, Any]) -> dict[str, Any]:
    if errors := _errors_of_world(json.dumps(world)):
        raise Refused(*errors)
    return world


@lru_cache(8)
def _errors_of_world(text: str) -> list[ConfigError]:
    """Return the errors of a world, as JSON; the jobs of a sweep share it."""
    return world_errors(json.loads(text))


def _parameters_have_their_types(kind: Any, key: str, parameters: dict[str, Any]) -> None:
    try:
        TypeAdapter(kind).validate_python(parameters)
    except ValidationError as error:
        raise Refused(*config_errors_of(error, f"{key}.parameters.")) from error


@dataclass(frozen=True)
class Call:
    """The whole configuration of a call. A rule on several values stands with the last of them.

    Args:
        task: name of the task.
        world: the content of a file of conf/world.
        exp: name of an experiment of the world.
        decay: whether the gray of a hit depends on its age.
        oldest_gray: gray of the oldest hit.
        seed: seed of the training, or of the world that is shown.
        outputs: directory of the results.
        recordings: directory of the recordings.
        encoding: the input of the network.
        model: the network.
        scale: resolution, pairs and schedule.
        train: settings of the training.
        runtime: how it is computed.
        format: of an exported network.
        scans: a log of a robot.
        floor_map: the YAML of a map of map_server.
        prediction: settings of task=predict, of which task=adapt takes those that read a log.
        adaptation: settings of task=adapt.
        navigation: settings of task=navigate.
        demo: settings of task=demo.
        publish: settings of task=publish and task=export.
    """

    __pydantic_config__ = KNOWN_KEYS

    task: str
    world: Annotated[dict[str, Any], AfterValidator(_can_be_recorded)]
    exp: Annotated[str, BeforeValidator(_as_text)]
    decay: bool
    oldest_gray: Gray
    seed: Annotated[int, Field(ge=0, lt=2**32)]
    outputs: Directory
    recordings: Directory
    encoding: Encoding
    model: Model
    scale: Scale
    train: Training
    runtime: Runtime
    format: Annotated[str, choice("torch", "onnx")]
    scans: Source | None
    floor_map: Source | None
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
    def experiment(self) -> dict[str, Any]:
        """The experiment in `world`."""
        return self.world["experiments"][self.exp]

    @field_validator("task")
    @classmethod
    def _exists(cls, task: str) -> str:
        if task not in tasks():
            raise InputError(f"must be one of {', '.join(tasks())}{did_you_mean(task, tasks())}")
        return task

    @field_validator("exp")
    @classmethod
    def _is_in_the_world(cls, exp: str, info: ValidationInfo) -> str:
        experiments = info.data["world"]["experiments"] if "world" in info.data else {exp}
        if exp not in experiments:
            raise InputError(f"must be one of {', '.join(experiments)}")
        return exp

    @field_validator("encoding")
    @classmethod
    def _has_what_is_set(cls, encoding: Encoding, info: ValidationInfo) -> Encoding:
        decay, gray, parameters = info.data.get("decay", True), info.data.get("oldest_gray"), encoding.parameters
        if not decay and "decay" not in parameters:
            raise Refused(f"decay=false: the encoding {encoding.name} has no decay")
        if parameters.get("decay") is (not decay):
            raise Refused(f"encoding.parameters.decay={str(not decay).lower()}: set decay instead")
        if gray not in (None, OLDEST_GRAY) and "oldest_gray" not in parameters:
            raise Refused(f"oldest_gray={gray}: the encoding {encoding.name} has no oldest gray")
        _parameters_have_their_types(EncodingParameters, "encoding", parameters)
        return encoding

    @field_validator("model")
    @classmethod
    def _takes_the_encoding(cls, model: Model, info: ValidationInfo) -> Model:
        encoding = info.data.get("encoding")
        if model.kind in RECURRENT and encoding and "frames" not in encoding.parameters:
            expected = f"model {model.kind} takes a series of images: encoding=series10 or encoding=stack10"
            raise Refused(f"encoding={encoding.name}: {expected}")
        if model.kind in RECURRENT:
            _parameters_have_their_types(NetworkParameters, "model", model.parameters)
        return model

    @field_validator("train")
    @classmethod
    def _suits_the_pairs(cls, train: Training, info: ValidationInfo) -> Training:
        scale, task = info.data.get("scale"), tasks().get(info.data.get("task", ""))
        if task and task.needs_batches and scale and train.batch_size > scale.pairs.train:
            expected = f"must be at most the {scale.pairs.train} training pairs"
            raise Refused(f"train.batch_size={train.batch_size}: {expected}")
        return train

    @field_validator("navigation")
    @classmethod
    def _drives_in_the_world(cls, navigation: Navigation, info: ValidationInfo) -> Navigation:
        known = info.data.get("world", {}).get("experiments", navigation.experiments)
        unknown = [name for name in navigation.experiments if name not in known]
        if info.data.get("task") == "navigate" and unknown:
            listing = f"{', '.join(unknown)} is none of {', '.join(known)}: set world=navigation"
            raise Refused(f"navigation.experiments: {listing}")
        return navigation

    @field_validator("scans", "floor_map")
    @classmethod
    def _is_needed(cls, value: str | None, info: ValidationInfo) -> str | None:
        task = info.data.get("task", "")
        if value is None and task in tasks() and tasks()[task].needs == info.field_name:
            raise Refused(f"{info.field_name}: is needed with task={task}")
        return value

    @model_validator(mode="after")
    def _can_be_computed(self) -> "Call":
        """Check what needs a slow import for unusual values, when everything else is right."""
        if errors := [*_model_errors(self.model), *_encoding_errors(self.encoding)]:
            raise Refused(*errors)
        if self.facts.has_windows:
            frames, steps = self.encoding.parameters.get("frames", 1), world_spec(self.world, self.exp).steps
            if frames > steps:
                expected = f"divides a window into {frames} parts, those of exp {self.exp} have {steps} steps"
                raise Refused(f"encoding={self.encoding.name}: {expected}")
        if self.facts.trains and (self.runtime.accelerator == "cpu" or not has_gpu()):
            self._check_cpu()
        return self

    def _check_cpu(self) -> None:
        """Check that a training on the CPU can compute in the precision and fits into the memory.

        Raises:
            Refused: it does not.
        """
        precision, scale, batch = self.runtime.precision, self.scale, self.train.batch_size
        if precision.startswith("16"):
            raise Refused(f"runtime.precision={precision}: float16 needs a GPU, use auto, 32-true or bf16-mixed")
        pairs = scale.pairs.train + scale.pairs.val
        needed = training_memory_gb(scale.size_px, batch, pairs, self.encoding.most_channels)
        there = total_memory_gb()
        if needed > there:
            size = f"at {scale.size_px} px and batches of {batch} a training takes about {needed:.0f} GB of memory"
            raise Refused(f"scale.pairs.train={scale.pairs.train}: {size}, this machine has {there:.0f} GB")


def _model_errors(model: Model) -> list[ConfigError]:
    """Return what is wrong with the network; imports smp for all but the paper's."""
    usual = model.kind in NETWORKS and model.encoder_name == PAPER_ENCODER
    if usual and model.encoder_weights in (None, "imagenet") and not model.parameters:
        return []
    from repro.networks.create import architecture_errors  # takes some seconds

    return architecture_errors(model)


def _encoding_errors(encoding: Encoding) -> list[str]:
    """Return why an encoding cannot be created; imports torch for all but the paper's."""
    if encoding.name == "projection" and set(encoding.parameters) == {"decay", "oldest_gray"}:
        return []
    from repro.maps.encodings import ENCODINGS, create_encoding, kind_of

    try:
        create_encoding(encoding.name, encoding.parameters)
    except (TypeError, ValueError) as error:
        key = "encoding.parameters" if kind_of(encoding.name) in ENCODINGS else "encoding.name"
        return [f"{key}: {error}"]
    return []


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
    keys = {each.key for each in found}
    for each, detail in zip(found, error.errors(), strict=True):
        refused = detail.get("ctx", {}).get("error")
        if isinstance(refused, Refused):
            for reason in refused.args:
                is_unknown = isinstance(reason, ConfigError) and reason.expected == UNKNOWN_KEY
                yield f"{reason}{suggestion(reason.key, values) if is_unknown else ''}"
        elif not (each.key.startswith("train.") and each.key.replace("train", "scale") in keys):
            is_number = detail["type"] == "string_type" and each.value is not None
            quoted = f"; for a name, quote it: '{each.key}=\"...\"'" if is_number else ""
            yield f"{each}{suggestion(each.key, values) if each.expected == UNKNOWN_KEY else quoted}"


def suggestion(key: str, values: dict[str, Any]) -> str:
    """Return the known keys that an unknown one may have meant, for the end of a message; or how to add a known one."""
    *above, name = key.split(".")
    if name in OPTIONAL and above:
        return f"; a key that the files of conf/ leave out is added with +{key}="
    siblings: Any = values
    for part in above:
        entries = {str(number): entry for number, entry in enumerate(siblings)} if isinstance(siblings, list) else {}
        siblings = (siblings if isinstance(siblings, dict) else entries).get(part)
    known = [str(each) for each in siblings if each != name] if isinstance(siblings, dict) else []
    near = [".".join([*above, each]) for each in difflib.get_close_matches(name, known, 1)]
    near = near or [each for each in _keys(values) if each.split(".")[-1] == name and each != key][:2]
    return f"; did you mean {' or '.join(near)}?" if near else f"; known are {', '.join(known)}" if known else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the nearest of several names, for the end of a message; empty if none is near."""
    near = difflib.get_close_matches(name, known, 1)
    return f"; did you mean {near[0]}?" if near else ""


def _keys(values: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """Yield all keys of a nested mapping, with dots."""
    for key, value in values.items():
        yield f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _keys(value, f"{prefix}{key}.")
