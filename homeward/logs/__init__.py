"""Logs of robots (tables, ROS bags, flight logs) as recordings: named channels in SI units on one
clock."""

from homeward.logs.columns import Columns, RecordingError, load_columns
from homeward.logs.recordings import Recording, read_recording

__all__ = ["Columns", "Recording", "RecordingError", "load_columns", "read_recording"]
