"""Reading YAML gives plain data with line numbers. Any other content leads to one error that names
the file and the line.
"""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path

import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.files import read_section
from ssm_planner.loading.yaml_nodes import parse_yaml


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "file.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_values_and_lines(tmp_path: Path) -> None:
    section = read_section(
        write(tmp_path, "# comment\na: 1\nb:\n  - c: 2 mm\n  -\n    d: {e: 1e-5}\n")
    )
    assert section.value == {"a": 1, "b": [{"c": "2 mm"}, {"d": {"e": 1e-5}}]}
    assert section.line("a") == 2
    assert section.line("b", 0, "c") == 4
    assert section.line("b", 1, "d", "e") == 6
    assert section.sub("b", 1).line("d") == 6
    assert section.line("b", 0, "nothing here") == 4


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-5", 1e-5),
        ("6.5e-7", 6.5e-7),
        ("1E3", 1e3),
        ("-3", -3),
        ("+.5", 0.5),
        ("010", 10),
        ("12345678901234567890123", 12345678901234567890123.0),
        ("yes", "yes"),
        ("on", "on"),
        ("no", "no"),
        ("true", True),
        ("false", False),
        ("1:30", "1:30"),
        ("2021-01-01", "2021-01-01"),
        ("0x1F", "0x1F"),
        ("1_000", "1_000"),
        ("'1e-5'", "1e-5"),
        ('"5"', "5"),
        ("!!str 5", "5"),
        ("~", None),
        ("", None),
    ],
)
def test_scalars(tmp_path: Path, text: str, value: object) -> None:
    result = read_section(write(tmp_path, f"key: {text}\n")).value["key"]
    assert result == value
    assert type(result) is type(value)


BOMB = "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{new}: &{new} [{','.join(['*' + old] * 10)}]\n"
    for old, new in zip("abcdefg", "bcdefgh", strict=True)
)


@pytest.mark.parametrize(
    ("text", "line", "part"),
    [
        ("a: 1\nb: 2\na: 3\n", 3, "duplicate key (first on line 1)"),
        ("a:\n  b: 1\n  b: 2\n", 3, "a.b: duplicate key"),
        ("a: [1, 2\nb: 3\n", 2, "not valid YAML"),
        ("a: b: c\n", 1, "not valid YAML"),
        ("a:\n\t- 1\n", 2, "not valid YAML"),
        ("a: 'open\n", 2, "not valid YAML"),
        ("", 1, "empty"),
        ("# only a comment\n", 1, "empty"),
        ("  \n\n", 1, "empty"),
        ("- 1\n- 2\n", 1, "a list"),
        ("just text\n", 1, "only the text"),
        ("a: 1\n---\nb: 2\n", 2, "second document"),
        ("a: !!python/object:os.system x\n", 1, "the tag"),
        ("a: 1\nb: *nothing\n", 2, "has no anchor"),
        ("a: &a [*a]\n", 1, "*a is inside the value that it stands for"),
        ("? [1, 2]\n: 3\n", 1, "plain word"),
        ("a: " + "[" * 100 + "]" * 100, 1, "too deeply"),
        ("a: " + "[" * 50_000, 1, "too deeply"),
        (BOMB, 6, "too many values"),
        (b"a: 1\nb: \xff\xfe\n", 2, "UTF-8"),
        (b"a: 1\n\x00\x01\x02\n", 2, "not a text file"),
        (b"\x89PNG\r\n\x1a\n\x00", 1, "UTF-8"),
    ],
)
def test_unreadable(tmp_path: Path, text: str | bytes, line: int, part: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ProblemError) as caught:
        read_section(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{line}: ")
    assert part in message
    assert len(message.splitlines()) == 1


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match=r"nowhere\.yaml: no such file"):
        read_section(tmp_path / "nowhere.yaml")


def test_directory(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match="a directory"):
        read_section(tmp_path)


def test_huge_file(tmp_path: Path) -> None:
    path = tmp_path / "huge.yaml"
    with path.open("wb") as file:
        file.truncate(10_000_001)
    with pytest.raises(ProblemError, match=r"too large.*at most 10 MB"):
        read_section(path)


def test_impossible_names(tmp_path: Path) -> None:
    for name in ("x" * 5000, "a\0b"):
        with pytest.raises(ProblemError):
            read_section(tmp_path / name)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs on this system")
def test_fifo(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ProblemError, match="not a regular file"):
        read_section(tmp_path / "pipe")


def test_byte_order_mark_and_crlf(tmp_path: Path) -> None:
    section = read_section(write(tmp_path, b"\xef\xbb\xbfa: 1\r\nb: 2 mm\r\n"))
    assert section.value == {"a": 1, "b": "2 mm"}
    assert section.line("b") == 2


def test_aliases_that_stay_small_are_fine(tmp_path: Path) -> None:
    section = read_section(write(tmp_path, "a: &a {x: 1}\nb: *a\n"))
    assert section.value == {"a": {"x": 1}, "b": {"x": 1}}
    assert section.error("wrong", "b", "x").key == "b.x"


def test_without_its_tree_a_long_file_takes_a_third_of_the_memory() -> None:
    point = "- {positions: [0.1, -1.5e-3, .2, 3], time_from_start: {sec: 0, nanosec: 5}}\n"

    def peak(count: int, tree: bool) -> int:
        text = "points:\n" + point * count
        tracemalloc.start()
        try:
            result = parse_yaml(None, text, tree=tree)
            assert result.size == 2 + 9 * count
            assert result.value["points"][-1] == {
                "positions": [0.1, -0.0015, 0.2, 3],
                "time_from_start": {"sec": 0, "nanosec": 5},
            }
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    assert peak(3000, tree=False) < peak(3000, tree=True) / 3
