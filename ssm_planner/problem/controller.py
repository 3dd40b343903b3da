"""The controller that plays a plan, as frozen values: gains, limits, supply; what lies between motor and joint. SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from ssm_planner.problem.robot import JOINTS
from ssm_planner.problem.value import Bound, Names, NotNegative, Positive, Quantity, Value


@dataclass(frozen=True, eq=False)
class AxisController(Value):
    """One drive's position loop; None: from the plant's own figures (simulation/cascade.py says how)."""

    bandwidth: Annotated[Positive, Quantity("rate")] | None = None
    """Of the position loop, Hz: what gains that are None are tuned for."""
    p: Annotated[NotNegative, Quantity("position_gain")] | None = None
    """Position gain, A/rad at the motor."""
    i: Annotated[NotNegative, Quantity("integral_gain")] | None = None
    """Integral gain, A/(rad·s)."""
    d: Annotated[NotNegative, Quantity("derivative_gain")] | None = None
    """Derivative gain, A·s/rad."""
    ff_velocity: Annotated[NotNegative, Quantity("derivative_gain")] | None = None
    """Feed-forward of the velocity, A·s/rad."""
    ff_acceleration: Annotated[NotNegative, Quantity("acceleration_gain")] | None = None
    """Feed-forward of the acceleration, A·s²/rad."""
    max_current: Annotated[Positive, Quantity("current")] | None = None
    """Largest current, A; None: the motor's largest torque by its torque constant."""
    following_error: Annotated[Positive, Quantity("angle", "length")] | None = None
    """Window of the following error, rad or m of the joint; None: the one that `export --to epos4` writes."""


@dataclass(frozen=True, eq=False)
class JointCompliance(Value):
    """Spring, damper and free play between a drive and its joint. Every default is an assumption, not a measurement."""

    frequency: Annotated[Positive, Quantity("rate")] | None = None
    """Natural frequency of the joint with its drive locked, Hz; None: 30 Hz, joint 4 100 Hz."""
    damping_ratio: Annotated[NotNegative, Quantity("number")] = 0.3
    """Of the joint with its drive locked."""
    backlash: Annotated[NotNegative, Quantity("angle", "length")] | None = None
    """From one flank to the other, rad or m; None: 0.1 deg, joint 4 0.02 mm."""
    source: str | None = None
    """Where the figures come from."""


@dataclass(frozen=True, eq=False)
class Controller(Value):
    """A cascade as an EPOS4 runs it: position PID with feed-forward at `loop_period`, inside it a current loop."""

    name: str = "EPOS4, tuned from the plant"
    """Of the controller and its tuning."""
    loop_period: Annotated[Positive, Quantity("time")] = 400e-6
    """Of the position loop, s: 2.5 kHz in an EPOS4 (hardware reference, 50/5)."""
    current_lag: Annotated[Positive, Quantity("time")] = 100e-6
    """Time constant of the closed current loop, s; assumed: the current is sampled at 25 kHz."""
    supply: Annotated[Positive, Quantity("voltage")] | None = None
    """Supply voltage, V; None: the motor's nominal voltage."""
    output_share: Annotated[float, Bound(above=0.0), Quantity("number")] = 0.9
    """Of the supply voltage that reaches the motor: 0.9 in an EPOS4 (hardware reference, 50/5)."""
    counts_per_turn: Annotated[int, Bound(above=0), Quantity("number")] | None = None
    """Increments per motor turn where a motor file gives no encoder; None: 4096, as on the authors' rigs."""
    torque_offset: bool = True
    """Whether the drive adds the exported torque offsets. Without them velocity and acceleration feed-forward are tuned."""
    joints: Annotated[Mapping[str, AxisController], Names(JOINTS)] = field(default_factory=dict)
    """The position loops, by joint."""
    compliance: Annotated[Mapping[str, JointCompliance], Names(JOINTS)] = field(
        default_factory=dict
    )
    """Between drive and joint, by joint."""
    file: str | None = field(default=None, compare=False)

    def _check(self) -> None:
        if self.output_share > 1:
            raise self._wrong("output_share", "more than the supply gives", "above 0 and up to 1")
        if not 1e-5 <= self.loop_period <= 2e-3:
            raise self._wrong(
                "loop_period", "no period of a position loop: is the unit right?", "0.01 ms to 2 ms"
            )

    def axis(self, joint: str) -> AxisController:
        """The loop of a joint by name."""
        return self.joints.get(joint, AxisController())
