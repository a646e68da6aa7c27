"""Logs of robots, tables, ROS bags and flight logs, as recordings: channels by name, in SI units, over one clock."""

from homeward.logs.columns import Columns, RecordingError, load_columns
from homeward.logs.recordings import Recording, read_recording

__all__ = ["Columns", "Recording", "RecordingError", "load_columns", "read_recording"]
