"""Put a catalogue's gearhead between a motor and the present drive of a joint.

The figures of a drive refer to the motor shaft. A new gearhead with the ratio N and the efficiency
η makes the former motor shaft its output shaft. Seen from the new motor shaft, the inertia J of the
former shaft without its rotor becomes J / (N² η), the Coulomb friction torque b_c of its bearings
b_c / (N η), and the viscous friction coefficient b_v of its bearings b_v / (N² η). This is exact
while the motor drives the gearhead. While the load drives it, the friction is overestimated.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import required_friction
from ssm_planner.errors import ProblemError
from ssm_planner.loading import CatalogueEntry
from ssm_planner.problem import Drive, Gearhead
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import rotor_range
from ssm_planner.typing import Keywords, record


@record
class DriveChain:
    """A drive of a catalogue, alone or behind a gearhead of a catalogue."""

    gear: CatalogueEntry[Drive]
    gearhead: CatalogueEntry[Gearhead] | None = None

    @property
    def label(self) -> str:
        """Names of gearhead and drive."""
        return " + ".join(part.label for part in (self.gearhead, self.gear) if part is not None)

    @property
    def placeholder(self) -> bool:
        """True if a figure of the gearhead or the drive is a placeholder for an unknown one."""
        in_gearhead = self.gearhead is not None and self.gearhead.of.placeholder
        return in_gearhead or bool(self.gear.of.placeholders)

    def load(self, load: JointLoad) -> JointLoad:
        """Return the load of a joint with this chain in place of its present drive.

        Parameters
        ----------
        load : JointLoad
            Load of the joint with its present drive.

        Returns
        -------
        JointLoad
            Load of the same motion with the drive of the chain.
        """
        load = replace(load, drive=self.gear.of)
        return load if self.gearhead is None else with_gearhead(load, self.gearhead.of)


def with_gearhead(load: JointLoad, gearhead: Gearhead) -> JointLoad:
    """Put a gearhead between the motor and the present drive of a joint.

    The result has no motor, because the drive no longer contains the rotor and the friction of the
    original one. Its friction and inertia follow from the equations at the top of this module.

    Parameters
    ----------
    load : JointLoad
        Load of the joint with its present drive and motor.
    gearhead : Gearhead
        Gearhead of a catalogue.

    Returns
    -------
    JointLoad
        Load of the same motion with the new drive. Its `shaft` is the range of the inertia on the
        new motor shaft without a rotor.

    Raises
    ------
    ProblemError
        If the joint has a gearhead already.
    """
    drive = load.drive
    friction = required_friction(drive)
    if drive.gearhead is not None:
        raise ProblemError(
            "a catalogue of gearheads needs a drive without gearhead",
            file=drive.file,
            key=load.joint,
        )
    ratio = gearhead.ratio
    forwards = gearhead.forwards
    # Factors of the friction parameters. All other parameters have the factor 1.
    factors = {
        "b_c": forwards,
        "b_v": forwards / ratio,
        "stribeck_speed": ratio,
        "identified_speed": ratio,
    }
    scaled: Keywords = {}
    for name, factor in factors.items():
        value = getattr(friction, name)
        if value is not None:
            scaled[name] = factor * value
    posterior = friction.posterior and friction.posterior.scaled(factors, forwards)
    covariance = None
    if friction.covariance is not None:
        covariance = {}
        for name, row in friction.covariance.items():
            row_factor = factors.get(name, 1.0)
            covariance[name] = {
                column: row_factor * factors.get(column, 1.0) * value
                for column, value in row.items()
            }
    ranges = {}
    for name, (low, high) in drive.friction_ranges.items():
        factor = factors.get(name, 1.0)
        ranges[name] = (factor * low, factor * high)
    # The rotor of the original motor leaves the former shaft. Its inertia may have a range.
    inertia_with_rotor = drive.input_inertia
    rotor = (0.0, inertia_with_rotor)
    if load.motor is not None:
        rotor = rotor_range(load.motor)
    remaining = inertia_with_rotor - np.array(rotor[::-1])
    shaft = (gearhead.inertia or 0.0) + forwards / ratio * np.maximum(remaining, 0.0)
    low, high = shaft.tolist()
    chain = replace(
        drive,
        ratio=ratio * drive.ratio,
        input_inertia=high,
        friction=replace(friction, **scaled, posterior=posterior, covariance=covariance),
        friction_ranges=ranges,
        gearhead=gearhead,
        placeholders=drive.placeholders + ("gearhead",) * gearhead.placeholder,
    )
    return replace(load, drive=chain, motor=None, shaft=(low, high))
