"""What other installed packages add to this one, by entry points of their pyproject.toml."""

from importlib.metadata import entry_points
from typing import Any

from repro.system.errors import InputError


def plugin_names(group: str) -> tuple[str, ...]:
    """Return the names in a group of entry points, such as `repro.architectures`, without importing what they name."""
    return tuple(sorted({point.name for point in entry_points(group=group)}))


def plugins(group: str) -> dict[str, Any]:
    """Return what is registered in a group of entry points, by name.

    Raises:
        InputError: something cannot be imported; the message names it and its package.
    """
    found = {}
    for point in entry_points(group=group):
        try:
            found[point.name] = point.load()
        except Exception as error:  # whatever the module of another package raises
            owner = point.dist.name if point.dist else "another package"
            raise InputError(f"{group}: {point.name} of {owner} cannot be imported ({error})") from error
    return found
