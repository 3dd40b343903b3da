"""The supply voltage limits the current of the simulated motor controller, and the encoder rounds
to whole increments. The loop agrees with an independent PID recursion, and its phase margin agrees
with the open loop in closed form.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_controller, load_robot
from ssm_planner.problem.controller import AxisController, Controller
from ssm_planner.simulation.cascade import (
    LoopGains,
    MotorElectrics,
    advance_loops,
    current_range,
    default_bandwidth,
    loop_gains,
    motor_electrics,
    phase_margin,
    round_to_increments,
)
from tests.support.paths import PROBLEMS

ROBOT = PROBLEMS / "robots" / "vitreoretinal.yaml"
MOTOR = MotorElectrics(
    torque_constant=0.0148, resistance=0.763, voltage=21.6, max_current=5.0, lag=1e-4
)


@pytest.fixture(scope="module")
def robot():
    return load_robot(ROBOT)


def ranges(motor, speeds):
    """Return the smallest and the largest current (n, 2) in A at motor speeds (n,) in rad/s."""
    w = ca.SX.sym("w")
    function = ca.Function("range", [w], list(current_range(motor, w)))
    return np.array([[float(x) for x in function(speed)] for speed in speeds])


def test_the_current_keeps_to_the_supply_against_the_back_emf():
    speeds = np.linspace(-3000.0, 3000.0, 61)
    result = ranges(MOTOR, speeds)
    voltage = MOTOR.torque_constant * speeds[:, None] + MOTOR.resistance * result
    inside = np.abs(MOTOR.torque_constant * speeds) <= MOTOR.voltage
    assert np.all(np.abs(voltage[inside]) <= MOTOR.voltage * (1 + 1e-12))
    assert np.all(np.abs(result) <= MOTOR.max_current)
    assert np.all(result[:, 0] <= result[:, 1])
    # Beyond the no-load speed, the motor can only brake.
    fast = speeds > MOTOR.voltage / MOTOR.torque_constant
    assert fast.any()
    assert np.all(result[fast, 1] < 0)
    # At rest, only the power stage limits the current: 5 A through 0.763 Ω need just 3.8 V.
    np.testing.assert_allclose(ranges(MOTOR, [0.0])[0], [-5.0, 5.0])


def test_without_a_resistance_the_supply_binds_at_the_no_load_speed_alone():
    """Beyond the no-load speed, no current flows in the direction of the motion.

    An unlimited supply voltage leaves only the limit of the current.
    """
    no_load = MOTOR.voltage / MOTOR.torque_constant
    speeds = [-1.01 * no_load, -0.99 * no_load, 0.0, 0.99 * no_load, 1.01 * no_load]
    result = ranges(replace(MOTOR, resistance=0.0), speeds)
    np.testing.assert_allclose(result[:, 0], [0.0, -5.0, -5.0, -5.0, -5.0])
    np.testing.assert_allclose(result[:, 1], [5.0, 5.0, 5.0, 5.0, 0.0])
    for resistance in (0.0, 1.0):
        free = replace(MOTOR, resistance=resistance, voltage=np.inf)
        np.testing.assert_allclose(ranges(free, speeds), np.tile([-5.0, 5.0], (5, 1)))


def test_winding_and_supply_come_from_the_controller_and_then_from_the_motor(robot):
    joint = robot.joints[0]
    motor = replace(
        joint.motor, terminal_resistance=None, nominal_voltage=24.0, torque_constant=0.02
    )
    joint = replace(joint, motor=motor)
    plain = motor_electrics(joint, Controller(output_share=0.9))
    assert (plain.resistance, plain.voltage) == (0.0, pytest.approx(21.6))
    assert plain.max_current == pytest.approx(motor.max_torque / 0.02)
    axis = AxisController(max_current=0.7)
    controller = Controller(
        supply=10.0, output_share=0.5, joints={joint.name: axis}, current_lag=2e-4
    )
    result = motor_electrics(joint, controller)
    assert (result.voltage, result.max_current, result.lag) == (5.0, 0.7, 2e-4)
    dead = replace(joint, motor=replace(motor, nominal_voltage=None))
    assert motor_electrics(dead, Controller()).voltage == np.inf
    for lacking in (
        replace(joint, motor=None),
        replace(joint, motor=replace(motor, torque_constant=None)),
    ):
        with pytest.raises(ProblemError, match="torque_constant"):
            motor_electrics(lacking, Controller())


def test_gains_need_an_inertia_or_p_and_d(robot):
    joint = robot.joints[0]
    light = replace(joint, drive=replace(joint.drive, input_inertia=0.0))
    electrics = motor_electrics(joint, Controller())
    for axis, enough in (
        (AxisController(), False),
        (AxisController(p=1.0), False),
        (AxisController(d=1.0), False),
        (AxisController(p=1.0, d=0.1), True),
    ):
        controller = Controller(joints={joint.name: axis})
        if enough:
            result = loop_gains(light, controller, electrics)
            assert (result.p, result.i, result.d) == (1.0, 0.0, 0.1)
            continue
        with pytest.raises(ProblemError, match="no input inertia"):
            loop_gains(light, controller, electrics)
    with pytest.raises(ProblemError, match="has no drive"):
        loop_gains(robot.joints[2], Controller(), electrics)


@pytest.mark.parametrize(("period", "lag"), [(4e-4, 1e-4), (1e-3, 5e-4)])
@pytest.mark.parametrize("share", [0.3, 1.0, 2.0])
def test_the_phase_margin_is_that_of_the_stated_loop_at_its_crossing(period, lag, share):
    """The loop has P, I and D gains that act on an inertia.

    It also has a filter of the derivative with T_f = D / (10 P), the lag of the current, and a
    delay of half a period.
    """
    bandwidth = share * default_bandwidth(period, lag)
    omega = 2 * np.pi * bandwidth
    p, d, i = omega**2, 2 * 0.7 * omega, 0.1 * omega**3

    def loop(w):
        s = 1j * w
        pid = p + i / s + d * s / (1 + d / (10 * p) * s)
        return pid / s**2 / (1 + lag * s) * np.exp(-s * period / 2)

    crossing = brentq(lambda w: abs(loop(w)) - 1, omega, 20 * omega)
    # The phase is unwrapped from low frequencies, where the three poles at 0 give −270°.
    way = np.unwrap(np.angle(loop(np.geomspace(1e-6 * omega, crossing, 4000))))
    margin = 180 + np.degrees(way[-1] - way[0]) - 270
    assert phase_margin(bandwidth, period, lag) == pytest.approx(margin, abs=0.3)
    if share == 1.0:
        assert margin == pytest.approx(30.0, abs=0.3)


def test_a_loop_is_the_stated_pid():
    """The loop agrees with a PID recursion with a filtered derivative and a lag of the current."""
    gains, period = LoopGains(p=3.0, i=40.0, d=0.02, ff_velocity=0.0, ff_acceleration=0.0), 4e-4
    x, e, w, f = ca.SX.sym("x", 3), ca.SX.sym("e", 2), ca.SX.sym("w"), ca.SX.sym("f")
    step = advance_loops(gains, MOTOR, period, error=e, previous=x, w=w, feedforward=f)
    function = ca.Function(
        "loop", [x, e, w, f], [step.current, step.saturated, step.integral, step.derivative]
    )
    rng = np.random.default_rng(3)
    errors = np.cumsum(rng.normal(0, 0.01, 200))
    current = integral = derivative = before = 0.0
    lag, delay = np.exp(-period / MOTOR.lag), gains.d / (10 * gains.p)
    for error in errors:
        result = [
            float(v) for v in function([current, integral, derivative], [error, before], 100.0, 0.3)
        ]
        # The backward Euler method integrates the filtered derivative.
        derivative = (delay * derivative + gains.d * (error - before)) / (delay + period)
        demanded = gains.p * error + integral + derivative + 0.3
        current = demanded + (current - demanded) * lag
        integral += gains.i * error * period
        before = error
        assert not result[1]
        np.testing.assert_allclose(
            [result[0], *result[2:]], [current, integral, derivative], rtol=1e-12
        )


def test_an_integral_stops_where_the_current_is_cut_off():
    x, e = ca.SX.sym("x", 3), ca.SX.sym("e", 2)
    gains = LoopGains(p=100.0, i=1000.0, d=0.0, ff_velocity=0.0, ff_acceleration=0.0)
    step = advance_loops(gains, MOTOR, 4e-4, error=e, previous=x, w=ca.SX(0), feedforward=ca.SX(0))
    function = ca.Function("loop", [x, e], [step.current, step.saturated, step.integral])
    current, saturated, integral = (float(v) for v in function([5.0, 0.0, 0.0], [1.0, 1.0]))
    assert (current, saturated, integral) == (5.0, 1.0, 0.0)
    _, saturated, integral = (float(v) for v in function([5.0, 0.0, 0.0], [0.01, 0.01]))
    assert not saturated
    assert integral > 0


@pytest.mark.parametrize("counts", [64, 4096])
def test_an_encoder_rounds_to_the_nearest_increment(counts):
    a = ca.SX.sym("a")
    read = ca.Function("read", [a], [round_to_increments(a, counts)])
    angles = np.linspace(-20, 20, 777)
    result = np.array([float(read(angle)) for angle in angles])
    increment = 2 * np.pi / counts
    assert np.abs(result - angles).max() <= increment / 2 * (1 + 1e-9)
    np.testing.assert_allclose(result / increment, np.round(result / increment), atol=1e-9)


def test_default_gains_come_from_the_plant_and_the_shipped_file_states_them(robot):
    shipped = load_controller("epos4")
    for joint in robot.joints:
        if joint.drive is None:
            continue
        electrics = motor_electrics(joint, Controller())
        tuned = loop_gains(joint, Controller(), electrics)
        assert loop_gains(joint, shipped, motor_electrics(joint, shipped)) == tuned
        k, inertia = electrics.torque_constant, joint.drive.input_inertia
        # With the bare motor, the closed loop has the default bandwidth and a damping ratio of 0.7.
        omega = np.sqrt(k * tuned.p / inertia)
        assert omega == pytest.approx(2 * np.pi * default_bandwidth(4e-4, 1e-4))
        assert k * tuned.d / inertia == pytest.approx(2 * 0.7 * omega)
        assert tuned.ff_velocity == tuned.ff_acceleration == 0.0
        without = loop_gains(joint, Controller(torque_offset=False), electrics)
        assert without.ff_acceleration * k == pytest.approx(inertia)
        assert without.ff_velocity * k == pytest.approx(joint.drive.friction.b_v)
        controller = Controller(joints={joint.name: AxisController(p=1.0)})
        assert loop_gains(joint, controller, electrics).p == 1.0


def test_the_default_bandwidth_leaves_its_phase_margin(robot):
    """The closed loop in discrete time is stable. Two more periods of delay make it unstable."""
    period, lag = 4e-4, 1e-4
    bandwidth = default_bandwidth(period, lag)
    assert 100 < bandwidth < 200
    assert default_bandwidth(2 * period, 2 * lag) == pytest.approx(bandwidth / 2, rel=1e-6)

    def radius(delay):
        """Return the largest absolute eigenvalue of the closed loop, with a delay in periods.

        The state consists of position, speed, current, integral, filtered derivative, last error,
        and the delayed demands.
        """
        joint, controller = robot.joints[0], Controller()
        gains, k = loop_gains(joint, controller, motor_electrics(joint, controller)), 1.0
        unit = motor_electrics(joint, controller).torque_constant / joint.drive.input_inertia
        state, filtered = np.zeros((6 + delay, 6 + delay)), gains.d / (10 * gains.p)
        follows = 1 - np.exp(-period / lag)
        for column in range(6 + delay):
            x = np.zeros(6 + delay)
            x[column] = 1.0
            q, w, i, integral, derivative, before = x[:6]
            error = -q
            derivative = (filtered * derivative + gains.d * (error - before)) / (filtered + period)
            demanded = gains.p * error + integral + derivative
            line = [*x[6:], demanded] if delay else [demanded]
            i = i + follows * (line[0] - i)
            integral = integral + period * gains.i * error
            after = [q + period * w + period**2 / 2 * k * unit * i, w + period * k * unit * i]
            state[:, column] = [
                *after,
                i,
                integral,
                derivative,
                error,
                *(line[1:] if delay else []),
            ]
        return np.abs(np.linalg.eigvals(state)).max()

    assert radius(0) < 1
    # A phase margin of 30° at the crossing, which is at 1.5 times the bandwidth, permits a delay of
    # 0.4 ms. One period of dead time uses up this margin.
    assert radius(2) > 1


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("joints: {roll: {p: 3 A}}", ["joints.roll.p", "a position gain"]),
        ("joints: {wrist: {}}", ["wrist", "roll"]),
        ("loop_period: 3 s", ["loop_period", "0.01 ms to 2 ms"]),
        ("output_share: 1.2", ["output_share", "up to 1"]),
        ("counts_per_turn: 0.5", ["counts_per_turn", "whole"]),
        (
            "compliance: {insertion: {backlash: 1 deg}}",
            ["compliance.insertion.backlash", "a length"],
        ),
        ("gain: 3", ["gain", "unknown key"]),
    ],
)
def test_a_wrong_controller_file_is_refused_with_file_line_and_key(tmp_path, text, parts):
    path = tmp_path / "controller.yaml"
    path.write_text(text + "\n", encoding="utf-8")
    with pytest.raises(ProblemError) as caught:
        load_controller(path)
    assert caught.value.line == 1
    for part in [str(path), *parts]:
        assert part in str(caught.value)
