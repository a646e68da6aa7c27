"""What the doctests leave out where an extra is not installed."""

import importlib.util

collect_ignore_glob = [] if importlib.util.find_spec("cyclonedds") else ["homeward/watch/ros2/*"]
