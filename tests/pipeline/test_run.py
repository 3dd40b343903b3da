"""Verify that `plan` accepts a problem or its name, and callbacks.

The certificate of the result returns single limits.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from ssm_planner import Problem, Straight, load_problem, plan


@pytest.mark.parametrize(("old", "new"), [("found", "on_solution"), ("cured", "on_relaxation")])
def test_old_names_of_callbacks_work_with_a_warning(
    tilt_insert: Problem, old: str, new: str
) -> None:
    weak = replace(tilt_insert, motion=(Straight(tilt=-2.0, duration=1e-3),))
    called: list[object] = []
    expected: list[object] = []
    with pytest.warns(DeprecationWarning, match=f"{old}= is now {new}="):
        plan(tilt_insert if old == "found" else weak, **{old: called.append})
    plan(tilt_insert if old == "found" else weak, **{new: expected.append})
    assert len(called) == len(expected) > 0


def test_a_name_plans_like_the_problem() -> None:
    named, planned = plan("tilt_insert"), plan(load_problem("tilt_insert"))
    assert named.to_json() == planned.to_json()
    certificate = planned.certificate
    assert certificate is not None
    limit = certificate["velocity", "tilt"]
    assert (limit.name, limit.joint) == ("velocity", "tilt")
    assert limit in certificate.limits
    with pytest.raises(KeyError):
        certificate["velocity", "elbow"]
    with pytest.raises(TypeError, match=r"plan\.passed"):
        bool(planned)
