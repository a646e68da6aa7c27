"""Time series of recorded and predicted power: Parquet for data frames, MCAP for PlotJuggler and
Foxglove."""

import re
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from homeward.diagnosis.evidence import Evidence
from homeward.layout.notation import labels

PARQUET = "series.parquet"
"""Name of the file for data frames."""

MCAP = "series.mcap"
"""Name of the file for PlotJuggler and Foxglove."""

_MODELS = ("nominal", "refit", "corrected", "file")
_TYPE = "homeward_msgs/msg/Series"


def series(evidence: Evidence) -> pd.DataFrame:
    """Recorded and predicted battery power, W, or motor current, A, a row for each window of the
    diagnosis.

    Returns:
        `run`, a path; `time_s`, since 1970 where the recording has it, else as recorded;
        `measured_w`; and for each arm that there is of nominal, refit, corrected and file `ARM_w`,
        its held-out prediction, and `residual_ARM_w`, measured less predicted. Of motor current the
        columns end in `_a`. Their errors are those of the arms in diagnosis.json.
    """
    runs = evidence.runs
    unit = runs.unit.lower()
    names = np.array([name.encode("utf-8", "replace").decode() for name in runs.names])
    start_s = np.array([run.start_s for run in runs.signals])
    arms = {name: evidence.predictions[name] for name in _MODELS if name in evidence.predictions}
    columns = {
        "run": names[runs.run],
        "time_s": runs.time_s + start_s[runs.run],
        f"measured_{unit}": runs.observed,
    }
    columns |= {f"{name}_{unit}": predicted for name, predicted in arms.items()}
    columns |= {
        f"residual_{name}_{unit}": runs.observed - predicted for name, predicted in arms.items()
    }
    return pd.DataFrame(columns)


def mcap(table: pd.DataFrame) -> bytes | None:
    """Content of an MCAP file: a topic for each run, with a field for each column in messages as
    ROS 2 has them.

    None where `rosbags` is not installed.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        return None
    fields = list(table.columns[2:])
    definition = "".join(f"float64 {name}\n" for name in fields)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, _TYPE))
    message = store.types[_TYPE]
    short_names = labels(list(table["run"].unique()))
    with tempfile.TemporaryDirectory() as folder:
        with Writer(
            Path(folder) / "series", version=9, storage_plugin=StoragePlugin.MCAP
        ) as writer:
            for number, (name, rows) in enumerate(table.groupby("run", sort=False), start=1):
                word = re.sub(r"\W", "_", short_names[str(name)], flags=re.ASCII)
                connection = writer.add_connection(f"/run{number}_{word}", _TYPE, typestore=store)
                start_s = float(rows["time_s"].min())
                times_s = rows["time_s"] - min(start_s, 0.0)  # MCAP has no times before 1970
                for time_s, values in zip(
                    times_s, rows[fields].itertuples(index=False), strict=True
                ):
                    time_ns = round(time_s * 1e9)
                    writer.write(connection, time_ns, store.serialize_cdr(message(*values), _TYPE))
        (file,) = Path(folder).rglob("*.mcap")
        return file.read_bytes()
