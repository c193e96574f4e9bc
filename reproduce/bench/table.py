"""Print Markdown tables row by row."""


def head(title: str, *names: str) -> None:
    """Print the title and header of a table."""
    print(f"\n### {title}\n", flush=True)
    row(*names)
    print("|" + "---|" * len(names), flush=True)


def row(*cells: str) -> None:
    """Print a row."""
    print("| " + " | ".join(cells) + " |", flush=True)
