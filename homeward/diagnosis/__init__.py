"""Sim-to-real diagnosis: recordings in, verdict out. Uses the physics, never environments or agents."""

from homeward.diagnosis.chain import analyse, diagnose
from homeward.diagnosis.evidence import Analysis
from homeward.diagnosis.read.columns import Columns, load_columns
from homeward.diagnosis.read.recordings import Recording, RecordingError, read_recording
from homeward.diagnosis.result import Diagnosis

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
]
