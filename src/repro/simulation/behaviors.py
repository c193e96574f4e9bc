"""The motions as IR-SIM behaviors, so that plain IR-SIM can replay a world YAML that names them.

Importing this module registers them; each worker process must import it.
"""

import contextlib
import io
from typing import Any

import numpy as np

from repro.worlds.obstacle_motions import OBSTACLE_MOTIONS, obstacle_motion
from repro.worlds.robot_motions import DRIVES, drive_of

with contextlib.redirect_stdout(io.StringIO()):  # without a display, IR-SIM prints the backends that it tried
    from irsim.lib import register_behavior_class
    from irsim.util.util import vel_world2omni


class CommandBehavior:
    """IR-SIM behavior of a robot that executes the commands of a motion, see `robot_motions`, and then stands still.

    Such as `{name: rotate, steps: 100, direction: 1}`.
    """

    def __init__(self, object_info: Any, **behavior: Any) -> None:
        self.behavior = behavior
        self.commands: np.ndarray | None = None
        self.step = 0

    def __call__(self, ego_object: Any, **_: Any) -> np.ndarray:
        if self.commands is None:
            self.commands = drive_of(self.behavior).commands(ego_object._world_param.step_time)
        if self.step == len(self.commands):
            return np.zeros((2, 1))
        self.step += 1
        return self.commands[self.step - 1][:, None]


class ObstacleBehavior:
    """IR-SIM behavior of an obstacle: `{name: drift, seed: 7, speed_m_s: 0.5, ...}`, see `obstacle_motions`."""

    def __init__(self, object_info: Any, **behavior: Any) -> None:
        self.motion = obstacle_motion(behavior)

    def __call__(self, ego_object: Any, **_: Any) -> np.ndarray:
        x, y, heading = ego_object.state[:3, 0]
        velocity = self.motion.velocity(x, y, ego_object._world_param.step_time)
        return vel_world2omni(heading, np.array(velocity)[:, None])


for _name in DRIVES:
    register_behavior_class("diff", _name)(CommandBehavior)
for _name in OBSTACLE_MOTIONS:
    register_behavior_class("omni", _name)(ObstacleBehavior)
