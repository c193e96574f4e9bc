"""The ROS 2 package: an executable, a launch file and parameters for the node of the library."""

from glob import glob
from xml.etree import ElementTree

from setuptools import setup

package = ElementTree.parse("package.xml").getroot()
name = package.findtext("name")
setup(
    name=name,
    version=package.findtext("version"),
    packages=[],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
        (f"share/{name}/launch", glob("launch/*")),
        (f"share/{name}/config", glob("config/*")),
    ],
    entry_points={"console_scripts": ["map_prediction = repro.ros.ros2_node:main"]},
)
