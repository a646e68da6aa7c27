"""Logs of autopilots for the tests, written by `pyulog` and `pymavlink`: real files of the real
formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.DFReader import DFFormat, DFMessage
from pyulog import ULog

Array = NDArray[np.float64]
Values = Mapping[str, Any]

BOOT_US = 41_250_000  # since the start of the autopilot, at the first sample
# of ArduPilot 4.5, as its LogStructure.h and Rover/Log.cpp have them: format, labels, units
LAYOUTS = {
    "BAT": ("QBfffffcf", "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res", "s#vvAaXOw"),
    "THR": ("Qhffff", "TimeUS,ThrIn,ThrOut,DesSpeed,Speed,AccY", "s--nno"),
    "STER": ("Qhfffff", "TimeUS,SteerIn,SteerOut,DesLatAcc,LatAcc,DesTurnRate,TurnRate", "s--ookk"),
    "ATT": (
        "QccccCCCCB",
        "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF",
        "sddddhhdh-",
    ),
    "POS": ("QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "sDUmmm"),
    "GPS": (
        "QBBIHBcLLeffffB",
        "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
        "s#-s-S-DUmnhnh-",
    ),
}


def write_ulog(path: Path, messages: Mapping[str, tuple[Array, Values]]) -> Path:
    """Write messages of PX4, each with its times since the first sample in s, and an array or
    number for each field.

    A name may end in `#1` for the second instance.
    """
    log = ULog(None)
    log._start_timestamp = BOOT_US
    for number, (name, (time_s, values)) in enumerate(messages.items()):
        kind, _, instance = name.partition("#")
        fields = [
            ("uint64_t", "timestamp"),
            *((_kind(one), field) for field, one in values.items()),
        ]
        whole = [ULog._FieldData(field, kind) for kind, field in fields]
        log._message_formats[kind] = SimpleNamespace(
            name=kind, fields=[(kind, 0, field) for kind, field in fields]
        )
        data = {"timestamp": BOOT_US + np.round(time_s * 1e6).astype(np.uint64)}
        data |= {field: np.broadcast_to(one, len(time_s)) for field, one in values.items()}
        log._data_list.append(
            SimpleNamespace(
                name=kind, multi_id=int(instance or 0), msg_id=number, field_data=whole, data=data
            )
        )
    log.write_ulog(str(path))
    return path


def _kind(values: Any) -> str:
    return "bool" if np.asarray(values).dtype == np.bool_ else "float"


def write_dataflash(path: Path, messages: Sequence[tuple[str, Array, Values]]) -> Path:
    """Write messages of ArduPilot: name, times since the first sample in s, and fields; 0 where
    left out."""
    of_formats = DFFormat(128, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")
    of_units = DFFormat(129, "FMTU", 44, "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    layouts = {name: _layout(130 + i, name) for i, name in enumerate(LAYOUTS)}
    head, body = [], []
    for one in (of_formats, of_units, *layouts.values()):
        head.append(
            _bytes(of_formats, [one.type, one.len, one.name, one.format, ",".join(one.columns)])
        )
    for name, one in layouts.items():
        head.append(_bytes(of_units, [0, one.type, LAYOUTS[name][2], "-" * len(one.columns)]))
    for name, time_s, values in messages:
        layout = layouts[name]
        for index, at_s in enumerate(time_s):
            row = {
                field: np.broadcast_to(one, len(time_s))[index].item()
                for field, one in values.items()
            }
            row["TimeUS"] = BOOT_US + round(at_s * 1e6)
            body.append(
                (row["TimeUS"], _bytes(layout, [row.get(column, 0) for column in layout.columns]))
            )
    body.sort(key=lambda one: one[0])
    path.write_bytes(b"".join([*head, *(one for _, one in body)]))
    return path


def _layout(number: int, name: str) -> DFFormat:
    form, labels, _ = LAYOUTS[name]
    layout = DFFormat(number, name, 0, form, labels)
    layout.len = 3 + np.dtype([(str(i), one) for i, one in enumerate(_struct(layout))]).itemsize
    return layout


def _struct(layout: DFFormat) -> list[str]:
    return [{"Q": "<u8", "B": "u1", "b": "i1", "h": "<i2", "H": "<u2", "I": "<u4", "i": "<i4", "f": "<f4"}[one]
            for one in layout.msg_struct[1:]]  # fmt: skip


def _bytes(layout: DFFormat, values: Sequence[Any]) -> bytes:
    elements = [
        one if multiplier is None else round(one / multiplier)
        for one, multiplier in zip(values, layout.msg_mults, strict=True)
    ]
    written: bytes = DFMessage(layout, elements, True, None).get_msgbuf()
    return written
