"""The mutation measurement is tested on a toy module whose mutants have known outcomes.

The list of equivalent mutants must match the package.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.mutation.__main__ import EQUIVALENT, PACKAGE, ROOMS, ROOT, equivalent, report
from tests.mutation.mutations import Mutant, mutants

MODULE = '''\
from functools import lru_cache


def clamp(x, low=0.0, high=2.0):
    """Doctext 1."""
    if x < low:
        return low
    return min(x, high)


@lru_cache
def unseen(x):
    return x * 2


class Counter:
    def count(self, n):
        total = 0
        while total < n:
            total += 1
        return total


class Twice(Counter):
    def count(self, n):
        return 2 * super().count(n)
'''
TESTS = """\
import toy


def test_clamp():
    assert [toy.clamp(x) for x in (-1, 1, 3)] == [0.0, 1, 2.0]


def test_count():
    assert toy.Counter().count(3) == 3


def test_twice():
    assert toy.Twice().count(3) == 6
"""
DRIVE = """\
import json, sys
from pathlib import Path

from tests.mutation.running import Room, measure, sample

root = Path(sys.argv[1])
room = Room("toy", (root / "toy.py",), (str(root / "test_toy.py"),), root)
rows = []
sys.path.insert(0, str(root))
measure(room, sample(room, 1000, 0), rows.append)
print(json.dumps([[*o.mutant.key[1:], o.killer, o.covering] for o in rows]))
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> list[list[object]]:
    """Return (function, original, mutated, killer, number of covering tests) of each toy mutant."""
    folder = tmp_path_factory.mktemp("toy")
    (folder / "toy.py").write_text(MODULE, encoding="utf-8")
    (folder / "test_toy.py").write_text(TESTS, encoding="utf-8")
    (folder / "pyproject.toml").write_text("[tool.pytest.ini_options]\n", encoding="utf-8")
    command = [sys.executable, "-c", DRIVE, str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_outcomes_of_the_toy_are_the_known_ones(outcomes: list[list[object]]) -> None:
    alive = {(row[1], row[2]) for row in outcomes if row[3] is None}
    assert alive == {
        ("if x < low:", "if x <= low:"),  # Both sides return low, so it is equivalent.
        ("total = 0", "total = 1"),  # It is equivalent for n = 3.
        ("total = 0", "total = -1"),
        ("return x * 2", "return x / 2"),
        ("return x * 2", "return x * 3"),
        ("return x * 2", "return x * 1"),
        ("return x * 2", "return None"),
    }
    covering = {row[0]: row[4] for row in outcomes}
    assert covering == {"clamp": 1, "unseen": 0, "Counter.count": 2, "Twice.count": 1}
    killers = {row[2]: row[3] for row in outcomes}
    assert str(killers["total -= 1"]).startswith("signal")  # The mutant loops endlessly.
    assert str(killers["return max(x, high)"]).endswith("test_clamp")
    assert any("high=2.5" in str(row[2]) and row[3] for row in outcomes)


@pytest.mark.parametrize(
    ("source", "mutated"),
    [
        ("a < b", {"a <= b", "a >= b"}),
        ("a == b", {"a != b"}),
        ("a + b", {"a - b"}),
        ("not a", {"a"}),
        ("-a", {"a"}),
        ("a and b", {"a or b"}),
        ("x[1]", {"x[2]", "x[0]"}),
        ("2.0", {"2.5"}),
        ("1e-4", {"0.01"}),
        ("True", {"False"}),
        ("a if b else c", {"a", "c"}),
        ("np.minimum(a, b)", {"np.maximum(a, b)"}),
        ("'text'", set()),
    ],
)
def test_operators(tmp_path: Path, source: str, mutated: set[str]) -> None:
    path = tmp_path / "module.py"
    path.write_text(f"def f():\n    y = {source}\n", encoding="utf-8")
    texts = {mutant.mutated.removeprefix("y = ") for mutant in mutants(path, "module.py")}
    assert {ast.unparse(ast.parse(text)) for text in texts} == {
        ast.unparse(ast.parse(text)) for text in mutated
    }


def test_every_equivalent_mutant_is_one_of_the_package() -> None:
    listed = equivalent()
    assert len(listed) == len(json.loads(EQUIVALENT.read_text(encoding="utf-8")))
    assert all(reason.strip() for reason in listed.values())
    keys = {m.key for name in {key[0] for key in listed} for m in mutants(ROOT / name, name)}
    assert set(listed) <= keys


def test_rooms_have_modules_and_tests() -> None:
    for place, tests in ROOMS.values():
        assert (ROOT / PACKAGE / place).exists()
        assert all((ROOT / test).exists() for test in tests)


def test_the_report_counts_what_it_lists() -> None:
    mutant = Mutant("a.py", "f", 3, (3,), "x = 1", "x = 2", (0, 0, 0))
    killers = Counter({"test_a": 8, None: 2, "equivalent": 1})
    rows = [
        {"mutant": mutant.__dict__, "killer": killer, "covering": 1}
        for killer in killers.elements()
    ]
    text = report({"room": (rows, 61.0)}, 11, 5)
    assert "| room | 11 | 1 | 8 | 80% |" in text
    assert text.count("`a.py:3` in `f`") == 2
    assert "-x = 1\n+x = 2" in text
