"""Settings of the controller that plays a plan, and of joint compliance, in SI units."""

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated

from ssm_planner.problem.robot import JOINTS
from ssm_planner.problem.value import (
    Bound,
    Coefficient,
    Current,
    Names,
    NotNegative,
    Positive,
    Time,
    Value,
    uncompared_field,
)
from ssm_planner.typing import record


@record
class AxisController(Value):
    """Settings of the position loop of one drive.

    A value that is None is computed from the data of motor and drive (simulation/cascade.py).

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.AxisController(bandwidth=200.0, max_current=1.5).bandwidth
    200.0
    """

    bandwidth: Annotated[Positive, "rate"] | None = None
    """Bandwidth of the position loop, Hz, for which gains that are None are tuned."""
    p: Annotated[NotNegative, "position_gain"] | None = None
    """Position gain, A/rad at the motor."""
    i: Annotated[NotNegative, "integral_gain"] | None = None
    """Integral gain, A/(rad·s)."""
    d: Annotated[NotNegative, "derivative_gain"] | None = None
    """Derivative gain, A·s/rad."""
    ff_velocity: Annotated[NotNegative, "derivative_gain"] | None = None
    """Velocity feed-forward, A·s/rad."""
    ff_acceleration: Annotated[NotNegative, "acceleration_gain"] | None = None
    """Acceleration feed-forward, A·s²/rad."""
    max_current: Current | None = None
    """Largest current, A.

    The default is the motor's largest torque divided by its torque constant.
    """
    following_error: Annotated[Positive, "angle or length"] | None = None
    """Window of the following error, rad or m of the joint.

    The default is the value that `export --to epos4` writes.
    """


@record
class JointCompliance(Value):
    """Spring, damper and backlash between a drive and its joint.

    All defaults are assumptions, not measurements.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.JointCompliance(frequency=80.0).damping_ratio
    0.3
    """

    frequency: Annotated[Positive, "rate"] | None = None
    """Natural frequency of the joint with its drive locked, Hz.

    The default is 30 Hz, for joint 4 100 Hz.
    """
    damping_ratio: Coefficient = 0.3
    """Damping ratio of the joint with its drive locked."""
    backlash: Annotated[NotNegative, "angle or length"] | None = None
    """Free play between both flanks, rad or m. The default is 0.1 deg, for joint 4 0.02 mm."""
    source: str | None = None
    """Source of the figures."""


@record
class Controller(Value):
    """Cascade of an EPOS4: a position PID with feed-forward around a current loop.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> controller = ssm.Controller(joints={"roll": ssm.AxisController(bandwidth=200.0)})
    >>> controller.joints["roll"].bandwidth
    200.0
    """

    name: str = "EPOS4, tuned from the plant"
    """Name of the controller and its tuning."""
    loop_period: Time = 400e-6
    """Period of the position loop, s. An EPOS4 runs at 2.5 kHz (hardware reference, 50/5)."""
    current_lag: Time = 100e-6
    """Time constant of the closed current loop, s.

    The default is an assumption for 25 kHz current sampling.
    """
    supply: Annotated[Positive, "voltage"] | None = None
    """Supply voltage, V. The default is the motor's nominal voltage."""
    output_share: Annotated[float, Bound(above=0.0), "number"] = 0.9
    """Share of the supply voltage that reaches the motor.

    It is 0.9 in an EPOS4 (hardware reference, 50/5).
    """
    counts_per_turn: Annotated[int, Bound(above=0), "number"] | None = None
    """Increments per motor turn if a motor file omits the encoder.

    The default is 4096, as on the authors' rigs.
    """
    torque_offset: bool = True
    """True if the drive adds the exported torque offsets.

    If False, the feed-forward of velocity and acceleration is tuned instead.
    """
    joints: Annotated[Mapping[str, AxisController], Names(JOINTS)] = field(default_factory=dict)
    """Position loops by joint."""
    compliance: Annotated[Mapping[str, JointCompliance], Names(JOINTS)] = field(
        default_factory=dict
    )
    """Compliance between drive and joint, by joint."""
    file: str | None = uncompared_field()

    def _check(self) -> None:
        """Raise ProblemError if the share of the supply voltage or the loop period is invalid."""
        if self.output_share > 1:
            raise self._field_error(
                "output_share", "more than the supply provides", "above 0 and up to 1"
            )
        if not 1e-5 <= self.loop_period <= 2e-3:
            raise self._field_error(
                "loop_period",
                "implausible period of a position loop: check the unit",
                "0.01 ms to 2 ms",
            )

    def axis(self, joint: str) -> AxisController:
        """Return the settings of the position loop of a joint.

        Parameters
        ----------
        joint : str
            Name of the joint.

        Returns
        -------
        AxisController
            The settings. A joint without settings has the default settings.
        """
        return self.joints.get(joint, AxisController())
