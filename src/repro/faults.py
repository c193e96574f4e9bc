"""What is wrong with a configuration, as a list that names every key."""

from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a configuration: its key, what came, and what is allowed."""

    key: str
    value: Any
    allowed: str

    def __str__(self) -> str:
        return f"{self.key}: {self.allowed}" if self.value is None else f"{self.key}={self.value}: {self.allowed}"


def faults_of(error: ValidationError, prefix: str = "") -> list[Fault]:
    """Turns what pydantic found into faults, keys written as on the command line."""
    faults = []
    for found in error.errors():
        key = prefix + ".".join(str(part) for part in found["loc"])
        known = {
            "extra_forbidden": "is not known here",
            "missing": "is missing",
        }
        message = known.get(found["type"], found["msg"].removeprefix("Value error, ").replace("Input should", "must"))
        value = None if found["type"] == "missing" else found["input"]
        faults.append(Fault(key, value, message))
    return faults
