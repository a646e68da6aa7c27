"""Starts the node:
`ros2 launch homeward_ros2 homeward.launch.py robot:=/etc/robot/corrected.toml`."""

from __future__ import annotations

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "homeward": ("homeward", "command of the environment that homeward is installed in"),
    "robot": ("", "preset or robot file, such as the corrected.toml of a diagnosis"),
    "topics_below": ("", "subscribe only to topics below this, and publish the advice below it"),
    "state": ("", "file of the state for a start of this node"),
}


def generate_launch_description() -> LaunchDescription:
    """The node with the parameters of config/homeward.yaml, or another file, and those given
    here."""
    defaults = os.path.join(get_package_share_directory("homeward_ros2"), "config", "homeward.yaml")
    declared = [
        DeclareLaunchArgument(
            "parameters", default_value=defaults, description="file of parameters"
        )
    ]
    declared += [
        DeclareLaunchArgument(name, default_value=default, description=about)
        for name, (default, about) in ARGUMENTS.items()
    ]
    given = {name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in ARGUMENTS}
    node = Node(
        package="homeward_ros2",
        executable="node",
        name="homeward",
        output="screen",
        respawn=True,
        respawn_delay=5.0,
        parameters=[LaunchConfiguration("parameters"), given],
    )
    return LaunchDescription([*declared, node])
