"""What other installed packages add to this one, by entry points of their pyproject.toml."""

from collections.abc import Collection
from importlib.metadata import entry_points
from typing import Any

from repro.system.errors import InputError


def plugin_names(group: str) -> tuple[str, ...]:
    """Return the names in a group of entry points, such as `repro.architectures`, without importing what they name."""
    return tuple(sorted({point.name for point in entry_points(group=group)}))


def plugins(group: str, taken: Collection[str]) -> dict[str, Any]:
    """Return what is registered in a group of entry points, by name.

    Args:
        group: name of the group.
        taken: names that this package has.

    Raises:
        InputError: something cannot be imported or has a name that is taken; the message names it and its package.
    """
    found: dict[str, Any] = {}
    for point in entry_points(group=group):
        owner = point.dist.name if point.dist else "another package"
        if point.name in {*taken, *found}:
            raise InputError(f"{group}: the name {point.name} of {owner} is taken, choose another")
        try:
            found[point.name] = point.load()
        except Exception as error:  # whatever the module of another package raises
            raise InputError(f"{group}: {point.name} of {owner} cannot be imported ({error})") from error
    return found
