"""Small files that would take gigabytes or never end are refused; memory is measured in a process
of its own."""

from __future__ import annotations

import bz2
import gzip
import json
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from homeward.logs.limits import MOST_CHUNK_BYTES, MOST_TOPICS, Allowance, TooLarge

pytest.importorskip("rosbags")

import lz4.frame  # type: ignore[import-untyped]
import pyarrow as pa
import pyarrow.parquet as pq
from rosbags.rosbag2 import StoragePlugin, Writer

from homeward.logs.limits import zstd_module
from tests.logs.bag_writer import Stream, write_bag

MOST_MB, LONGEST_S = 400, 10.0
zstd = zstd_module()
ZEROS = bytes(2**26 + 1)
ODOMETRY = "nav_msgs/msg/Odometry"
TEXT = struct.Struct("<I").pack

READ = """
import json, sys, time
from pathlib import Path
from homeward.envs.routes import load_route
from homeward.logs.recordings import read_recording
import homeward.envs.routes.tracks, homeward.logs.bags.assemble, pyulog, scipy.ndimage, scipy.optimize
def mb():
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) / 1024
ended = {}
for path in sys.argv[1:]:
    began, before = time.monotonic(), mb()
    try:
        load_route(path, 5.0) if "track" in path else read_recording(path)
        said = "read"
    except ValueError as error:
        said = str(error)
    ended[path] = said, time.monotonic() - began, mb() - before
print(json.dumps(ended))
"""


def text(words: str) -> bytes:
    return TEXT(len(words.encode())) + words.encode()


def record(kind: int, content: bytes) -> bytes:
    return bytes([kind]) + struct.pack("<Q", len(content)) + content


def mcap(*records: bytes) -> bytes:
    magic = b"\x89MCAP0\r\n"
    ends = record(15, bytes(4)), record(2, bytes(20))
    return b"".join([magic, record(1, text("ros2") + text("test")), *records, *ends, magic])


def packed(compression: str, content: bytes, size: int = len(ZEROS)) -> bytes:
    """A chunk of an MCAP file."""
    head = struct.pack("<QQQI", 1, 1, size, 0) + text(compression)
    return record(6, head + struct.pack("<Q", len(content)) + content)


def odometry(definition: str) -> list[bytes]:
    """A topic with a definition of its own, and a message of it."""
    schema = record(3, struct.pack("<H", 1) + text(ODOMETRY) + text("ros2msg") + text(definition))
    channel = record(4, struct.pack("<HH", 1, 1) + text("/odom") + text("cdr") + bytes(4))
    return [schema, channel, record(5, struct.pack("<HIQQ", 1, 1, 1, 1) + b"\0\1\0\0" + bytes(64))]


def chunks_of_zstd(folder: Path) -> Path:
    path = folder / "zstd.mcap"
    path.write_bytes(mcap(*[packed("zstd", zstd.compress(ZEROS))] * 20))
    return path


def a_chunk_of_lz4(folder: Path) -> Path:
    path = folder / "lz4.mcap"
    path.write_bytes(mcap(packed("lz4", lz4.frame.compress(ZEROS * 5), 5 * len(ZEROS))))
    return path


def a_chunk_of_bz2(folder: Path) -> Path:
    streams = {"/odom": Stream(ODOMETRY, np.arange(9.0), {})}
    path = write_bag(folder / "bz2", "ros1", streams)
    bag = path.read_bytes()
    first = 13 + 4096  # behind the head, which is padded
    fields = (b"op=\x05", b"compression=bz2", b"size=\xff\xff\xff\x7f")
    head = b"".join(TEXT(len(one)) + one for one in fields)
    content = bz2.compress(ZEROS)
    path.write_bytes(
        bag[:first] + TEXT(len(head)) + head + TEXT(len(content)) + content + bag[first:]
    )
    return path


def a_whole_file(folder: Path) -> Path:
    path = write_bag(
        folder / "file", "mcap", {"/odom": Stream(ODOMETRY, np.arange(9.0), {})}, "file"
    )
    (file,) = path.glob("*.zstd")
    file.write_bytes(zstd.compress(ZEROS))
    return path


def a_message(folder: Path) -> Path:
    path = folder / "message"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(
            writer.add_connection("/odom", ODOMETRY, msgdef="float64 x", rihs01="RIHS01_0"),
            1,
            zstd.compress(ZEROS),
        )
    about = path / "metadata.yaml"
    about.write_text(about.read_text().replace("compression_format: ''", "compression_format: zstd")
                     .replace("compression_mode: ''", "compression_mode: MESSAGE"))  # fmt: skip
    return path


def topics(folder: Path) -> Path:
    path = folder / "topics.mcap"
    channels = (
        record(4, struct.pack("<HH", i, 0) + text(f"/{i}") + text("cdr") + bytes(4))
        for i in range(60_000)
    )
    path.write_bytes(mcap(*channels))
    return path


