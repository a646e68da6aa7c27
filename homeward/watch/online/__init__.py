"""A robot advised as it drives: messages in, advice out, whatever carries them.

A mapping selects fields of messages as readings (`listener`), on a continuous clock (`stamps`) and
in a continuous frame (`odometry`), whatever the publishers do; units are doubted as those of files
are (`doubted`). `node` runs the companion between a `link.Link` and the robot; `session` shows and
saves; `texts` says what has changed. Links are a ROS 2 network (`homeward.watch.ros2`), MAVLink
(`homeward.watch.mavlink`) and another process (`lines`).
"""
