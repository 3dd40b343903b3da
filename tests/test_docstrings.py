"""Every public class and function has an example, and each example prints what it shows."""

from __future__ import annotations

import doctest
import inspect

import pytest

import ssm_planner
from tests.support.paths import ROOT

OBJECTS = {
    name: value
    for name in ssm_planner.__all__
    if inspect.isroutine(value := getattr(ssm_planner, name))
    or (inspect.isclass(value) and str(value.__module__).startswith("ssm_planner"))
}
PARSER = doctest.DocTestParser()


def examples_of(name: str) -> doctest.DocTest:
    """Return the examples in the docstrings of a public object and of its members.

    No name is defined before the examples run.
    """
    value = OBJECTS[name]
    members = vars(value).values() if inspect.isclass(value) else ()
    texts = [str(part.__doc__) for part in (value, *members) if ">>>" in str(part.__doc__)]
    return PARSER.get_doctest("\n\n".join(map(inspect.cleandoc, texts)), {}, name, None, 0)


@pytest.mark.parametrize("name", OBJECTS)
def test_examples_print_what_they_show(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    test = examples_of(name)
    assert test.examples, "no example"
    report: list[str] = []
    outcome = doctest.DocTestRunner(verbose=False).run(test, out=report.append)
    assert not outcome.failed, "".join(report)


def test_a_wrong_example_is_noticed() -> None:
    test = PARSER.get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, 0)
    assert doctest.DocTestRunner(verbose=False).run(test, out=lambda _: None).failed == 1
