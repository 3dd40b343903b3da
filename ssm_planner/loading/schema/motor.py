"""Schema of a motor file: the figures of a datasheet, each with its source.

Schema of a motorisation file: single joints moved back and forth to find what their motors need.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field as PydanticField

from ssm_planner.loading.schema.common import Figure, Model, Text, Truth, figure, quantity
from ssm_planner.loading.schema.problem import Joints
from ssm_planner.loading.schema.robot import Reference

Torque = Annotated[Figure, figure("torque", above=0)]
Speed = Annotated[Figure, figure("motor_speed", above=0)]
Voltage = Annotated[Figure, figure("voltage", above=0)]
Current = Annotated[Figure, figure("current", above=0)]
TorqueConstant = Annotated[Figure, figure("torque_constant", above=0)]
SpeedConstant = Annotated[Figure, figure("speed_constant", above=0)]
Resistance = Annotated[Figure, figure("resistance", above=0)]
Inertia = Annotated[Figure, figure("inertia", above=0)]
ThermalResistance = Annotated[Figure, figure("thermal_resistance", above=0)]
Time = Annotated[Figure, figure("time", above=0)]
Temperature = Annotated[Figure, figure("temperature", above=0)]
Drift = Annotated[Figure, figure("number", at_least=-0.01)]
Count = Annotated[Figure, figure("number", above=0)]


class MotorModel(Model):
    """See values.Motor; the speed constant only serves to check the torque constant."""

    name: Text
    source: Text | None = None
    """Source of every figure that names none of its own."""
    placeholder: Truth = False
    """True: every figure stands in for an unknown one."""
    nominal_torque: Torque
    max_torque: Torque
    max_speed: Speed
    nominal_voltage: Voltage | None = None
    nominal_current: Current | None = None
    torque_constant: TorqueConstant | None = None
    speed_constant: SpeedConstant | None = None
    terminal_resistance: Resistance | None = None
    rotor_inertia: Inertia | None = None
    resistance_winding_housing: ThermalResistance | None = None
    resistance_housing_ambient: ThermalResistance | None = None
    time_constant_winding: Time | None = None
    time_constant_motor: Time | None = None
    max_winding_temperature: Temperature | None = None
    torque_constant_per_kelvin: Drift | None = None
    """Relative, 1/K: −0.0011 where the torque constant loses 0.11 % per kelvin."""
    encoder_counts: Count | None = None


Angle = Annotated[float, quantity("angle")]
Length = Annotated[float, quantity("length")]


class RevoluteRun(Model):
    """Centre ± reach, at the speed and acceleration of a trapezoid."""

    reach: Annotated[float, quantity("angle", above=0)]
    centre: Angle = 0.0
    velocity: Annotated[float, quantity("angular_velocity", above=0)]
    acceleration: Annotated[float, quantity("angular_acceleration", above=0)]


class PrismaticRun(Model):
    """Centre ± reach, at the speed and acceleration of a trapezoid."""

    reach: Annotated[float, quantity("length", above=0)]
    centre: Length = 0.0
    velocity: Annotated[float, quantity("velocity", above=0)]
    acceleration: Annotated[float, quantity("acceleration", above=0)]


class RunModel(Model):
    """One of the joints."""

    roll: RevoluteRun | None = None
    tilt: RevoluteRun | None = None
    spin: RevoluteRun | None = None
    insertion: PrismaticRun | None = None


class MotorisationModel(Model):
    """See problem/motorisation.py."""

    name: Text | None = None
    source: Text | None = None
    robot: Reference
    held: Joints = (0.0, 0.0, 0.0, 0.0)
    """Where the joints stand that do not move."""
    back_and_forth: Annotated[list[RunModel], PydanticField(min_length=1, max_length=100)]
