"""Start the controllers of the robot. {{ mark }}The hardware is that of urdf/{{ description }}."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch_ros.actions import Node


def generate_launch_description():
    """Return the nodes: hardware, description, and the spawners of both controllers."""
    share = Path(get_package_share_directory("{{ package }}"))
    description = {"robot_description": (share / "urdf/{{ description }}").read_text()}
    controllers = str(share / "config/{{ controllers }}")
    manager = Node(
        package="controller_manager",
        executable="ros2_control_node",
        parameters=[description, controllers],
        output="both",
    )
    publisher = Node(
        package="robot_state_publisher",
        executable="robot_state_publisher",
        parameters=[description],
        output="both",
    )
    states, trajectory = (
        Node(package="controller_manager", executable="spawner", arguments=[name])
        for name in ("joint_state_broadcaster", "joint_trajectory_controller")
    )
    afterwards = OnProcessExit(target_action=states, on_exit=[trajectory])
    return LaunchDescription([manager, publisher, states, RegisterEventHandler(afterwards)])
