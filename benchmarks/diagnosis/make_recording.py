"""Make the synthetic recording that ships with the project.

`python benchmarks/diagnosis/make_recording.py` writes homeward/recordings/synthetic_husky.csv.gz: eight minutes of a
Husky that differs from the preset `husky`: its rolling resistance is 15 % higher, and its wheels scrub in turns, which
the preset omits. The physics is the project's own kernel; the noise is separate: a slow drift of the load, a ripple of
the current, and the noise and resolution of the sensors.
"""

from __future__ import annotations

import dataclasses
import gzip
from pathlib import Path

import pandas as pd

from homeward.physics import Robot, load_robot
from homeward.synthetic import record

TARGET = Path(__file__).parents[2] / "homeward" / "recordings" / "synthetic_husky.csv.gz"


def true_robot() -> Robot:
    """The true robot: the preset with more rolling resistance and with turning scrub."""
    husky = load_robot("husky")
    return dataclasses.replace(
        husky, rolling_resistance=1.15 * husky.rolling_resistance, effects={"turning": {"scrub": 0.3}}
    )


def packed(table: pd.DataFrame) -> bytes:
    """The table as a reproducible gzip file."""
    return gzip.compress(table.to_csv(index=False).encode(), mtime=0)


if __name__ == "__main__":
    TARGET.write_bytes(packed(record(true_robot())))
    print(f"{TARGET}: {TARGET.stat().st_size / 1000:.0f} kB")
