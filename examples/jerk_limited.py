"""Move all joints from rest to rest with jerk limits, each in its shortest common time."""

from dataclasses import replace

from ssm_planner import Free, Joints, Problem, load_robot, plan

robot = load_robot("vitreoretinal")
joints = tuple(replace(joint, jerk=20 * joint.acceleration) for joint in robot.joints)
robot = replace(robot, joints=joints)
start, target = Joints((0.0, 0.5, 0.0, 0.0)), Joints((0.4, 0.8, 0.2, -0.01))
result = plan(Problem(robot, start, (Free(target),)))
print(f"passed: {result.passed}, duration {result.duration:.3f} s")
