#!/usr/bin/env python3
"""Send the plan to joint_trajectory_controller, if the arm is at its first point. {{ mark }}"""

import sys
from pathlib import Path

import rclpy
import yaml
from ament_index_python.packages import get_package_share_directory
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rosidl_runtime_py.set_message import set_message_fields
from sensor_msgs.msg import JointState

ACTION = "/joint_trajectory_controller/follow_joint_trajectory"
LARGEST_DEVIATION = 1e-4
"""Largest deviation of a joint from the first point, rad or m."""
TIMEOUT = 5.0
"""Time to wait for joint states and for the controller, s."""


def deviations(trajectory, states):
    """Return the deviation of every joint from the first point of a trajectory."""
    measured = dict(zip(states.name, states.position, strict=True))
    first = dict(zip(trajectory.joint_names, trajectory.points[0].positions, strict=True))
    return {name: abs(measured.get(name, float("inf")) - q) for name, q in first.items()}


def main():
    """Send the plan and return the exit status, 0 if the controller has executed it."""
    share = Path(get_package_share_directory("{{ package }}"))
    goal = FollowJointTrajectory.Goal()
    set_message_fields(goal, yaml.safe_load((share / "config/{{ goal }}").read_text()))
    rclpy.init()
    node = rclpy.create_node("play_plan")
    received = rclpy.task.Future()
    node.create_subscription(
        JointState,
        "/joint_states",
        lambda message: received.done() or received.set_result(message),
        1,
    )
    rclpy.spin_until_future_complete(node, received, timeout_sec=TIMEOUT)
    if not received.done():
        return "no joint states: is the launch file running?"
    far = deviations(goal.trajectory, received.result())
    if max(far.values()) > LARGEST_DEVIATION:
        return f"the arm is not at the first point of the plan: {far} (rad, m)"
    client = ActionClient(node, FollowJointTrajectory, ACTION)
    if not client.wait_for_server(timeout_sec=TIMEOUT):
        return f"no action {ACTION}"
    sent = client.send_goal_async(goal)
    rclpy.spin_until_future_complete(node, sent)
    if not sent.result().accepted:
        return "the controller rejected the plan"
    done = sent.result().get_result_async()
    rclpy.spin_until_future_complete(node, done)
    result = done.result().result
    return (
        0 if result.error_code == FollowJointTrajectory.Result.SUCCESSFUL else result.error_string
    )


if __name__ == "__main__":
    sys.exit(main())
