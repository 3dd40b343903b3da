"""Figures of the workspace show the computed numbers.

The published table of tilt ranges is computed again.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from paper_reproduction.workspace import tilt_table
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import design_region, tilt_interval
from ssm_planner.reporting.figures.workspace import (
    design_region_figure,
    joint_speed_figure,
    publish_figures,
    reachable_set_figure,
    theta2_figure,
    workspace_figures,
)
from tests.support.tilts import tilt_from_theta2


@pytest.fixture(scope="module")
def mechanism() -> Mechanism:
    return Mechanism.from_angles(math.radians(30.0), math.radians(110.0), math.radians(-113.0))


def test_theta2_figure_draws_both_branches_to_the_boundary(mechanism):
    axes = theta2_figure(mechanism).axes[0]
    for line in axes.lines[:2]:
        tilt, theta2 = np.radians(line.get_data())
        assert tilt[[0, -1]] == pytest.approx(tilt_interval(mechanism), abs=1e-12)
        assert np.abs(tilt_from_theta2(mechanism, theta2) - tilt).max() < 1e-9
    assert "(home)" in axes.lines[1].get_label()


def test_reachable_set_figure_names_the_tilt_interval(mechanism):
    section = reachable_set_figure(mechanism).axes[1]
    assert {"−140.00°", "−80.00°"} <= {text.get_text() for text in section.texts}


def test_joint_speed_figure_draws_three_joints_and_the_singular_value(mechanism):
    speeds, singular = joint_speed_figure(mechanism).axes
    assert [line.get_label() for line in speeds.lines[:3]] == ["joint 1", "joint 2", "joint 3"]
    assert all(np.isfinite(line.get_ydata()).all() for line in speeds.lines[:3])
    assert singular.lines[0].get_ydata().max() < 1.0


def test_design_region_figure_draws_margins_and_choice(mechanism):
    region = design_region(math.radians(-140.0), math.radians(-80.0))
    axes = design_region_figure(region, (mechanism.alpha, mechanism.beta)).axes[0]
    assert len(axes.patches) == 3
    assert axes.lines[0].get_xydata()[0] == pytest.approx([30.0, 110.0])
    empty = design_region_figure(design_region(-3.0, -0.1, margin=0.2)).axes[0]
    assert not empty.patches


@pytest.mark.parametrize(("alpha", "beta"), [(1.0, 1.0), (2.5, 1.5), (math.pi - 1.0, 1.0)])
@pytest.mark.slow
def test_figures_of_unusual_mechanisms_are_drawn(alpha, beta, tmp_path):
    paths = publish_figures(workspace_figures(Mechanism.from_angles(alpha, beta)), tmp_path / "new")
    assert sorted(Path(path).suffix for path in paths.values()) == [".pdf"] * 4 + [".png"] * 4
    assert all(Path(path).stat().st_size > 1000 for path in paths.values())


def test_table_of_tilt_ranges(mechanism):
    extent, low, high = tilt_table(mechanism)
    assert math.degrees(extent.theoretical) == pytest.approx(60.0)
    assert math.degrees(extent.measured) == pytest.approx(59.1)
    assert extent.agreement == pytest.approx(0.985)
    assert math.degrees(low.theoretical) == pytest.approx(math.degrees(low.paper))
    assert math.degrees(high.theoretical) == pytest.approx(math.degrees(high.paper))
