"""How the time and memory of a diagnosis grow with the recording: 0.1, 1 and 10 million samples at 10 Hz.

    python benchmarks/long_recordings.py

Each length is diagnosed in a process of its own, whose peak memory holds recording, diagnosis and all of Python.
A Husky drives with turning concealed; the drive is repeated to the length.
"""

from __future__ import annotations

import dataclasses
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own

import homeward
from homeward.diagnosis import Recording, analyse
from homeward.diagnosis.synthetic import record
from homeward.physics import load_robot

SAMPLES = (100_000, 1_000_000, 10_000_000)
STEP_S = 0.1


def main() -> None:
    """Diagnose each length and print seconds, memory and what was named."""
    table = Table(title=f"homeward {homeward.__version__}: one recording at 10 Hz (asked for: linear, 10 M below 4 GB)")
    for column in ("samples", "seconds", "seconds per million", "peak memory", "named"):
        table.add_column(column, justify="right")
    for samples in SAMPLES:
        told = subprocess.run([sys.executable, __file__, str(samples)], capture_output=True, text=True, check=True)
        found = json.loads(told.stdout)
        table.add_row(
            f"{samples:,}",
            f"{found['seconds']:.1f}",
            f"{found['seconds'] / samples * 1e6:.1f}",
            f"{found['peak_bytes'] / 1e9:.2f} GB",
            ", ".join(found["named"]),
        )
    Console().print(table)


def measure(samples: int) -> None:
    """Diagnose one length and print the figures as JSON."""
    robot = load_robot("husky")
    drive = record(dataclasses.replace(robot, effects={"turning": {"scrub": 0.3}}), 0)
    channels = {str(name): np.resize(drive[name].to_numpy(dtype=float), samples) for name in drive}
    channels["time_s"] = STEP_S * np.arange(samples)
    start = time.perf_counter()
    diagnosis = analyse([Recording("long.csv", "", channels)], robot).diagnosis
    found = {
        "seconds": time.perf_counter() - start,
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "named": [one.effect for one in diagnosis.missing_physics],
    }
    print(json.dumps(found))


if __name__ == "__main__":
    measure(int(sys.argv[1])) if len(sys.argv) > 1 else main()
