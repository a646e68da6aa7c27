"""What processes of the tests share, and what the doctests leave out where an extra is not
installed."""

import importlib.util
import os
import sys

# Before numpy is imported: tests run side by side, and threads of small products would wait for
# each other in a loop.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Whatever the environment says, bytecode is kept: without it pytest rewrites the assertions of all
# tests again in each process, which takes six to eight seconds of CPU.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

collect_ignore_glob = [] if importlib.util.find_spec("cyclonedds") else ["homeward/watch/ros2/*"]
