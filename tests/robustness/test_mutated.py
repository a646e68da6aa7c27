"""Real files with changed bytes and structure are read or refused, by every loader and by commands,
in time and memory.

Some of each belong to every run. `HOMEWARD_MUTATIONS=10000 pytest tests/robustness/test_mutated.py
--hypothesis-show-statistics` draws so many others of each, and tries ONNX networks, too; `broken`
holds what once broke, for `test_broken.py`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import gzip
import hashlib
import io
import json
import os
import re
import resource
import shutil
import signal
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from homeward.agents.trained.environment import setting_of
from homeward.agents.trained.policy_file import PolicyFileError, load_policy
from homeward.diagnosis import RecordingError, load_columns, read_recording
from homeward.envs.conditions.instruments import INSTRUMENTS, InstrumentError, load_instruments
from homeward.envs.options import OptionError
from homeward.envs.routes import RouteError, load_route
from homeward.logs.bags.topics import load_topics
from homeward.logs.propose import propose
from homeward.physics import RobotError, load_robot
from homeward.urdf import read_urdf, robot_file
from tests.command_line import ended
from tests.envs.routes.test_tracks import write_fit
from tests.logs.bag_writer import Stream, write_bag
from tests.logs.flight_writer import write_dataflash, write_ulog
from tests.test_urdf import four_wheels

ROOT = Path(__file__).parents[2]
GIVEN = os.environ.get("HOMEWARD_MUTATIONS")
SETTINGS = settings(
    max_examples=int(GIVEN or 25),
    derandomize=GIVEN is None,
    suppress_health_check=list(HealthCheck),
    print_blob=True,
)
OF_COMMANDS = settings(SETTINGS, max_examples=int(GIVEN or 15))
"""Fewer, as a command takes most of a second; every run draws the same."""
LONGEST_S = 10.0
"""Processor time that reading an input may take."""
MOST_BYTES = 10**9
"""What it may allocate."""
SPLIT = b"\n--policy--\n"
SECOND = b"\n--second--\n"
TOKENS = (
    b"", b"nan", b"-inf", b"1e400", b"-1", b"0", b"1e-320", b"9223372036854775807", b"18446744073709551616", b"\x00",
    b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\xff\xfe", b"\xef\xbb\xbf", b"[[", b"]]", b"{", b"}", b'"', b"'", b"#",
    b"\n", b"\r\n", b";", b",", b"\t", b"=", b"true", b"null", b"1979-05-27T07:32:00Z", b"[1, 2]", b'"text"', b"{}",
    b"[]", b"0x10", b"../../etc/passwd", b"9" * 400, "é".encode("latin-1"), "🤖".encode(), b"\x1b[31m", b"[red]",
    b"time_s", b"." * 50,
)  # fmt: skip
"""What readers may stumble over."""


@dataclass(frozen=True)
class Loader:
    """What is read: by what, the ending of its files, the errors that it may refuse with, and real
    files."""

    read: Callable[[Path], Any]
    suffix: str
    refusals: tuple[type[Exception], ...]
    files: Callable[[], list[bytes]]


def rows(head: str, row: Callable[[int], str], count: int = 40) -> bytes:
    """A table of text."""
    return "\n".join([head, *map(row, range(count)), ""]).encode()


def files(pattern: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted(ROOT.glob(pattern))]


def routes() -> list[bytes]:
    track = rows("lat,lon,ele", lambda i: f"{45 + i * 1e-4:.5f},{7 + i * 1e-5:.5f},{100 + i % 7}")
    return [*files("homeward/routes/*.csv"), track]


def tracks() -> list[bytes]:
    points = "".join(
        f'<trkpt lat="{45 + i * 1e-4:.5f}" lon="7.0"><ele>{100 + i % 7}</ele></trkpt>'
        for i in range(40)
    )
    head = '<?xml version="1.0"?><gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">'
    return [f"{head}<trk><trkseg>{points}</trkseg></trk></gpx>".encode()]


def tables() -> list[bytes]:
    """Recordings as programs of several kinds and countries write them."""
    packed = (ROOT / "homeward" / "recordings" / "synthetic_husky.csv.gz").read_bytes()
    plain = b"".join(gzip.decompress(packed).splitlines(keepends=True)[:60])
    epoch = rows(
        "time_s,speed_mps,voltage_v,current_a", lambda i: f"{1714564800000 + 100 * i},0.5,24.5,3"
    )
    dates = rows(
        "time_s,wheel_left_mps,wheel_right_mps,power_w",
        lambda i: f"2024-05-01T12:00:{i:02d}Z,0.5,0.6,90",
    )
    german = rows("time_s;speed_mps;power_w", lambda i: f"01.05.2024 12:00:{i:02d},0;0,5;90,1")
    return [
        plain,
        plain.replace(b",", b";").replace(b".", b","),
        epoch,
        dates,
        german,
        plain.decode().encode("utf-16"),
    ]


def foreign() -> list[bytes]:
    return [rows("time,curL,curR,velL,velR", lambda i: f"{i / 10:.2f},1.5,1.4,0.5,0.5", 60)]


def vesc_tool() -> list[bytes]:
    names = "ms_today;input_voltage;current_motor;current_in_setup;speed_meters_per_sec;num_vescs;"
    return [rows(names, lambda i: f"{68209883 + 50 * i};38.1;20.5;4.1;{1.5 - 0.01 * i:.2f};2;", 60)]


def parquet() -> list[bytes]:
    frame = pd.read_csv(io.BytesIO(tables()[0]))
    return [frame.to_parquet(compression=how) for how in ("snappy", "zstd", None)]


def logs(form: str) -> list[bytes]:
    """Bags and logs of autopilots, some seconds long."""
    t = np.arange(0.0, 8.0, 0.5)
    speed, current = 0.5 + 0.1 * np.sin(t), 3.0 + t
    position = {
        "vx": speed,
        "vy": 0.0,
        "z": 1.0,
        "heading": 0.0,
        "v_xy_valid": True,
        "z_valid": True,
    }
    px4 = {
        "battery_status": {"voltage_v": 24.0, "current_a": current, "remaining": 0.9},
        "vehicle_local_position": position,
        "vehicle_attitude": {f"q[{i}]": float(i == 0) for i in range(4)},
    }
    ardupilot = {
        "BAT": {"Volt": 24.0, "Curr": current},
        "THR": {"Speed": speed},
        "ATT": {"Pitch": speed},
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if form == "ulg":
            return [
                write_ulog(
                    folder / "run.ulg", {of: (t, one) for of, one in px4.items()}
                ).read_bytes()
            ]
        if form == "bin":
            return [
                write_dataflash(
                    folder / "run.bin", [(of, t, one) for of, one in ardupilot.items()]
                ).read_bytes()
            ]
        streams = {
            "/odom": Stream("nav_msgs/msg/Odometry", t, {"twist.twist.linear.x": speed}),
            "/battery": Stream(
                "sensor_msgs/msg/BatteryState", t, {"voltage": 24.0, "current": -current}
            ),
        }
        for compression in {"ros1": ("", "lz4"), "mcap": ("", "storage"), "sqlite3": ("",)}[form]:
            write_bag(folder / f"{form}{compression}", form, streams, compression)
        return [
            one.read_bytes()
            for one in sorted(folder.rglob("*"))
            if one.suffix in (".bag", ".mcap", ".db3")
        ]


def two_packs() -> list[bytes]:
    """A bag of a robot with packs in parallel and their sum, each a topic."""
    t = np.arange(0.0, 8.0, 0.5)
    streams = {
        "/odom": Stream("nav_msgs/msg/Odometry", t, {"twist.twist.linear.x": 0.5 + 0.1 * np.sin(t)})
    }
    for name, share in {"_1": 0.5, "_2": 0.5, "": 1.0}.items():
        readings = {"voltage": 24.0, "current": -share * (3.0 + t)}
        streams[f"/battery{name}"] = Stream("sensor_msgs/msg/BatteryState", t, readings)
    with tempfile.TemporaryDirectory() as name:
        bag = write_bag(Path(name), "mcap", streams, "storage")
        return [next(bag.glob("*.mcap")).read_bytes()]


def sparse() -> list[bytes]:
    """A row for each message, as PlotJuggler writes them."""

    def row(i: int) -> str:
        return f"{i / 5:.2f},{0.5 + 0.01 * i:.2f},," if i % 2 else f"{i / 5:.2f},,24.5,{3 + i % 3}"

    return [rows("time_s,speed_mps,voltage_v,current_a", row, 60)]


def echoes() -> list[bytes]:
    """Two tables of one run in one, as `ros2 topic echo --csv` writes them."""
    covariance = ",".join(["0.0"] * 36)
    pose = f"odom,base_link,0.0,0.0,0.0,0.0,0.0,0.0,1.0,{covariance}"
    odometry = [f"{100 + i},0,{pose},0.5,0.0,0.0,0.0,0.0,0.1,{covariance}" for i in range(40)]
    battery = [
        f"{100 + i},500000000,,24.0,nan,-{3 + i % 3},nan,nan,nan,0.8,2,0,0,True" for i in range(40)
    ]
    return [SECOND.join("\n".join(lines).encode() for lines in (odometry, battery))]


def joined() -> list[bytes]:
    """Two tables of one run in one, with names."""
    motion = rows("time_s,speed_mps", lambda i: f"{i / 5:.2f},{0.5 + i % 3}")
    return [
        SECOND.join((motion, rows("time_s,power_w", lambda i: f"{i / 5 + 0.05:.2f},{90 + i % 7}")))
    ]


def two_tables(path: Path) -> str:
    """The name of both tables of a file, as files of their own."""
    contents = path.read_bytes().partition(SECOND)
    paths = [path.with_name("first.csv"), path.with_name("second.csv")]
    for table, content in zip(paths, contents[::2], strict=True):
        table.write_bytes(content)
    return "+".join(map(str, paths))


def segments() -> list[bytes]:
    """A GPX track without heights, of segments of which one repeats the others."""
    head = '<?xml version="1.0"?><gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><trk>'
    points = [f'<trkpt lat="{45 + i * 1e-4:.5f}" lon="7.0"></trkpt>' for i in range(40)]
    parts = ["".join(part) for part in (points[:20], points[:35], points[35:])]
    body = "".join(f"<trkseg>{part}</trkseg>" for part in parts)
    return [f"{head}{body}</trk></gpx>".encode()]


def fit() -> list[bytes]:
    distance_m = np.linspace(0.0, 500.0, 40)
    with tempfile.TemporaryDirectory() as name:
        return [
            write_fit(
                Path(name) / "a.fit", distance_m, 100.0 + np.sin(distance_m / 50.0)
            ).read_bytes()
        ]


def networks() -> list[bytes]:
    """An ONNX network with its environment."""
    from homeward.agents.trained.onnx_export import Args, main

    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        path = Path(name) / "a.onnx"
        main(Args(ROOT / "agents" / "policies" / "OutAndBack_scratch", path))
        return [path.read_bytes()]


def read_network(path: Path) -> object:
    from homeward.agents.trained.onnx_policy import load_onnx

    return load_onnx(path)


def policies() -> list[bytes]:
    """Both files of a policy in one, the description first."""
    folders = [path.parent for path in sorted((ROOT / "agents" / "policies").glob("*/policy.json"))]
    return [
        SPLIT.join((one / f"policy.{end}").read_bytes() for end in ("json", "safetensors"))
        for one in folders
    ]


def policy_folder(path: Path) -> Path:
    """A folder with the two files; the hash is set right where it can be, or hardly any would be
    looked into."""
    description, _, weights = path.read_bytes().partition(SPLIT)
    folder = path.with_name("policy")
    folder.mkdir(exist_ok=True)
    digest = hashlib.sha256(weights).hexdigest().encode()
    description = re.sub(
        rb'("weights_sha256": ")[0-9a-f]{64}"', rb"\g<1>" + digest + b'"', description
    )
    (folder / "policy.json").write_bytes(description)
    (folder / "policy.safetensors").write_bytes(weights)
    return folder


def instruments() -> list[bytes]:
    every = map(dataclasses.asdict, INSTRUMENTS.values())
    return [
        "".join(f"{name} = {json.dumps(value)}\n" for name, value in one.items()).encode()
        for one in every
    ]


def coasted() -> list[bytes]:
    """A robot file with a coast-down test."""
    lines = load_robot("husky").to_toml().splitlines()
    kept = [
        line for line in lines if not line.startswith(("rolling_resistance", "drag_ns2_per_m2"))
    ]
    table = "[coast_down]\na_n = 30.0\na_sd_n = 0.6\nb_ns_per_m = 4.0\nc_ns2_per_m2 = 0.5\nmass_sd_kg = 0.5\n"
    return ["\n".join([*kept, table]).encode()]


RECORDING = (RecordingError,)
LOADERS = {
    "robot": Loader(load_robot, ".toml", (RobotError,), lambda: files("homeward/robots/*.toml")),
    "coast-down test": Loader(load_robot, ".toml", (RobotError,), coasted),
    "urdf": Loader(lambda path: robot_file(read_urdf(path)), ".urdf", (RobotError,), lambda: [four_wheels().encode()]),
    "route": Loader(lambda path: load_route(path, 5.0), ".csv", (RouteError,), routes),
    "track": Loader(lambda path: load_route(path, 5.0), ".gpx", (RouteError,), tracks),
    "recording": Loader(read_recording, ".csv", RECORDING, tables),
    "packed recording": Loader(
        read_recording, ".csv.gz", RECORDING, lambda: [gzip.compress(one, mtime=0) for one in tables()]
    ),
    "mapped recording": Loader(lambda path: read_recording(path, "husky_borealtc"), ".csv", RECORDING, foreign),
    "recording without a header": Loader(
        lambda path: read_recording(path, "turtlebot3_tactics"), ".txt", RECORDING,
        lambda: [b"1,2.5,11.1,300,3300,11.2\n" * 40],
    ),
    "parquet": Loader(read_recording, ".parquet", RECORDING, parquet),
    "mcap": Loader(read_recording, ".mcap", RECORDING, lambda: logs("mcap")),
    "bag": Loader(read_recording, ".bag", RECORDING, lambda: logs("ros1")),
    "sqlite3": Loader(read_recording, ".db3", RECORDING, lambda: logs("sqlite3")),
    "px4": Loader(read_recording, ".ulg", RECORDING, lambda: logs("ulg")),
    "ardupilot": Loader(read_recording, ".bin", RECORDING, lambda: logs("bin")),
    "vesc tool": Loader(read_recording, ".csv", RECORDING, vesc_tool),
    "two packs": Loader(read_recording, ".mcap", RECORDING, two_packs),
    "sparse table": Loader(read_recording, ".csv", RECORDING, sparse),
    "joined tables": Loader(lambda path: read_recording(two_tables(path)), ".csv", RECORDING, joined),
    "echoed topics": Loader(
        lambda path: read_recording(two_tables(path), "ros2_echo_odometry+ros2_echo_battery"), ".csv", RECORDING, echoes
    ),
    "track of segments": Loader(lambda path: load_route(f"{path}@flat", 5.0), ".gpx", (RouteError,), segments),
    "fit": Loader(lambda path: load_route(path, 5.0), ".fit", (RouteError,), fit),
    "mapping of columns": Loader(load_columns, ".toml", RECORDING, lambda: files("homeward/logs/maps/*.toml")),
    "mapping of topics": Loader(load_topics, ".toml", RECORDING, lambda: files("homeward/logs/bags/maps/*.toml")),
    "proposal": Loader(propose, ".csv", RECORDING, lambda: [*tables(), *foreign()]),
    "policy": Loader(
        lambda path: setting_of(load_policy(policy_folder(path))), "",
        (PolicyFileError, OptionError, RobotError, RouteError), policies,
    ),
    "instruments": Loader(load_instruments, ".toml", (InstrumentError,), instruments),
}  # fmt: skip
if GIVEN:
    LOADERS["network"] = Loader(
        read_network, ".onnx", (PolicyFileError, OptionError, RobotError, RouteError), networks
    )
EVALUATE = "evaluate --agents soc50 --episodes 2 --out OUT"
COMMANDS = (
    ("robot", "range FILE --grade 3 --duty 0.5"),
    ("route", "range husky --route FILE --risk 0.01"),
    ("robot", "routes incline --robot FILE"),
    ("track", "routes FILE --robot husky"),
    ("mapped recording", "columns FILE --out OUT/proposed.toml"),
    ("recording", "diagnose FILE --robot husky --out OUT"),
    ("parquet", "diagnose FILE --robot husky --out OUT"),
    ("mcap", "diagnose FILE --robot husky --out OUT"),
    ("robot", "diagnose RUN --robot FILE --out OUT"),
    ("mapping of columns", "diagnose RUN --columns FILE --out OUT"),
    ("sqlite3", "watch FILE --robot husky --out OUT"),
    ("two packs", "watch FILE --robot husky --out OUT"),
    ("sparse table", "columns FILE"),
    ("fit", "range husky --route FILE"),
    ("instruments", f"{EVALUATE} --instruments FILE"),
    ("robot", f"{EVALUATE} --robot FILE"),
    ("track", f"{EVALUATE} --route FILE"),
    ("policy", "evaluate --episodes 2 --env homeward/OutAndBack-v0 --agents ppo=POLICY --out OUT"),
)
"""Loaders whose inputs FILE is made of, and a command that reads it."""


@functools.cache
def real(name: str) -> list[bytes]:
    """Real files; they are read here first, for what that imports and compiles counts for no
    input."""
    loader = LOADERS[name]
    made = loader.files()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
        path = Path(folder) / f"input{loader.suffix}"
        for data in made:
            path.write_bytes(data)
            loader.read(path)
    return made


@st.composite
def changed(draw: st.DrawFn, name: str) -> bytes:
    """A real file in which some values, or stretches anywhere, became something else."""
    data = draw(st.sampled_from(real(name)))
    for _ in range(draw(st.integers(1, 3))):
        values = [
            match.span(1) for match in re.finditer(rb"(?:[=:,;]\s*|^)([^\s,;\]}]+)", data[:20_000])
        ]
        in_value: bool = draw(st.booleans())
        if values and in_value:
            start, end = draw(st.sampled_from(values))
        else:
            start = draw(st.integers(0, len(data)))
            end = start + draw(st.sampled_from((0, 1, 2, 4, 8, 40, len(data))))
        copied = data[start : start + draw(st.integers(1, 200))] * draw(st.integers(1, 128))
        digit, junk = st.integers(0, 9).map(b"%d".__mod__), st.binary(max_size=8)
        data = (
            data[:start]
            + draw(st.sampled_from(TOKENS) | digit | junk | st.just(copied))
            + data[end:]
        )
    return data[:300_000]


@st.composite
def mistyped(draw: st.DrawFn, words: list[str]) -> list[str]:
    """Words of which one, in a quarter of the lines, is left out, another, or a letter short."""
    if draw(st.integers(0, 3)):
        return words
    at, token = draw(st.integers(1, len(words) - 1)), draw(st.sampled_from(TOKENS))
    other = token.decode(errors="replace").replace("\0", " ")
    return [*words[:at], *draw(st.sampled_from(([], [other], [words[at][:-1]]))), *words[at + 1 :]]


def too_long(*_: object) -> None:
    raise TimeoutError(f"more than {LONGEST_S:g} s")


@contextlib.contextmanager
def limits() -> Iterator[None]:
    """No more time and memory than an input may take."""
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGPROF, too_long)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    resource.setrlimit(resource.RLIMIT_AS, (size + MOST_BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def words_of(name: str, line: str, data: bytes, folder: Path) -> list[str]:
    """Words of a command, on files that are written into a folder."""
    path = folder / f"input{LOADERS[name].suffix}"
    path.write_bytes(data)
    (folder / "run.csv").write_bytes(tables()[0])
    shutil.rmtree(folder / "out", ignore_errors=True)
    if name == "policy":
        policy_folder(path)
    names = {"FILE": path.name, "OUT": "out", "RUN": "run.csv", "POLICY": "policy"}
    return [
        re.sub("[A-Z]{3,}", lambda of: str(folder / names[of[0]]), word) for word in line.split()
    ]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Every command once, on a file that is as it should be."""
    folder = tmp_path_factory.mktemp("real")
    for name, line in COMMANDS:
        code, _, said = ended(words_of(name, line, real(name)[0], folder))
        assert code in (0, 2), said  # some are of other recordings, or too short to diagnose


