"""Tables as they grow, row by row, in Markdown."""


def head(title: str, *names: str) -> None:
    """Begins a table."""
    print(f"\n### {title}\n", flush=True)
    row(*names)
    print("|" + "---|" * len(names), flush=True)


def row(*cells: str) -> None:
    """Adds a row."""
    print("| " + " | ".join(cells) + " |", flush=True)
