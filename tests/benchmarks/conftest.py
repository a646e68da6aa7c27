"""Puts benchmarks/ where its own scripts find it, so that `plants` is imported here as it is there."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
