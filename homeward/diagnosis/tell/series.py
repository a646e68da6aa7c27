"""Time series of recorded and predicted power: Parquet for data frames, MCAP for PlotJuggler and Foxglove."""

import re
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from homeward.diagnosis.evidence import Evidence
from homeward.layout.notation import labels

PARQUET, MCAP = "series.parquet", "series.mcap"
"""Names of the files."""

_MODELS = ("nominal", "refit", "corrected", "file")
_TYPE = "homeward_msgs/msg/Series"


def series(evidence: Evidence) -> pd.DataFrame:
    """Recorded and predicted battery power, W, or motor current, A, a row for each window of the diagnosis.

    Returns:
        `run`, a path; `time_s`, since 1970 where the recording has it, else as recorded; `measured_w`; and for each arm
        that there is of nominal, refit, corrected and file `ARM_w`, its held-out prediction, and
        `residual_ARM_w`, measured less predicted. Of motor current the columns end in `_a`. Their errors are those of
        the arms in diagnosis.json.
    """
    runs, unit = evidence.runs, evidence.runs.unit.lower()
    names = [name.encode("utf-8", "replace").decode() for name in runs.names]
    start_s = np.array([run.start_s for run in runs.signals])
    arms = {name: evidence.predictions[name] for name in _MODELS if name in evidence.predictions}
    return pd.DataFrame(
        {"run": np.array(names)[runs.run], "time_s": runs.time_s + start_s[runs.run], f"measured_{unit}": runs.observed}
        | {f"{name}_{unit}": predicted for name, predicted in arms.items()}
        | {f"residual_{name}_{unit}": runs.observed - predicted for name, predicted in arms.items()}
    )


def mcap(table: pd.DataFrame) -> bytes | None:
    """Content of an MCAP file: a topic for each run, with a field for each column in messages as ROS 2 has them.

    None where `rosbags` is not installed.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        return None
    fields = list(table.columns[2:])
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("".join(f"float64 {name}\n" for name in fields), _TYPE))
    message = store.types[_TYPE]
    short = labels(list(table["run"].unique()))
    with tempfile.TemporaryDirectory() as folder:
        with Writer(Path(folder) / "series", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            for number, (name, of_run) in enumerate(table.groupby("run", sort=False), start=1):
                topic = f"/run{number}_" + re.sub(r"\W", "_", short[str(name)], flags=re.ASCII)
                connection = writer.add_connection(topic, _TYPE, typestore=store)
                time_s = of_run["time_s"] - min(float(of_run["time_s"].min()), 0.0)  # MCAP has no times before 1970
                for at_s, row in zip(time_s, of_run[fields].itertuples(index=False), strict=True):
                    writer.write(connection, round(at_s * 1e9), store.serialize_cdr(message(*row), _TYPE))
        (file,) = Path(folder).rglob("*.mcap")
        return file.read_bytes()
