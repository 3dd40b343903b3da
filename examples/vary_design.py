"""Plan the same motion for several gear ratios of the tilt drive."""

from dataclasses import replace

from ssm_planner import load_problem, plan

problem = load_problem("tilt_insert")
for ratio in (120.0, 1200.0, 2400.0):
    joints = list(problem.robot.joints)
    joints[1] = replace(joints[1], drive=replace(joints[1].drive, ratio=ratio))
    robot = replace(problem.robot, joints=tuple(joints))
    result = plan(replace(problem, robot=robot), relaxations=False)
    outcome = f"{result.duration:.3f} s" if result.passed else result.reason.message
    print(f"ratio {ratio:.0f}: {outcome}")
