"""Figures of a plan show names of phases, limits and texts without overlaps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ssm_planner.plans import load_plan
from ssm_planner.reporting.figures.plan import NAMED_WIDTHS, motion_figure, motors_figure
from ssm_planner.reporting.figures.style import fit_phase_name, new_panels, shade_phases
from ssm_planner.sizing.requirements import motor_requirements
from ssm_planner.trajectory import Span, Trajectory
from tests.support.paths import RESULTS

PLAN = RESULTS / "tilt_insert/plan.json"


@pytest.mark.parametrize("count", [1, 5, 13, 62])
def test_names_of_phases_never_collide(count: int) -> None:
    """No name of a phase overlaps the next one.

    The widths are those of the texts that matplotlib draws.
    """
    plan = load_plan(PLAN)
    draw = np.random.default_rng(count)
    edges = np.concatenate(([0.0], np.cumsum(draw.uniform(0.05, 1.0, count))))
    edges *= plan.motion.duration / edges[-1]
    names = [f"ring, {'laser' if k % 2 else 'spot'} {k // 2 + 1}" for k in range(count)]
    phases = tuple(
        Span(name, start, end) for name, (start, end) in zip(names, pairwise(edges), strict=True)
    )
    motion = Trajectory(plan.motion.breaks, plan.motion.coefficients, phases)
    figure, panels = new_panels(
        9.0, 6.4, rows=3, columns=2, edges=(0.75, 0.1, 0.5, 0.55), gaps=(0.85, 0.2), sharex=True
    )
    axes = panels[0, 0]
    axes.plot([0.0, motion.duration], [0.0, 1.0])
    shade_phases(axes, motion, with_names=True)
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in axes.texts if text.get_text()]
    assert count > 13 or boxes
    assert all(first.x1 <= second.x0 for first, second in pairwise(boxes))


def test_the_longest_name_that_fits() -> None:
    assert [fit_phase_name("ring, spot 12", letters) for letters in (13, 12, 7, 6, 2, 1)] == [
        "ring, spot 12",
        "spot 12",
        "spot 12",
        "12",
        "12",
        "",
    ]
    assert fit_phase_name("insert", 3) == ""


def test_limits_stand_in_the_figure_of_the_motion() -> None:
    """The figure of the motion shows the velocity limits of joint 1 as lines at their values."""
    plan = load_plan(PLAN)
    axes = motion_figure(plan.motion, plan.robot).axes[2]
    levels = {
        round(float(line.get_ydata()[0]), 6)
        for line in axes.get_lines()
        if len(line.get_ydata()) == 2
    }
    bound = round(float(np.rad2deg(plan.robot.joints[0].velocity)), 6)
    assert {bound, -bound} <= levels


@pytest.mark.parametrize("name", list(NAMED_WIDTHS))
def test_figures_of_a_width_are_that_wide_and_their_type_is_not_scaled(name: str) -> None:
    """Every text lies within the figure, and no two texts overlap."""
    plan = load_plan(PLAN)
    requirements = motor_requirements(plan.motion, plan.robot)
    for figure in (
        motion_figure(plan.motion, plan.robot, NAMED_WIDTHS[name]),
        motors_figure(plan.motion, plan.robot, requirements, NAMED_WIDTHS[name]),
    ):
        assert figure.get_size_inches()[0] == NAMED_WIDTHS[name]
        figure.canvas.draw()
        texts = [
            text
            for axes in figure.axes
            for text in (axes.xaxis.label, axes.yaxis.label, *axes.texts)
        ]
        texts += [axes._right_title for axes in figure.axes] + [
            item for key in figure.legends for item in key.texts
        ]
        boxes = [text.get_window_extent() for text in texts if text.get_text()]
        for i, box in enumerate(boxes):
            assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
            assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1
            assert not any(box.overlaps(other) for other in boxes[i + 1 :])
