"""What a key or name that does not exist may have meant."""

import difflib
from typing import Any

from repro.fields import UNKNOWN_KEY, ConfigError

OPTIONAL = ("noise", "std", "angle_std", "fixed", "rooms", "parameters")  # keys that the files of conf/ may leave out


def unknown_key(key: str, value: Any, values: dict[str, Any]) -> ConfigError:
    """Return the error of a key that does not exist, with the nearest key beside it, or one of the same name.

    Args:
        key: the unknown key, as written on the command line.
        value: its value, if it has one.
        values: the whole configuration as plain values.
    """
    *parents, name = key.split(".")
    if name in OPTIONAL and parents:
        return ConfigError(key, value, f"is not set in the files of conf/: add it with +{key}=")
    siblings: Any = values
    for number, parent in enumerate(parents):
        found = (
            siblings.get(parent)
            if isinstance(siblings, dict)
            else {str(index): each for index, each in enumerate(siblings)}.get(parent)
        )
        if not isinstance(found, dict | list):
            return unknown_key(".".join(parents[: number + 1]), None, values)
        siblings = found
    known = [each for each in siblings if each != name] if isinstance(siblings, dict) else []
    near = [".".join([*parents, each]) for each in difflib.get_close_matches(name, known, 1)]
    near = near or [each for each in _keys(values) if each.split(".")[-1] == name and each != key]
    hint = f"; did you mean {' or '.join(near)}?" if near else f"; known are {', '.join(known)}" if known else ""
    return ConfigError(key, value, f"{UNKNOWN_KEY}{hint}")


def one_of(name: str, options: list[str]) -> str:
    """Say that a name must be one of several, and which one is near."""
    close = difflib.get_close_matches(name, options, 1)
    return f"must be one of {', '.join(options)}" + (f"; did you mean {close[0]}?" if close else "")


def with_suggestion(error: ConfigError, values: dict[str, Any]) -> ConfigError:
    """Add the nearest known key to the error of an unknown one."""
    return unknown_key(error.key, error.value, values) if error.expected == UNKNOWN_KEY else error


def _keys(values: dict[str, Any], prefix: str = "") -> list[str]:
    """Return all keys of a nested mapping, with dots."""
    return [
        name
        for key, value in values.items()
        for name in [f"{prefix}{key}", *(_keys(value, f"{prefix}{key}.") if isinstance(value, dict) else [])]
    ]
