"""Markdown tables."""

from collections.abc import Iterable


def markdown_table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> list[str]:
    """Return the lines of a Markdown table, one line per row, each with as many cells as there are heads."""
    heads = list(heads)
    return [_line(heads), "|" + "---|" * len(heads), *map(_line, rows)]


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"
