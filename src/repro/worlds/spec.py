"""What decides the worlds of an experiment: the typed content of the files of conf/world; docs/worlds.md lists it.

Unknown keys are refused, because IR-SIM would apply them and the recorder would ignore them.
"""

import copy
import json
import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from omegaconf import DictConfig, OmegaConf
from pydantic import Field, PrivateAttr, ValidationError, model_validator

from repro.system.errors import InputError
from repro.system.fields import Name, NotNegative, WrongValues, config_errors_of
from repro.worlds.limits import Duration, Length, Limit, Probability, Range, Section, Speed, Steps
from repro.worlds.obstacle_motions import Behavior
from repro.worlds.obstacles import Disc, FixedList, Populations, Rooms, Shaped, Sized
from repro.worlds.robot_motions import Motion, RandomGoals, Waypoints


class Map(Section):
    """The map; obstacles may pass through one another, as they do in the recorder."""

    width: Length
    height: Length
    step_time: Duration
    collision_mode: Literal["unobstructed"]


class Lidar(Section):
    """IR-SIM's lidar at the center of the robot, with normal noise of the ranges [m]."""

    type: Literal["lidar2d"]
    range_min: Literal[0] = 0
    range_max: Length
    angle_range: Annotated[float, Field(ge=0.001, le=2 * math.pi, allow_inf_nan=False)]
    number: Annotated[int, Field(ge=2, le=100_000)]
    noise: bool = False
    std: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> "Lidar":
        if self.angle_range / (self.number - 1) >= math.pi:
            raise InputError("the beams must be less than half a turn apart: use more")
        if self.noise != (self.std is not None):
            raise InputError("noise: true and std, the standard deviation of the ranges [m], need one another")
        return self


class Kinematics(Section):
    name: Literal["diff"]


class Robot(Section):
    """A disc-shaped differential-drive robot with one lidar; its start pose follows from the motion."""

    kinematics: Kinematics
    shape: Disc
    vel_min: tuple[Limit, Limit]
    vel_max: tuple[Speed, Speed]
    sensors: Annotated[list[Lidar], Field(min_length=1, max_length=1)]


class Sensing(Section):
    """What a real lidar and odometry do to the scans of a recording, see `simulation.sensing`; drawn per recording."""

    range_m: Range[Length]
    noise_m: Range[NotNegative]
    lost_share: Range[Probability]
    every_beam: Range[Annotated[int, Field(ge=1, le=100)]]
    every_step: Range[Steps]
    odometry: Range[Probability]
    pose_m: Range[NotNegative]


class Experiment(Section):
    """A motion of the robot and the obstacles around it."""

    motion: Motion
    obstacles: Populations
    clear_radius_m: Annotated[float, Field(ge=0, le=10_000, allow_inf_nan=False)]
    fixed: FixedList = Field(default_factory=list)
    rooms: Rooms | None = None
    sensing: Sensing | None = None

    @model_validator(mode="after")
    def _has_obstacles(self) -> "Experiment":
        if not self.fixed and not self.rooms and self.obstacles == []:
            raise InputError("has no obstacles: name a population in obstacles, fixed obstacles, or rooms")
        return self

    @property
    def populations(self) -> list[Sized | Shaped]:
        """The populations of obstacles, of which a file may name one or a list."""
        return self.obstacles if isinstance(self.obstacles, list) else [self.obstacles]

    @property
    def is_drive(self) -> bool:
        """Whether the robot drives through the map, and the clear zone with it, rather than in a zone at the center."""
        return isinstance(self.motion, Waypoints | RandomGoals)

    @property
    def behaviors(self) -> list[Behavior]:
        """The motions of the populations that move."""
        return [population.behavior for population in self.populations if population.behavior]


