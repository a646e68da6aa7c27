"""Bags of ROS 1 and ROS 2 as recordings, read by `rosbags` without ROS.

A bag is opened (`container`, damaged ones by `salvage`), its messages decoded (`messages`), the topics that a mapping
names (`topics`) turned into channels (`samples`, `grade`) on one clock (`clock`). `reading` puts them together.
"""
