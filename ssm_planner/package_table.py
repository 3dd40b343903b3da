"""Read tables that are part of the package."""

import csv
from pathlib import Path


def package_table(path: Path) -> list[list[str]]:
    """Return the rows of a CSV file of the package without its headings."""
    with path.open(encoding="utf-8") as table:
        return list(csv.reader(table))[1:]
