"""The ament_python package `homeward_ros2`: `colcon build` in a workspace that has this folder."""

from setuptools import setup

NAME = "homeward_ros2"

setup(
    name=NAME,
    version="0.1.0",
    description="Passes a robot's messages to homeward in a Python environment of its own, and its advice back",
    license="MIT",
    packages=[NAME],
    package_data={NAME: ["interface.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/homeward.launch.py"]),
        (f"share/{NAME}/config", ["config/homeward.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,  # interface.json is read as a file
    entry_points={"console_scripts": [f"node = {NAME}.node:main", f"check = {NAME}.check:main"]},
)
