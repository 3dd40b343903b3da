"""Data that the tests of the document share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from paper_reproduction.document import Document
from paper_reproduction.published import Inputs


@dataclass(frozen=True)
class Made:
    """The computed document and its written files."""

    inputs: Inputs
    document: Document
    folder: Path
    files: dict[str, Path]

    @property
    def text(self) -> str:
        return self.files["README.md"].read_text(encoding="utf-8")
