"""Ask whether a weaker motor would do for a planned motion."""

from dataclasses import replace

from ssm_planner import load_problem, plan, size

problem = load_problem("tilt_insert")
result = plan(problem)
motor = problem.robot.joints[1].motor
weaker = replace(motor, name="a weaker motor", nominal_torque=motor.nominal_torque / 5)
sizing = size(result, motors={"tilt": [motor, weaker]})
for verdict in sizing.joints[1].candidates:
    failed = [check.name for check in verdict.checks if check.passed is False]
    print(f"{verdict.motor.name}: adequate {verdict.adequate}, failed checks: {failed}")