def a_long_array(folder: Path) -> Path:
    path = folder / "array.mcap"
    path.write_bytes(mcap(*odometry("E[2000000000] x\n" + "=" * 80 + "\nMSG: nav_msgs/E\n")))
    return path


def a_list_of_nothing(folder: Path) -> Path:
    path = folder / "list.mcap"
    path.write_bytes(mcap(*odometry("E[] x\n" + "=" * 80 + "\nMSG: nav_msgs/E\n")))
    return path


def fields_of_fields(folder: Path) -> Path:
    def message(kind: str, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), ord(kind)) + content

    formats = [f"a{i}:a{i + 1}[10] x;" for i in range(12)] + [
        "a12:float x;",
        "battery_status:uint64_t timestamp;a0 x;",
    ]
    added = (
        message("A", struct.pack("<BH", 0, 0) + b"battery_status"),
        message("D", struct.pack("<HQ", 0, 5)),
    )
    path = folder / "fields.ulg"
    definitions = (message("F", one.encode()) for one in formats)
    path.write_bytes(
        b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1) + b"".join([*definitions, *added])
    )
    return path


def a_text_in_each_row(folder: Path) -> Path:
    path = folder / "text.parquet"
    rows = 65_536
    times = pa.DictionaryArray.from_arrays(
        pa.array(np.zeros(rows, np.int32)), pa.array(["x" * 200_000])
    )
    numbers = np.ones(rows)
    pq.write_table(
        pa.table({"time_s": times, "speed_mps": numbers, "power_w": numbers}),
        path,
        store_schema=False,
    )
    return path


def empty_cells(folder: Path) -> Path:
    path = folder / "cells.csv.gz"
    names = ",".join(["time_s", "speed_mps", "power_w", *(str(i) for i in range(9000))])
    row = b"1,1,1" + b"," * 9000 + b"\n"
    path.write_bytes(gzip.compress(names.encode() + b"\n" + row * 4000, 1))
    return path


def a_track_to_and_fro(folder: Path) -> Path:
    path = folder / "track.csv"
    rows = "".join(f"{47 if i % 2 else 47.889},8,4\n" for i in range(1500))
    path.write_text("lat,lon,ele\n" + rows)
    return path


SMALL: dict[Callable[[Path], Path], str] = {
    chunks_of_zstd: "unpacks to more than 67.1 MB",
    a_chunk_of_lz4: "unpacks to more than",
    a_chunk_of_bz2: "unpacks to more than 67.1 MB",
    a_whole_file: "unpacks to more than 67.1 MB",
    a_message: "unpacks to more than 67.1 MB",
    topics: f"has more than {MOST_TOPICS} topics",
    a_long_array: "a message has 2e+09 numbers",
    a_list_of_nothing: "a message has 1e+04 numbers",
    fields_of_fields: "has 1e+05 fields",
    a_text_in_each_row: "holds a text of 200000 bytes",
    empty_cells: "time_s repeats in row 2",
    a_track_to_and_fro: "km long; give a track of one drive",
}
"""Files of some kB to 2 MB, and what is said of them."""


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, float, float]]:
    """What was said of each file, the time in s and the further memory in MB, by one process for
    all."""
    if sys.platform != "linux":
        pytest.skip("the memory of a process is read as Linux gives it")
    paths = {make.__name__: str(make(tmp_path_factory.mktemp("small"))) for make in SMALL}
    done = subprocess.run(
        [sys.executable, "-c", READ, *paths.values()], capture_output=True, text=True, check=True
    )
    said = json.loads(done.stdout)
    return {name: said[path] for name, path in paths.items()}


@pytest.mark.parametrize("make", SMALL, ids=lambda make: make.__name__)
def test_a_small_file_that_would_take_gigabytes_is_refused(
    ended: dict[str, tuple[str, float, float]], make: Callable[[Path], Path]
) -> None:
    said, took_s, more_mb = ended[make.__name__]
    assert SMALL[make] in said
    assert took_s < LONGEST_S and more_mb < MOST_MB


@pytest.mark.parametrize("compression", ["bz2", "lz4", "zstd"])
def test_an_allowance_gives_a_chunk_back_and_stops_at_its_end(compression: str) -> None:
    pack = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstd.compress}[compression]
    content = np.random.default_rng(1).bytes(40_000)
    whole = pack(content)
    allowance = Allowance(1000)
    assert allowance.unpack(compression, whole + whole) == content + content  # as several frames
    with pytest.raises(EOFError):
        allowance.unpack(compression, whole[:-9])
    assert content.startswith(allowance.unpack(compression, whole[:-9], whole=False))
    with pytest.raises(TooLarge, match=r"has 0\.001 MB and unpacks to more than 67\.1 MB"):
        allowance.unpack(compression, pack(ZEROS))
    with pytest.raises(TooLarge, match="has a chunk of more than 268 MB"):
        Allowance(MOST_CHUNK_BYTES).unpack("zstd", zstd.compress(ZEROS) * 5)
