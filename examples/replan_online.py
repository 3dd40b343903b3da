"""Turn to another target in the middle of a motion without stopping first."""

from ssm_planner import Free, Joints, Problem, Replanner, load_robot

robot = load_robot("vitreoretinal")
start, target = Joints((0.0, 0.5, 0.0, 0.0)), Joints((0.4, 0.8, 0.0, 0.0))
replanner = Replanner(Problem(robot, start, (Free(target),)))
first = replanner.plan()
half = first.duration / 2
second = replanner.plan_from(first, at=half, target=Joints((0.1, 0.9, 0.0, 0.0)))
speed = second.trajectory.sample(0.0).qd[0]
print(f"first motion: {first.duration:.3f} s, left at {half:.3f} s with {speed.round(3).tolist()}")
print(f"second motion: {second.duration:.3f} s, passed: {second.passed}")
