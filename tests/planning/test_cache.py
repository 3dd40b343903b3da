"""Answers kept while one problem is planned."""

from __future__ import annotations

from ssm_planner.planning.cache import IdentityKey, cache_scope, cached


def test_nothing_is_kept_beyond_a_plan() -> None:
    asked: list[str] = []

    def answer() -> str:
        asked.append("")
        return "found"

    assert cached("key", answer) == cached("key", answer) == "found"
    assert len(asked) == 2
    with cache_scope():
        assert cached("key", answer) == cached("key", answer) == "found"
        assert len(asked) == 3
        with cache_scope():
            cached("key", answer)
        cached("key", answer)
    assert len(asked) == 4
    cached("key", answer)
    assert len(asked) == 5


def test_objects_are_the_same_as_themselves_alone() -> None:
    one, other = [1], [1]
    assert IdentityKey(one) == IdentityKey(one)
    assert IdentityKey(one) != IdentityKey(other)
    assert hash(IdentityKey(one)) == hash(IdentityKey(one))
