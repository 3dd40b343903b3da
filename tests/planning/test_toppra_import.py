"""toppra loads without plots and splines, and all of it works when they are asked for."""

from __future__ import annotations

import subprocess
import sys

CODE = """if True:
    import sys
    import numpy as np
    from ssm_planner.planning.retiming.retime import UNUSED, load_toppra
    load_toppra()
    assert not set(UNUSED) & set(sys.modules), "stand-ins or the real modules are left behind"
    import toppra
    from toppra.algorithm import TOPPRA
    path = toppra.SplineInterpolator([0.0, 0.5, 1.0], np.array([[0.0, 0.0], [1.0, 2.0], [0.0, 1.0]]))
    limit = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    limits = [toppra.constraint.JointVelocityConstraint(limit), toppra.constraint.JointAccelerationConstraint(limit)]
    plans = [TOPPRA(limits, path, parametrizer=name) for name in ("ParametrizeConstAccel", "ParametrizeSpline")]
    for plan in plans:
        print(f"{plan.compute_trajectory().duration:.9g}")
    print(toppra.SimplePath([0, 1, 2], np.array([[0.0], [1.0], [0.0]]))(0.5).size)
    import matplotlib.pyplot, scipy.interpolate
    assert isinstance(path.cspl, scipy.interpolate.CubicSpline)
    assert matplotlib.pyplot.__file__
"""


def test_toppra_works_whole() -> None:
    prelude = "import matplotlib.pyplot, scipy.interpolate, scipy.sparse\n"
    ours, plain = (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        for code in (CODE, prelude + CODE.replace("assert not set", "assert set"))
    )
    assert len(ours.split()) == 3
    assert ours == plain
