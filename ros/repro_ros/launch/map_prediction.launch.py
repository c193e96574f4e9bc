"""Starts the node: ros2 launch repro_ros map_prediction.launch.py [params_file:=...] [scan:=/scan]."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PARAMETERS = Path(__file__).parents[1] / "config" / "map_prediction.yaml"


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=str(PARAMETERS), description="parameters of the node"),
            DeclareLaunchArgument("scan", default_value="scan", description="topic of the LaserScan messages"),
            Node(
                package="repro_ros",
                executable="map_prediction",
                name="map_prediction",
                output="screen",
                parameters=[LaunchConfiguration("params_file")],
                remappings=[("scan", LaunchConfiguration("scan"))],
            ),
        ]
    )
