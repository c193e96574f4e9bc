"""One renderer of tables: cells as Markdown or, in the page, as HTML."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd


@dataclass(frozen=True)
class Cells:
    """A table as it is printed: heads, rows of as many texts, and a caption.

    Args:
        heads: the heads of the columns.
        rows: the rows.
        caption: the caption; empty for none.
        note: what follows the caption.
        text_columns: number of leading columns with text, which HTML aligns to the left.
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[object]]
    caption: str = ""
    note: str = ""
    text_columns: int = 1

    def to_markdown(self) -> str:
        """Return the table as Markdown, after its caption in bold, and ending with a line break."""
        lines = [f"**{self.caption}**{self.note}", ""] if self.caption else []
        lines += [_line(self.heads), "|" + "---|" * len(self.heads), *map(_line, self.rows)]
        return "\n".join(lines) + "\n"


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def number(value: Any, digits: int = 3) -> str:
    """Return a number with some decimals; empty for none."""
    return "" if pd.isna(value) else f"{value:z,.{digits}f}"


def with_interval(value: float, low: float, high: float, form: str = ".3f") -> str:
    """Return a value with its interval, `0.500 [0.490, 0.510]`, or alone without one; empty for none."""
    if pd.isna(value):
        return ""
    return f"{value:{form}}" + ("" if pd.isna(low) else f" [{low:{form}}, {high:{form}}]")