@pytest.mark.parametrize("name", LOADERS)
def test_real_files_are_read(name: str) -> None:
    assert real(name)


def test_what_takes_too_much_time_or_memory_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "LONGEST_S", 0.2)
    with pytest.raises(TimeoutError, match=r"more than 0\.2 s"), limits():
        while True:
            pass
    with pytest.raises(MemoryError), limits():
        bytearray(2 * MOST_BYTES)


@pytest.mark.parametrize("name", LOADERS)
@SETTINGS
@given(data=st.data())
def test_a_changed_file_is_read_or_refused(name: str, tmp_path: Path, data: st.DataObject) -> None:
    loader = LOADERS[name]
    path = tmp_path / f"input{loader.suffix}"
    path.write_bytes(data.draw(changed(name)))
    with limits(), warnings.catch_warnings(action="ignore"):
        try:
            loader.read(path)
            event("read")
        except loader.refusals as error:
            assert str(error)
            event("refused")


@pytest.mark.usefixtures("compiled")
@OF_COMMANDS
@given(data=st.data())
def test_a_command_does_what_it_is_asked_or_says_why_not(
    tmp_path: Path, data: st.DataObject
) -> None:
    """On a changed file, and now and then with a wrong word: exit code 0, or 2 and a last line that
    says why."""
    name, line = data.draw(st.sampled_from(COMMANDS))
    words = data.draw(mistyped(words_of(name, line, data.draw(changed(name)), tmp_path)))
    with limits():
        code, printed, said = ended(words)
    event(f"code {code}")
    assert code in (0, 2) and "Traceback" not in said, said
    usage = "For full helptext" in printed + said  # tyro's words on an option that there is not
    assert code == 0 or usage or said.strip().splitlines()[-1].startswith("homeward"), said
    assert "\x1b" not in printed + said
