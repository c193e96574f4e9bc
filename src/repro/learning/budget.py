"""The time limit of a process, shared by its trainings."""

import time
from dataclasses import dataclass, field


@dataclass
class Budget:
    """A time limit shared by the trainings of one process, which always trains at least one epoch.

    Args:
        minutes: the limit, from the creation of the budget; None is no limit.
        since: when the budget was created, by `time.monotonic` [s].
        epochs: epochs trained so far.
    """

    minutes: float | None
    since: float = field(default_factory=time.monotonic)
    epochs: int = 0

    def is_spent(self) -> bool:
        """Return whether the limit is reached."""
        return self.minutes is not None and self.epochs > 0 and time.monotonic() - self.since > 60 * self.minutes
