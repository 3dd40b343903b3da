"""Plan the shipped tilt-and-insert motion and ask the independent check about it."""

import ssm_planner

plan = ssm_planner.plan("tilt_insert")
if not plan.passed:
    raise SystemExit(plan.reason.message)
print(f"duration {plan.duration:.3f} s; no motion is faster than {plan.lower_bound:.3f} s")
for name in ("velocity", "motor torque"):
    limit = plan.certificate[name, "tilt"]
    print(f"tilt, {name}: {limit.worst:.4g} of at most {limit.limit:.4g}")
