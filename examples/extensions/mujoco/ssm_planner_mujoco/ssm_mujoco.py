"""Simulate the robot of this folder in MuJoCo, with the exact friction of its drives.

`python ssm_mujoco.py` plays the plan and then switches the motors off. All laws come from the C
files of this folder, which a C compiler translates when this module is loaded.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

FOLDER = Path(__file__).resolve().parent


def compile_library() -> Path:
    """Compile the C files of this folder, and return the path of the library.

    Raises OSError if there is no C compiler.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise OSError("no C compiler (cc or gcc): the law of the drives is C code")
    package = Path(mujoco.__file__).parent
    (runtime,) = package.glob("libmujoco*")
    path = Path(tempfile.mkdtemp(prefix="ssm_mujoco_")) / "libssm.so"
    sources = sorted(FOLDER.glob("*.c"))
    flags = ["-O2", "-ffp-contract=off", "-shared", "-fPIC", f"-I{package / 'include'}"]
    link = [str(runtime), f"-Wl,-rpath,{package}", "-lm"]
    subprocess.run([compiler, *flags, "-o", path, *sources, *link], check=True)
    return path


class Arm:
    """The model, its data and the exported plan.

    Creating an arm installs the passive force as `mjcb_passive` of the process. Other models are
    not affected.
    """

    def __init__(self) -> None:
        self.law = ctypes.CDLL(str(compile_library()))
        mujoco.set_mjcb_passive(self.law.ssm_passive)
        (file,) = FOLDER.glob("robot*.xml")
        self.model = mujoco.MjModel.from_xml_path(str(file))
        self.data, self.scratch = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self.duration = ctypes.c_double.in_dll(self.law, "ssm_duration").value
        names = [self.model.actuator(k).name for k in range(4)]
        self.joints = [self.model.joint(name).qposadr[0] for name in names]
        shafts = [self.model.actuator(k).trnid[0] for k in range(4)]
        self.shafts = [self.model.jnt_qposadr[shaft] for shaft in shafts]
        self.driven = [k for k in range(4) if self.shafts[k] != self.joints[k]]
        constants = (ctypes.c_double * 4 * 5).in_dll(self.law, "ssm_drive_constants")
        self.ratio, self.inertia, self.stiffness, self.damping, self.free_play = np.array(constants)

    def sample(self, t: float) -> tuple[np.ndarray, ...]:
        """Return q, qd, qdd and the motor torque of the plan at a time, each (4,)."""
        rows = np.zeros((4, 4))
        pointers = (row.ctypes.data_as(ctypes.c_void_p) for row in rows)
        self.law.ssm_sample(ctypes.c_double(t), *pointers)
        return tuple(rows)

    def efforts(self, q: Any, qd: Any, qdd: Any) -> np.ndarray:
        """Return the efforts (4,) that MuJoCo computes for a motion of the joints."""
        data = self.scratch
        data.qpos[self.joints], data.qvel[self.joints], data.qacc[self.joints] = q, qd, qdd
        mujoco.mj_inverse(self.model, data)
        return (data.qfrc_inverse + data.qfrc_passive)[self.joints]

    def place(self, q: Any, qd: Any = (0, 0, 0, 0), qdd: Any = (0, 0, 0, 0)) -> None:
        """Reset the data to a motion of the joints whose springs carry their efforts."""
        mujoco.mj_resetData(self.model, self.data)
        effort = self.efforts(q, qd, qdd)
        twist = effort / self.stiffness + np.sign(effort) * self.free_play
        self.data.qpos[self.joints], self.data.qvel[self.joints] = q, qd
        for k in self.driven:
            self.data.qpos[self.shafts[k]] = self.ratio[k] * (q[k] + twist[k])
            self.data.qvel[self.shafts[k]] = self.ratio[k] * qd[k]
        mujoco.mj_forward(self.model, self.data)

    def tip(self) -> np.ndarray:
        """Return the position (3,) of the tool tip, m."""
        return self.data.body("tool").xpos.copy()

    def play(self, rows: int = 200) -> dict[str, np.ndarray]:
        """Play the plan with feed-forward and position loops, and return what happened.

        The result has the times (n,), the joint positions and motor torques (n, 4), and the tips
        (n, 3) at about n = `rows` instants.
        """
        start = self.sample(0.0)[0]
        self.place(start)
        self.data.userdata[4:8] = self.data.qpos[self.shafts] - self.ratio * start
        steps = max(1, round(self.duration / rows / self.model.opt.timestep))
        result: dict[str, list[Any]] = {name: [] for name in ("time", "q", "torque", "tip")}
        mujoco.set_mjcb_control(self.law.ssm_control)
        while self.data.time < self.duration:
            mujoco.mj_step(self.model, self.data, steps)
            torque = np.where(self.ratio > 0, self.data.ctrl, 0.0)
            values = (self.data.time, self.data.qpos[self.joints], torque, self.tip())
            for name, value in zip(result, values, strict=True):
                result[name].append(np.array(value))
        mujoco.set_mjcb_control(None)
        return {name: np.array(values) for name, values in result.items()}

    def switch_off(self, duration: float) -> float:
        """Simulate the arm without power, and return how far the tip drifts after 1 s, m."""
        self.data.ctrl[:] = 0.0
        mujoco.mj_step(self.model, self.data, round(1.0 / self.model.opt.timestep))
        start = self.tip()
        mujoco.mj_step(self.model, self.data, round(duration / self.model.opt.timestep))
        return float(np.linalg.norm(self.tip() - start))


def main() -> None:
    """Print how the arm plays its plan, whether it holds without power, and the speed."""
    arm = Arm()
    begin = time.process_time()
    played = arm.play()
    speed = arm.data.time / (time.process_time() - begin)
    planned = np.array([arm.sample(float(t))[0] for t in played["time"]])
    torques = 1e3 * np.abs(played["torque"]).max(axis=0)
    print(f"played {arm.duration:.3f} s, {speed:.0f} × faster than real time (one core)")
    print("largest motor torques in mN·m:", torques.round(3))
    print("largest errors of the joints in rad, m:", np.abs(played["q"] - planned).max(axis=0))
    print(f"drift of the tip in 10 s without power: {arm.switch_off(10.0) * 1e6:.2g} µm")


if __name__ == "__main__":
    main()
