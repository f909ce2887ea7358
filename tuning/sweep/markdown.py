"""Tables in Markdown."""

from collections.abc import Sequence


def markdown_table(
    head: Sequence[str], rows: Sequence[Sequence[str]], left: int
) -> list[str]:
    """A Markdown table, its first columns to the left."""
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    lines = ["| " + " | ".join(row) + " |" for row in (head, rule, *rows)]
    return [*lines, ""]