class WorldFile(Section):
    """The complete content of a file of conf/world."""

    world: Map
    robot: Robot
    motions: dict[Name, Motion]
    obstacles: dict[Name, Populations]
    fixed: dict[Name, FixedList] = Field(default_factory=dict)
    rooms: dict[Name, Rooms] = Field(default_factory=dict)
    experiments: dict[Name, Experiment]
    _written: dict[str, Any] = PrivateAttr()  # with its numbers as they were written, see `WorldSpec.raw`

    @classmethod
    def parse(cls, values: Mapping[str, Any]) -> "WorldFile":
        """Return the typed content of a file, given as plain values.

        Raises:
            WrongValues: a key is unknown or missing, or a value is of another type or out of range. Errors of
                experiments are named once all is right to which they may refer.
        """
        text = json.dumps(values, default=str)  # other values of YAML become text
        written = json.loads(text)
        try:
            world = cls.model_validate_json(text)  # JSON, for strict types and tuples
        except ValidationError as error:
            errors = config_errors_of(error, "world.", written)
            others = [wrong for wrong in errors if not wrong.key.startswith("world.experiments.")]
            raise WrongValues(*(others or errors)) from error
        world._written = written
        return world

    @cached_property
    def specs(self) -> dict[str, "WorldSpec"]:
        """What decides the worlds of each experiment, by its name."""
        return {name: world_spec(self._written, name) for name in self.experiments}


class WorldSpec(Experiment):
    """What decides the worlds of an experiment, as `simulation.sampling.sample_world` takes it.

    Args:
        experiment: its name.
        world: the map.
        robot: the robot.
        raw: the content that was parsed, with its numbers as they were written, which `format.spec_fingerprint` hashes.
    """

    experiment: str
    world: Map
    robot: Robot
    raw: dict[str, Any]

    @classmethod
    def parse(cls, raw: Mapping[str, Any]) -> "WorldSpec":
        """Check `experiment`, `world`, `robot` and the keys of the experiment.

        Raises:
            InputError: a key is unknown or missing, or a value is of another type or out of range.
        """
        try:
            return cls.model_validate_json(json.dumps({**raw, "raw": raw}))  # JSON, for strict types and tuples
        except ValidationError as error:
            raise InputError("; ".join(str(wrong) for wrong in config_errors_of(error))) from error

    @property
    def lidar(self) -> Lidar:
        return self.robot.sensors[0]

    @property
    def steps(self) -> int:
        """Time steps of a recording, T."""
        return self.motion.steps

    def with_lidar(self, **values: Any) -> "WorldSpec":
        """Return the spec with other values of the lidar, by their names in conf/world.

        Raises:
            InputError: see `parse`.
        """
        raw = copy.deepcopy(self.raw)
        raw["robot"]["sensors"][0].update(values)
        return WorldSpec.parse(raw)


def plain(config: DictConfig) -> dict[str, Any]:
    """Return a part of the configuration as plain values, its interpolations resolved."""
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]


def read_world(path: Path) -> dict[str, Any]:
    """Load a file of conf/world with those in its defaults, interpolations resolved as in the whole configuration."""
    return plain(OmegaConf.create({"world": _merged(path)}))["world"]


def _merged(path: Path) -> DictConfig:
    """Return a file merged with the files beside it that its defaults name, in their order, as Hydra merges them."""
    content = OmegaConf.load(path)
    assert isinstance(content, DictConfig), f"{path} is not a mapping"
    names = content.pop("defaults", ["_self_"])
    parts = [content if name == "_self_" else _merged(path.with_name(f"{name}.yaml")) for name in names]
    return OmegaConf.merge(*parts)  # type: ignore[return-value]


def world_spec(world: Mapping[str, Any], experiment: str) -> WorldSpec:
    """Return what decides the worlds of an experiment of a file of conf/world.

    Raises:
        InputError: see `WorldSpec.parse`.
    """
    parts = {"experiment": experiment, "world": world["world"], "robot": world["robot"]}
    return WorldSpec.parse({**parts, **world["experiments"][experiment]})
