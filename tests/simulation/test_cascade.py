"""Laws of the motor controller: the supply binds, the loop is the stated PID, the encoder rounds."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_controller, load_robot
from ssm_planner.problem.controller import AxisController, Controller
from ssm_planner.simulation.cascade import (
    Electrics,
    Gains,
    bandwidth_of,
    current_range,
    electrics_of,
    encoder,
    gains_of,
    loop_step,
)

ROBOT = Path(__file__).parents[2] / "problems" / "robots" / "vitreoretinal.yaml"
MOTOR = Electrics(torque_constant=0.0148, resistance=0.763, voltage=21.6, max_current=5.0, lag=1e-4)


@pytest.fixture(scope="module")
def robot():
    return load_robot(ROBOT)


def ranges(motor, speeds):
    w = ca.SX.sym("w")
    function = ca.Function("range", [w], list(current_range(motor, w)))
    return np.array([[float(x) for x in function(speed)] for speed in speeds])


def test_the_current_keeps_to_the_supply_against_the_back_emf():
    speeds = np.linspace(-3000.0, 3000.0, 61)
    found = ranges(MOTOR, speeds)
    voltage = MOTOR.torque_constant * speeds[:, None] + MOTOR.resistance * found
    inside = np.abs(MOTOR.torque_constant * speeds) <= MOTOR.voltage
    assert np.all(np.abs(voltage[inside]) <= MOTOR.voltage * (1 + 1e-12))
    assert np.all(np.abs(found) <= MOTOR.max_current)
    assert np.all(found[:, 0] <= found[:, 1])
    # beyond the no-load speed the motor can only brake
    fast = speeds > MOTOR.voltage / MOTOR.torque_constant
    assert fast.any()
    assert np.all(found[fast, 1] < 0)
    # at rest nothing but the power stage binds: 5 A through 0.763 ohm need 3.8 V
    np.testing.assert_allclose(ranges(MOTOR, [0.0])[0], [-5.0, 5.0])


def test_a_loop_is_the_stated_pid():
    gains, period = Gains(p=3.0, i=40.0, d=0.02, ff_velocity=0.0, ff_acceleration=0.0), 4e-4
    x, e, w, f = ca.SX.sym("x", 3), ca.SX.sym("e", 2), ca.SX.sym("w"), ca.SX.sym("f")
    step = loop_step(gains, MOTOR, period, error=e, before=x, w=w, feedforward=f)
    function = ca.Function(
        "loop", [x, e, w, f], [step.current, step.saturated, step.integral, step.derivative]
    )
    rng = np.random.default_rng(3)
    errors = np.cumsum(rng.normal(0, 0.01, 200))
    current = integral = derivative = before = 0.0
    lag, delay = np.exp(-period / MOTOR.lag), gains.d / (10 * gains.p)
    for error in errors:
        found = [
            float(v) for v in function([current, integral, derivative], [error, before], 100.0, 0.3)
        ]
        # backward Euler of a filtered derivative
        derivative = (delay * derivative + gains.d * (error - before)) / (delay + period)
        demanded = gains.p * error + integral + derivative + 0.3
        current = demanded + (current - demanded) * lag
        integral += gains.i * error * period
        before = error
        assert not found[1]
        np.testing.assert_allclose(
            [found[0], *found[2:]], [current, integral, derivative], rtol=1e-12
        )


def test_an_integral_stops_where_the_current_is_cut_off():
    x, e = ca.SX.sym("x", 3), ca.SX.sym("e", 2)
    gains = Gains(p=100.0, i=1000.0, d=0.0, ff_velocity=0.0, ff_acceleration=0.0)
    step = loop_step(gains, MOTOR, 4e-4, error=e, before=x, w=ca.SX(0), feedforward=ca.SX(0))
    function = ca.Function("loop", [x, e], [step.current, step.saturated, step.integral])
    current, saturated, integral = (float(v) for v in function([5.0, 0.0, 0.0], [1.0, 1.0]))
    assert (current, saturated, integral) == (5.0, 1.0, 0.0)
    _, saturated, integral = (float(v) for v in function([5.0, 0.0, 0.0], [0.01, 0.01]))
    assert not saturated
    assert integral > 0


@pytest.mark.parametrize("counts", [64, 4096])
def test_an_encoder_rounds_to_the_nearest_increment(counts):
    a = ca.SX.sym("a")
    read = ca.Function("read", [a], [encoder(a, counts)])
    angles = np.linspace(-20, 20, 777)
    found = np.array([float(read(angle)) for angle in angles])
    increment = 2 * np.pi / counts
    assert np.abs(found - angles).max() <= increment / 2 * (1 + 1e-9)
    np.testing.assert_allclose(found / increment, np.round(found / increment), atol=1e-9)


def test_default_gains_come_from_the_plant_and_the_shipped_file_states_them(robot):
    shipped = load_controller("epos4")
    for joint in robot.joints:
        if joint.drive is None:
            continue
        electrics = electrics_of(joint, Controller())
        tuned = gains_of(joint, Controller(), electrics)
        assert gains_of(joint, shipped, electrics_of(joint, shipped)) == tuned
        k, inertia = electrics.torque_constant, joint.drive.input_inertia
        # closed on the bare motor the loop has its bandwidth and a damping ratio of 0.7
        omega = np.sqrt(k * tuned.p / inertia)
        assert omega == pytest.approx(2 * np.pi * bandwidth_of(4e-4, 1e-4))
        assert k * tuned.d / inertia == pytest.approx(2 * 0.7 * omega)
        assert tuned.ff_velocity == tuned.ff_acceleration == 0.0
        without = gains_of(joint, Controller(torque_offset=False), electrics)
        assert without.ff_acceleration * k == pytest.approx(inertia)
        given = Controller(joints={joint.name: AxisController(p=1.0)})
        assert gains_of(joint, given, electrics).p == 1.0


def test_the_default_bandwidth_leaves_its_phase_margin(robot):
    """The loop in discrete time, its gain or its delay moved until the closed loop is no longer stable."""
    period, lag = 4e-4, 1e-4
    bandwidth = bandwidth_of(period, lag)
    assert 100 < bandwidth < 200
    assert bandwidth_of(2 * period, 2 * lag) == pytest.approx(bandwidth / 2, rel=1e-6)

    def radius(delay):
        """Largest |eigenvalue| of position, speed, current, integral, filtered derivative and last error; delay: periods."""
        joint, controller = robot.joints[0], Controller()
        gains, k = gains_of(joint, controller, electrics_of(joint, controller)), 1.0
        unit = electrics_of(joint, controller).torque_constant / joint.drive.input_inertia
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
    # 30 degrees at the crossing, at 1.5 times the bandwidth, are 0.4 ms: one period of dead time uses them up
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
