"""Sim-to-real diagnosis: recordings in, verdict out. Uses the physics, never environments or
agents."""

from homeward.diagnosis.chain import analyse, diagnose
from homeward.diagnosis.evidence import Analysis
from homeward.diagnosis.result import Diagnosis
from homeward.logs.columns import Columns, load_columns
from homeward.logs.recordings import Recording, RecordingError, read_recording

__all__ = [
    "Analysis",
    "Columns",
    "Diagnosis",
    "Recording",
    "RecordingError",
    "analyse",
    "diagnose",
    "load_columns",
    "read_recording",
    "result",
]
