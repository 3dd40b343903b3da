"""Plan several targets in worker processes and collect the results."""

from concurrent.futures import ProcessPoolExecutor

from ssm_planner import Free, Joints, Plan, Problem, load_robot, plan


def plan_to(tilt: float) -> Plan:
    start = Joints((0.0, 0.5, 0.0, 0.0))
    return plan(Problem(load_robot("vitreoretinal"), start, (Free(Joints((0.0, tilt, 0.0, 0.0))),)))


if __name__ == "__main__":
    with ProcessPoolExecutor(2) as pool:
        plans = list(pool.map(plan_to, [0.6, 0.7, 0.8]))
    print([round(result.duration, 3) for result in plans])
