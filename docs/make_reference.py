"""Write docs/reference.md, every key of every kind of file: `make api`, or `python docs/make_reference.py`."""

from __future__ import annotations

import re
from pathlib import Path

from ssm_planner.loading.load import file_keys
from ssm_planner.loading.schema import Key, describe_keys
from ssm_planner.studies.study_file import StudyModel
from ssm_planner.templates import FILE_KINDS

TARGET = Path(__file__).with_name("reference.md")
JOINTS = r"\b(roll|tilt|spin|insertion)\."
ABOUT = {
    "problem": "Start, motion and limits of the tool: [motions and limits](motions.md), [the eye](eye.md).",
    "robot": "Geometry, bodies, limits of the joints, and what drives them: [kinematics](kinematics.md).",
    "drive": "A worm gear or screw with its friction: [drives](drives.md).",
    "motor": "A datasheet's figures: [sizing](sizing.md).",
    "motorisation": "One joint back and forth at a time, for `ssm-planner size`: [sizing](sizing.md).",
    "controller": "Loops and springs for `ssm-planner simulate`: [simulation](simulation.md).",
    "study": "Candidate robots, for `ssm-planner study`: [studies](studies.md).",
}
HEAD = """\
# Keys of the files

Every key that a file may have; `make api` writes this page from the program. `[]` stands for each entry of a list, JOINT for
roll, tilt, spin and insertion. A figure of a drive or motor is written as `36.7 mN*m`, or with its origin as
`{value: 36.7 mN*m, source: datasheet}`; `placeholder: true` marks one that stands in for an unknown one. Units: any of the
kind will do, the one given is an example. Where a file is named, a shipped name or the file's content will do too.

`ssm-planner new KIND FILE` writes a commented file to start from. `ssm-planner schema KIND` prints the JSON schema, by which
editors complete and check: `ssm-planner schema robot > robot.schema.json`, and as the first line of the robot file
`# yaml-language-server: $schema=robot.schema.json`.
"""


def page() -> str:
    """The whole of docs/reference.md."""
    parts = [HEAD]
    for kind in FILE_KINDS:
        parts.append(f"## {kind.capitalize()} files\n\n{ABOUT[kind]}\n")
        parts.append("| key | unit | allowed | default | meaning |\n|---|---|---|---|---|")
        parts += [_row(path, rows) for path, rows in grouped(kind).items()]
        parts.append("")
    return "\n".join(parts)


def grouped(kind: str) -> dict[str, list[Key]]:
    """Keys by path, those of the joints and of the kinds of drive together."""
    found: dict[str, list[Key]] = {}
    for key in describe_keys(StudyModel) if kind == "study" else file_keys(kind):
        place = (
            re.sub(JOINTS, "JOINT.", key.path)
            if key.path.startswith(("joints", "compliance", "back"))
            else key.path
        )
        found.setdefault(place, []).append(key)
    return found


def _row(path: str, rows: list[Key]) -> str:
    def each(name: str) -> str:
        return " or ".join(dict.fromkeys(text for row in rows if (text := getattr(row, name))))

    cells = f"`{path}`", each("unit"), each("allowed"), each("default"), rows[0].description
    return "| " + " | ".join(cell.replace("|", "\\|").replace("<", "&lt;") for cell in cells) + " |"


if __name__ == "__main__":
    TARGET.write_text(page(), encoding="utf-8")
