"""Kernels' formulas in plain Python: fast enough where one robot asks now and then, and nothing is
compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class PlainRecord(np.record):  # type: ignore[misc] # NumPy's types call the base final; NumPy itself derives from it
    """A record as formulas expect it: fields are attributes and, as in compiled code, single
    precision only stores."""

    def __getattribute__(self, name: str) -> Any:
        value = super().__getattribute__(name)
        if isinstance(value, np.float32):
            return float(value)
        return value


def plain(records: NDArray[np.void]) -> NDArray[Any]:
    """The same records, in the same memory, as `PlainRecord`."""
    return records.view(np.dtype((PlainRecord, records.dtype)))
