"""The margins and answers of a selection and the bands of a requirement equal hand calculations."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ssm_planner.sizing.checks import relative_margin
from ssm_planner.sizing.demand import Band
from ssm_planner.sizing.selection import MARGIN_TOLERANCE, _answers_from_margins
from ssm_planner.sizing.size import JointSizing


def test_a_margin_is_the_share_of_the_limit_that_is_left() -> None:
    """The margin is (limit − demand)/limit, or −1 if the limit is not positive."""
    limit = np.array([2.0, 2.0, 2.0, 0.0, -1.0])
    worst = np.array([1.0, 2.0, 3.0, 0.0, -2.0])
    assert relative_margin(worst, limit) == pytest.approx([0.5, 0.0, -0.5, -1.0, -1.0])
    assert relative_margin(1.0, limit[:1]) == pytest.approx([0.5])


def test_an_answer_is_yes_no_or_not_known() -> None:
    """A yes depends on the worst margin, and a no depends on the best margin.

    The answer is yes if the worst margin is kept and no if even the best margin is not kept. It is
    open otherwise.
    """
    keeps, breaks = -MARGIN_TOLERANCE, -1.01 * MARGIN_TOLERANCE
    worst = np.array([keeps, 1.0, breaks, breaks, breaks])
    best = np.array([keeps, 1.0, keeps, 0.5, breaks])
    assert _answers_from_margins(worst, best).tolist() == [1, 1, 0, 0, -1]
    assert _answers_from_margins(worst, best).dtype == np.int8


def demands(values: np.ndarray) -> object:
    names = ("peak_torque", "rms_torque", "peak_effort")
    return SimpleNamespace(**{name: k * values for k, name in enumerate(names, 1)})


@pytest.mark.parametrize("smooth", [True, False])
def test_bands_hold_with_their_confidence_at_both_ends(smooth: bool) -> None:
    """At a confidence of 90 %, the band of ten draws ends at the first and at the ninth draw.

    Nine draws lie above the first, and nine draws do not exceed the ninth.
    """
    draws = np.arange(1.0, 11.0)
    without = demands(draws / 2) if smooth else None
    band = Band(demands(draws[:1]), demands(draws), demands(draws), True, without)  # type: ignore[arg-type]
    joint = SimpleNamespace(band=band, requirement=SimpleNamespace(to_dict=lambda: {"joint": "x"}))
    stated = JointSizing.requirement_dict(joint, 0.9)  # type: ignore[arg-type]
    assert stated["joint"] == "x"
    assert stated["band"]["peak_torque"] == [1.0, 9.0]
    assert stated["band"]["rms_torque"] == [2.0, 18.0]
    assert stated["band"]["peak_effort"] == [3.0, 27.0]
    if smooth:
        assert stated["band"]["peak_torque_without_ripple"] == [1.0, 4.5]
    else:
        assert "peak_torque_without_ripple" not in stated["band"]
    unknown = SimpleNamespace(known=False, smooth=None)
    joint = SimpleNamespace(band=unknown, requirement=SimpleNamespace(to_dict=dict))
    assert set(JointSizing.requirement_dict(joint, 0.9)["band"].values()) == {None}  # type: ignore[arg-type]
