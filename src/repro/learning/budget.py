"""Time limit of a process, shared by its trainings."""

import time
from dataclasses import dataclass, field


@dataclass
class Budget:
    """A time limit shared by the trainings of one process, which trains at least one epoch in any case.

    Args:
        minutes: the limit, counted from the creation of the budget [min]; None is no limit.
        since: time of creation by `time.monotonic` [s].
        epochs: number of epochs trained so far.
    """

    minutes: float | None
    since: float = field(default_factory=time.monotonic)
    epochs: int = 0

    def is_spent(self) -> bool:
        """Return whether the limit is reached."""
        return self.minutes is not None and self.epochs > 0 and time.monotonic() - self.since > 60 * self.minutes
