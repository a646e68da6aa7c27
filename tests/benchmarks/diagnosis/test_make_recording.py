"""The recording that ships is what its script makes."""

import gzip
import io

import numpy as np
import pandas as pd

from benchmarks.diagnosis.make_recording import packed, true_robot
from homeward.datasets import shipped_recording
from homeward.synthetic import RESOLUTION, record


def test_the_shipped_recording_is_what_its_script_makes() -> None:
    made = pd.read_csv(io.BytesIO(gzip.decompress(packed(record(true_robot())))))
    shipped = pd.read_csv(shipped_recording())
    assert list(made) == list(shipped) == list(RESOLUTION)
    for name, decimals in RESOLUTION.items():  # to the last digit, which another processor may round otherwise
        error = np.abs(shipped[name] - made[name]).max()
        assert error < 1.5 * 10.0**-decimals, f"{name}: run `python benchmarks/diagnosis/make_recording.py`"
