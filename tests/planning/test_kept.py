"""Answers kept while one problem is planned."""

from __future__ import annotations

from ssm_planner.planning.kept import MOST, SameObject, keeping, kept


def test_nothing_is_kept_beyond_a_plan() -> None:
    asked: list[str] = []

    def answer() -> str:
        asked.append("")
        return "found"

    assert kept("key", answer) == kept("key", answer) == "found"
    assert len(asked) == 2
    with keeping():
        assert kept("key", answer) == kept("key", answer) == "found"
        assert len(asked) == 3
        with keeping():
            kept("key", answer)
        kept("key", answer)
    assert len(asked) == 4
    kept("key", answer)
    assert len(asked) == 5


def test_the_oldest_answers_go_first() -> None:
    asked: list[int] = []
    with keeping():
        for k in range(MOST + 1):
            kept(k, lambda k=k: asked.append(k))  # type: ignore[misc]
        kept(MOST, lambda: asked.append(MOST))
        kept(0, lambda: asked.append(0))
    assert asked == [*range(MOST + 1), 0]


def test_objects_are_the_same_as_themselves_alone() -> None:
    one, other = [1], [1]
    assert SameObject(one) == SameObject(one)
    assert SameObject(one) != SameObject(other)
    assert hash(SameObject(one)) == hash(SameObject(one))
