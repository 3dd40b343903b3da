"""Add a limit to a shipped problem and see what it costs."""

from dataclasses import replace

from ssm_planner import TipSpeed, load_problem, plan

problem = load_problem("tilt_insert")
slower = replace(problem, limits=(*problem.limits, TipSpeed(0.004)))
fast, gentle = plan(problem), plan(slower)
print(f"as shipped: {fast.duration:.3f} s")
print(f"tip at most 4 mm/s: {gentle.duration:.3f} s, passed: {gentle.passed}")
