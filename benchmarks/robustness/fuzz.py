"""Read mutated files, in this process and by commands, and keep whatever breaks: a traceback, a hang, too much memory.

`python benchmarks/robustness/fuzz.py --minutes 60` gives every loader its share of the time, in `--workers` processes
that are started anew when one dies. Each input is a real file with bytes or structure changed, or what was kept of
earlier ones because it ended in a new way; where `atheris` is installed, coverage chooses what is kept in half the time
of loaders written in Python. A loader may refuse with its own error, in at most 10 s and with at most 1 GB more than
before; anything else is a finding and lies in OUT/TARGET with its traceback. `--commands N` runs `homeward` that often
on such files and with wrong words, in forks of a process that has everything loaded; each has 10 s of processor time
and 1 GB, and ends with 0, or with 2 and a line that says why. OUT/fuzz.md is the table of the documentation;
tests/broken holds what once broke, and tests/test_broken.py reads it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import gzip
import hashlib
import importlib.util
import io
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import tyro

if __name__ == "__main__":  # a fork has no threads but one, and numba reads this when it is imported
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.robustness.forks import Run, fork, wait, warm

ROOT = Path(__file__).resolve().parents[2]
LONGEST_S = 10.0
"""What reading an input may take."""
MOST_BYTES = 10**9
"""What it may allocate."""
_FAST = "/dev/shm" if os.path.isdir("/dev/shm") else None  # folder of inputs: in memory, where there is such
_DEAD_S = 180.0  # after its time a worker has hung where no signal ends it
_READ, _REFUSED = "read", "refused"
_KEPT = 400  # inputs that ended in a new way
_FRESH = 0.5  # share of inputs made of a real file, not of what was kept
_TOKENS = (
    b"nan", b"inf", b"-inf", b"1e400", b"-1", b"0", b"1e-320", b"9223372036854775807", b"18446744073709551616", b"\x00",
    b"\xff\xff\xff\xff", b"\xff\xfe", b"\xef\xbb\xbf", b"[[", b"]]", b"{", b"}", b'"', b"'", b"#", b"\n", b"\r\n", b";",
    b",", b"\t", b"true", b"null", b"None", b"1979-05-27T07:32:00Z", b"[1, 2]", b'"text"', b"{}", b"[]", b"0x10",
    b"../../etc/passwd", b"9" * 400, "é".encode("latin-1"), "🤖".encode(), b"\x1b[31m", b"[red]", b"time_s", b"=",
    b"." * 50,
)  # fmt: skip


@dataclass(frozen=True)
class Args:
    """How long, and what."""

    minutes: float = 1.0
    """Time for the loaders, shared evenly."""
    commands: int = 0
    """Runs of commands after that."""
    workers: int = 2
    """Processes at once."""
    targets: tuple[str, ...] = ()
    """Loaders to fuzz; all if left out."""
    seed: int = 0
    """Seed of the mutations."""
    out: Path = Path("runs/fuzz")
    """Folder of the findings and of the table."""
    worker: str = ""
    """Loader that this process is to read for; the processes that this one starts are given it."""
    guided: bool = False
    """Whether coverage guides that."""


@dataclass(frozen=True)
class Target:
    """A loader: what it reads, the endings of its files, and the errors that it may refuse with."""

    read: Callable[[Path], Any]
    suffix: str
    refusals: tuple[type[Exception], ...]
    seeds: Callable[[], list[bytes]]  # real files, shortened so that many are read in a second
    guidable: bool = False  # written in Python for the most part


class Hang(BaseException):
    """Raised by the watchdog."""


_GUIDED = (
    "homeward.files", "homeward.physics.plausible", "homeward.physics.robot", "homeward.physics.uncertainty",
    "homeward.envs.conditions.instruments", "homeward.envs.routes", "homeward.logs", "gpxpy", "tomllib",
)  # fmt: skip
"""Modules whose coverage is looked at: they read what the guided targets read, and hold nothing that is compiled."""


def targets() -> dict[str, Target]:
    """Every loader by name."""
    from homeward.agents.trained.environment import setting_of
    from homeward.agents.trained.policy_file import PolicyFileError, load_policy
    from homeward.diagnosis import RecordingError, load_columns, read_recording
    from homeward.envs.conditions.instruments import InstrumentError, load_instruments
    from homeward.envs.options import OptionError
    from homeward.envs.routes import RouteError, load_route
    from homeward.logs.bags.topics import load_topics
    from homeward.logs.propose import propose
    from homeward.physics import RobotError, load_robot

    def policy(path: Path) -> Any:
        folder = _policy_folder(path)
        try:
            return load_policy(folder)
        finally:
            shutil.rmtree(folder)

    def setting(path: Path) -> Any:
        return setting_of(policy(path))

    def route(path: Path) -> Any:
        return load_route(path, 5.0)

    recording = (RecordingError,)
    exported = (PolicyFileError, OptionError, RobotError, RouteError)
    maps = "homeward/logs"
    return {
        "robot TOML": Target(load_robot, ".toml", (RobotError,), lambda: _files("homeward/robots/*.toml"), True),
        "route CSV": Target(route, ".csv", (RouteError,), _route_seeds, True),
        "route GPX": Target(route, ".gpx", (RouteError,), lambda: [_gpx()], True),
        "recording CSV": Target(read_recording, ".csv", recording, _recording_seeds),
        "recording CSV.gz": Target(read_recording, ".csv.gz", recording,
                                   lambda: [gzip.compress(one) for one in _recording_seeds()]),
        "recording by a mapping": Target(lambda path: read_recording(path, "husky_borealtc"), ".csv", recording,
                                         _foreign_seeds),
        "recording without a header": Target(lambda path: read_recording(path, "turtlebot3_tactics"), ".txt", recording,
                                             lambda: [b"1,2.5,11.1,300,3300,11.2\n" * 40]),
        "recording Parquet": Target(read_recording, ".parquet", recording, _parquet_seeds),
        "bag MCAP": Target(read_recording, ".mcap", recording, lambda: _log_seeds("mcap")),
        "bag ROS 1": Target(read_recording, ".bag", recording, lambda: _log_seeds("ros1")),
        "bag sqlite3": Target(read_recording, ".db3", recording, lambda: _log_seeds("sqlite3")),
        "log PX4": Target(read_recording, ".ulg", recording, lambda: _log_seeds("ulg")),
        "log ArduPilot": Target(read_recording, ".bin", recording, lambda: _log_seeds("bin")),
        "log VESC Tool": Target(read_recording, ".csv", recording, lambda: [_vesc_tool()]),
        "mapping of columns": Target(load_columns, ".toml", recording, lambda: _files(f"{maps}/maps/*.toml"), True),
        "mapping of topics": Target(load_topics, ".toml", recording, lambda: _files(f"{maps}/bags/maps/*.toml"), True),
        "proposal of a mapping": Target(propose, ".csv", recording, lambda: [*_recording_seeds(), *_foreign_seeds()]),
        "policy": Target(policy, "", (PolicyFileError,), _policy_seeds),
        "policy for ONNX": Target(setting, "", exported, _policy_seeds),
        "instruments TOML": Target(load_instruments, ".toml", (InstrumentError,), _instrument_seeds, True),
    }  # fmt: skip


def _files(pattern: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted(ROOT.glob(pattern))]


def _rows(head: str, row: Callable[[int], str], count: int = 40) -> bytes:
    """A table of text."""
    return f"{head}\n{''.join(row(i) + chr(10) for i in range(count))}".encode()


def _route_seeds() -> list[bytes]:
    track = _rows("lat,lon,ele", lambda i: f"{45 + i * 1e-4:.5f},{7 + i * 1e-5:.5f},{100 + i % 7}")
    return [*_files("homeward/routes/*.csv"), track]


def _gpx() -> bytes:
    points = "".join(f'<trkpt lat="{45 + i * 1e-4:.5f}" lon="7.0"><ele>{100 + i % 7}</ele></trkpt>' for i in range(40))
    head = '<?xml version="1.0"?><gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">'
    return f"{head}<trk><trkseg>{points}</trkseg></trk></gpx>".encode()


def _recording_seeds() -> list[bytes]:
    with gzip.open(ROOT / "homeward" / "recordings" / "synthetic_husky.csv.gz") as file:
        plain = b"".join(file.read().splitlines(keepends=True)[:60])
    epoch = _rows("time_s,speed_mps,voltage_v,current_a", lambda i: f"{1714564800000 + 100 * i},0.5,24.5,3")
    dates = _rows("time_s,wheel_left_mps,wheel_right_mps,power_w", lambda i: f"2024-05-01T12:00:{i:02d}Z,0.5,0.6,90")
    german = _rows("time_s;speed_mps;power_w", lambda i: f"01.05.2024 12:00:{i:02d},0;0,5;90,1")
    return [plain, plain.replace(b",", b";"), plain.replace(b",", b";").replace(b".", b","), epoch, dates, german,
            plain.decode().encode("utf-16")]  # fmt: skip


def _foreign_seeds() -> list[bytes]:
    folder = os.environ.get("HOMEWARD_DATA")
    real = sorted(Path(folder).rglob("*.csv"))[::20][:6] if folder else []
    made = _rows("time,curL,curR,velL,velR", lambda i: f"{i / 10:.2f},1.5,1.4,0.5,0.5", 60)
    return [made, *(b"".join(path.read_bytes().splitlines(keepends=True)[:60]) for path in real)]


def _parquet_seeds() -> list[bytes]:
    import pandas as pd

    frames = [pd.read_csv(io.BytesIO(_recording_seeds()[kind])) for kind in (0, 4)]
    return [frame.to_parquet(compression=how) for frame in frames for how in ("snappy", "zstd", None)]


def _log_seeds(form: str) -> list[bytes]:
    """Bags and logs of autopilots, some seconds long."""
    from tests.logs.bag_writer import Stream, write_bag
    from tests.logs.flight_writer import write_dataflash, write_ulog

    t = np.arange(0.0, 8.0, 0.5)
    speed, current = 0.5 + 0.1 * np.sin(t), 3.0 + t
    streams = {
        "/odom": Stream("nav_msgs/msg/Odometry", t, {"twist.twist.linear.x": speed}),
        "/battery": Stream("sensor_msgs/msg/BatteryState", t, {"voltage": 24.0, "current": -current}),
    }
    px4 = {
        "battery_status": {"voltage_v": 24.0, "current_a": current, "remaining": 0.9},
        "vehicle_local_position": {"vx": speed, "vy": 0.0, "z": 1.0, "heading": 0.0, "v_xy_valid": True,
                                   "z_valid": True},
        "vehicle_attitude": {f"q[{i}]": float(i == 0) for i in range(4)},
    }  # fmt: skip
    ardupilot = {"BAT": {"Volt": 24.0, "Curr": current}, "THR": {"Speed": speed}, "ATT": {"Pitch": speed}}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if form == "ulg":
            return [write_ulog(folder / "run.ulg", {of: (t, one) for of, one in px4.items()}).read_bytes()]
        if form == "bin":
            return [write_dataflash(folder / "run.bin", [(of, t, one) for of, one in ardupilot.items()]).read_bytes()]
        for compression in {"ros1": ("", "lz4"), "mcap": ("", "storage"), "sqlite3": ("",)}[form]:
            write_bag(folder / f"{form}{compression}", form, streams, compression)
        return [one.read_bytes() for one in sorted(folder.rglob("*")) if one.suffix in (".bag", ".mcap", ".db3")]


def _vesc_tool() -> bytes:
    """What is read of a log of VESC Tool."""
    names = "ms_today;input_voltage;current_motor;current_in_setup;speed_meters_per_sec;num_vescs;"
    return _rows(names, lambda i: f"{68209883 + 50 * i};38.1;20.5;4.1;{1.5 - 0.01 * i:.2f};2;", 60)


_BREAK = b"\n--policy--\n"


def _policy_seeds() -> list[bytes]:
    """Both files of a policy in one, the description first."""
    folders = [path.parent for path in sorted((ROOT / "agents" / "policies").glob("*/policy.json"))]
    return [_BREAK.join((one / f"policy.{end}").read_bytes() for end in ("json", "safetensors")) for one in folders]


def _policy_folder(path: Path) -> Path:
    """A folder with the two files; the hash is set right where it can be, or hardly any would be looked into."""
    description, _, weights = path.read_bytes().partition(_BREAK)
    folder = Path(tempfile.mkdtemp(dir=path.parent))
    digest = hashlib.sha256(weights).hexdigest().encode()
    description = re.sub(rb'("weights_sha256": ")[0-9a-f]{64}"', rb"\g<1>" + digest + b'"', description)
    (folder / "policy.json").write_bytes(description)
    (folder / "policy.safetensors").write_bytes(weights)
    return folder


def _instrument_seeds() -> list[bytes]:
    from homeward.envs.conditions.instruments import INSTRUMENTS

    tables = map(dataclasses.asdict, INSTRUMENTS.values())
    return ["".join(f"{name} = {value!r}\n" for name, value in one.items()).encode() for one in tables]


class Mutator:
    """Changes bytes or structure of inputs, with what a generator draws."""

    def __init__(self, rng: np.random.Generator, corpus: list[bytes]) -> None:
        self.rng, self.corpus, self.fixed = rng, corpus, len(corpus)
        self.ways = (self._flip, self._overwrite, self._insert, self._delete, self._repeat, self._cut, self._splice,
                     self._number, self._cell, self._lines, self._ends, self.digit)  # fmt: skip

    def draw(self) -> bytes:
        """A changed input of the corpus."""
        often = self.rng.random() < _FRESH
        return self.change(self.corpus[self.below(self.fixed if often else len(self.corpus))])

    def change(self, data: bytes) -> bytes:
        """The input with some changes."""
        for _ in range(int(self.rng.geometric(0.6))):
            data = self.ways[self.below(len(self.ways))](data)
        return data[:300_000]

    def below(self, count: int) -> int:
        """A whole number from 0 on."""
        return int(self.rng.integers(count))

    def token(self) -> bytes:
        """Something that readers may stumble over."""
        return _TOKENS[self.below(len(_TOKENS))]

    def _put(self, data: bytes, new: bytes, length: int = 0) -> bytes:
        """Put something anywhere, in the place of so many bytes."""
        at = self.below(len(data) + 1)
        return data[:at] + new + data[at + length :]

    def _flip(self, data: bytes) -> bytes:
        changed = bytearray(data)
        for _ in range(1 + self.below(4) if data else 0):
            changed[self.below(len(data))] ^= 1 << self.below(8)
        return bytes(changed)

    def _overwrite(self, data: bytes) -> bytes:
        junk = self.rng.bytes(1 + self.below(8))
        return self._put(data, junk, len(junk))

    def _insert(self, data: bytes) -> bytes:
        return self._put(data, self.token())

    def _delete(self, data: bytes) -> bytes:
        return self._put(data, b"", int(self.rng.geometric(0.05)))

    def _repeat(self, data: bytes) -> bytes:
        at = self.below(len(data) + 1)
        return data[:at] + data[at : at + 1 + self.below(199)] * (1 << 1 + self.below(7)) + data[at:]

    def _cut(self, data: bytes) -> bytes:
        return data[: self.below(len(data) + 1)]

    def _splice(self, data: bytes) -> bytes:
        other = self.corpus[self.below(len(self.corpus))]
        return self._cut(data) + other[self.below(len(other) + 1) :]

    def _instead(self, pattern: bytes, data: bytes, new: bytes) -> bytes:
        """Put something in the place of a match."""
        places = [match.span(1) for match in re.finditer(pattern, data[:20_000])]
        if not places:
            return self._flip(data)
        start, end = places[self.below(len(places))]
        return data[:start] + new + data[end:]

    def _number(self, data: bytes) -> bytes:
        """A number, or what follows an equals sign or colon, becomes something else."""
        return self._instead(rb"[=:,]\s*([^\s,;\]}]+)", data, self.token())

    def digit(self, data: bytes) -> bytes:
        """A digit becomes another: most files of text can still be read."""
        return self._instead(rb"(\d)", data, b"%d" % self.below(10))

    def _cell(self, data: bytes) -> bytes:
        """A length or count in a binary header: a little-endian number becomes extreme."""
        width = 1 << self.below(4)
        return self._put(data, ((1 << self.below(8 * width + 1)) - 1).to_bytes(width, "little"), width)

    def _lines(self, data: bytes) -> bytes:
        """A line goes, comes twice, or changes places with another."""
        lines = data.splitlines(keepends=True)
        if len(lines) < 2:
            return self._flip(data)
        one, other, way = self.below(len(lines)), self.below(len(lines)), self.below(3)
        if way == 2:
            lines[one], lines[other] = lines[other], lines[one]
        else:
            lines[other:other] = [lines.pop(one)] * (2 * way)
        return b"".join(lines)

    def _ends(self, data: bytes) -> bytes:
        """The first or last kilobyte, where formats keep their headers."""
        if self.below(2):
            return self._flip(data[:1024]) + data[1024:]
        return data[:-1024] + self._overwrite(data[-1024:])


@dataclass
class Tally:
    """What became of the inputs of a target: how many were read, were refused, or broke in which way."""

    ends: Counter[str] = field(default_factory=Counter)
    longest_s: float = 0.0
    guided: bool = False

    def __add__(self, other: Tally) -> Tally:
        longest_s = max(self.longest_s, other.longest_s)
        return Tally(self.ends + other.ends, longest_s, self.guided or other.guided)

    @property
    def findings(self) -> Counter[str]:
        """How often what broke."""
        return Counter({end: count for end, count in self.ends.items() if end not in (_READ, _REFUSED)})


class Worker:
    """Reads inputs of one target and keeps what breaks."""

    def __init__(self, name: str, out: Path) -> None:
        self.target, self.out, self.tally, self.seen = targets()[name], out, Tally(), set[str]()
        self.out.mkdir(parents=True, exist_ok=True)
        self.folder = Path(tempfile.mkdtemp(prefix="fuzz_", dir=_FAST))
        self.path = self.folder / f"input{self.target.suffix}"
        (self.out / "last").write_text(str(self.path))
        self._written_s = 0.0

    def try_one(self, data: bytes) -> bool:
        """Read one input; True if it ended in a way not seen before."""
        self.path.write_bytes(data)
        began = time.monotonic()
        signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
        try:
            with warnings.catch_warnings(action="ignore"):
                self.target.read(self.path)
            end = counted = _READ
        except self.target.refusals as error:
            end, counted = f"refused {_shape(str(error))}", _REFUSED
        except (Exception, Hang) as error:
            end = counted = f"broke {type(error).__name__} {_where(error)}"
            if end not in self.seen:
                name = hashlib.sha256(end.encode()).hexdigest()[:12]
                (self.out / f"{name}{self.target.suffix}").write_bytes(data)
                (self.out / f"{name}.trace").write_text(f"{end}\n{traceback.format_exc()}")
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        self.tally.ends[counted] += 1
        self.tally.longest_s = max(self.tally.longest_s, time.monotonic() - began)
        if time.monotonic() - self._written_s > 1.0:
            self.write()
        new = end not in self.seen
        self.seen.add(end)
        return new

    def write(self) -> None:
        """Write the tally where the parent reads it."""
        self._written_s = time.monotonic()
        fresh = self.out / f"tally.{os.getpid()}.new"
        fresh.write_text(json.dumps(vars(self.tally)))
        fresh.replace(fresh.with_suffix(".json"))


def _shape(message: str) -> str:
    """A message less its numbers, quoted text and paths."""
    return re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?|'[^']*'|\"[^\"]*\"|/\S+", "#", message)[:80]


def _where(error: BaseException) -> str:
    """Where in this project it was raised from."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "homeward" in frame.filename]
    return f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "elsewhere"


def work(args: Args) -> None:
    """Fuzz one target for the given time; the parent reads the tally."""
    signal.signal(signal.SIGALRM, _hang)
    if args.guided:
        import atheris
    with atheris.instrument_imports(include=list(_GUIDED)) if args.guided else contextlib.nullcontext():
        worker = Worker(args.worker, args.out)
        worker.tally.guided = args.guided
        corpus = worker.target.seeds()
        for seed in corpus:  # imports and caches come before the limit
            worker.try_one(seed)
    limit_memory()
    try:
        (_guided if args.guided else _plain)(worker, corpus, args)
    finally:
        worker.write()
        shutil.rmtree(worker.folder, ignore_errors=True)


def _plain(worker: Worker, corpus: list[bytes], args: Args) -> None:
    """Change real files and what ended in a new way."""
    mutator = Mutator(np.random.default_rng([args.seed, *args.worker.encode()]), corpus)
    end_s = time.monotonic() + 60.0 * args.minutes
    while time.monotonic() < end_s:
        data = mutator.draw()
        if worker.try_one(data) and len(data) < 100_000:
            if len(corpus) > mutator.fixed + _KEPT:
                del corpus[mutator.fixed + mutator.below(_KEPT)]
            corpus.append(data)


def _guided(worker: Worker, corpus: list[bytes], args: Args) -> None:
    """Let libFuzzer keep the inputs that reach new branches; half of its mutations are those of `Mutator`."""
    import atheris

    folder = worker.folder / "corpus"
    folder.mkdir()
    for number, seed in enumerate(corpus):
        (folder / str(number)).write_bytes(seed)

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        own = rng.random() < 0.5
        return Mutator(rng, [data, *corpus]).change(data)[:most] if own else bytes(atheris.Mutate(data, most))

    limits = [f"-max_total_time={int(60 * args.minutes)}", f"-seed={args.seed + 1}", "-max_len=5000", "-len_control=0",
              "-rss_limit_mb=0", "-timeout=0", "-handle_alrm=0", "-print_final_stats=1"]  # fmt: skip
    atheris.Setup([sys.argv[0], *limits, str(folder)], lambda data: worker.try_one(data) and None,
                  custom_mutator=mutate)  # fmt: skip
    atheris.Fuzz()


def _hang(number: int, frame: FrameType | None) -> None:
    raise Hang(f"more than {LONGEST_S:g} s")


def main(args: Args) -> dict[str, Tally]:
    """Fuzz every target, then the commands; print and write the table."""
    if args.worker:
        work(args)
        return {}
    names = args.targets or tuple(targets()) if args.minutes > 0.0 else ()
    share_s = 60.0 * args.minutes * args.workers / max(len(names), 1)
    tallies = {}
    with ThreadPoolExecutor(args.workers) as pool:
        for name, tally in zip(names, pool.map(lambda name: _turn(name, share_s, args), names), strict=True):
            tallies[name] = tally
            print(_row(name, tally), flush=True)
    if args.commands:
        tallies["commands"] = _commands(args)
        print(_row("commands", tallies["commands"]), flush=True)
    table = _table(tallies)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "fuzz.md").write_text(table)
    print(table)
    return tallies


def _turn(name: str, seconds: float, args: Args) -> Tally:
    """A target's time, in as many worker processes as it takes."""
    out, end_s, deaths = args.out / name.replace(" ", "_"), time.monotonic() + seconds, 0
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    guidable = targets()[name].guidable and importlib.util.find_spec("atheris") is not None
    while deaths == 0 or (end_s - time.monotonic() > 1.0 and deaths < 200):
        guided = guidable and deaths % 2 == 0
        minutes = (0.5 if guided else 1.0) * max(end_s - time.monotonic(), 0.0) / 60.0
        line = [sys.executable, __file__, "--worker", name, "--minutes", str(minutes), "--out", str(out),
                "--seed", str(args.seed + deaths), *(["--guided"] if guided else [])]  # fmt: skip
        with (out / "log").open("ab") as log, contextlib.suppress(subprocess.TimeoutExpired):
            code = -signal.SIGKILL  # where no signal ends a hang
            environment = {**os.environ, "OMP_NUM_THREADS": "1"}
            code = subprocess.run(
                line, stdout=log, stderr=log, env=environment, timeout=60.0 * minutes + _DEAD_S
            ).returncode
        if code not in (0, 1) or not list(out.glob("tally.*.json")):
            _keep_last(out, f"died with {code}", deaths)
        deaths += 1
    written = (json.loads(path.read_text()) for path in out.glob("tally.*.json"))
    return sum((Tally(**one | {"ends": Counter(one["ends"])}) for one in written), Tally())


def _keep_last(out: Path, how: str, number: int) -> None:
    """Keep the input that a worker died of, where it is still there."""
    if not (out / "last").is_file():
        raise RuntimeError(f"no input was read: see {out / 'log'}")
    path = Path((out / "last").read_text())
    if path.is_file():
        shutil.copy(path, out / f"death{number}{path.suffix}")
        (out / f"tally.death{number}.json").write_text(json.dumps(vars(Tally(Counter({how: 1})))))


_EVALUATE = "evaluate --agents soc50 --episodes 2 --out OUT"
_TRAIN = ("train --start scratch --n-envs 4 --n-steps 8 --batch-size 16 --epochs 1 --hidden 8 --curve 1 --steps 64 "
          "--decision-s 300 --replace --out OUT")  # fmt: skip
_LINES: tuple[tuple[str, str], ...] = (
    ("robot TOML", "range FILE"),
    ("robot TOML", "range FILE --grade 3 --duty 0.5"),
    ("route CSV", "range husky --route FILE --risk 0.01"),
    ("robot TOML", "robots FILE"),
    ("robot TOML", "routes incline --robot FILE"),
    ("route CSV", "routes FILE"),
    ("route GPX", "routes FILE --robot husky"),
    ("recording CSV", "columns FILE"),
    ("recording by a mapping", "columns FILE --out proposed.toml"),
    ("recording Parquet", "columns FILE"),
    ("recording CSV", "diagnose FILE --robot husky --out OUT"),
    ("recording CSV.gz", "diagnose FILE RUN --out OUT"),
    ("recording Parquet", "diagnose FILE --robot husky --out OUT"),
    ("bag MCAP", "diagnose FILE --robot husky --out OUT"),
    ("bag ROS 1", "diagnose FILE --robot jackal --out OUT"),
    ("robot TOML", "diagnose RUN --robot FILE --out OUT"),
    ("mapping of columns", "diagnose RUN --columns FILE --out OUT"),
    ("mapping of topics", "diagnose BAG --columns FILE --out OUT"),
    ("recording CSV", "watch FILE --robot husky --out OUT"),
    ("bag sqlite3", "watch FILE --robot husky --out OUT"),
    ("recording CSV", "fleet GARAGE --out OUT"),
    ("instruments TOML", f"{_EVALUATE} --instruments FILE"),
    ("robot TOML", f"{_EVALUATE} --robot FILE"),
    ("route GPX", f"{_EVALUATE} --route FILE"),
    ("policy", "evaluate --episodes 2 --env homeward/OutAndBack-v0 --agents ppo=POLICY --out OUT"),
    ("robot TOML", f"{_TRAIN} --robot FILE"),
)
"""Targets whose inputs FILE is made of, and a command that reads it."""
_WRONG_WORDS = 0.25
"""Share of the command lines in which a word is another, too, as users mistype."""
_MILD = 0.4
"""Share of the command lines in whose file no more than a digit is another, so that more than the loader runs."""
_SHOWN = 250  # commands after which the row is printed that the table has in the end


class Lines:
    """Draws command lines, each on a fresh mutated file in a folder."""

    def __init__(self, folder: Path, rng: np.random.Generator) -> None:
        self.folder, self.rng, self.every = folder, rng, targets()
        self.kinds = {name: Mutator(rng, self.every[name].seeds()) for name in dict(_LINES)}
        (folder / "run.csv").write_bytes(_recording_seeds()[0])
        (folder / "run.bag").write_bytes(_log_seeds("ros1")[0])

    def plain(self) -> Iterator[list[str]]:
        """Every line once, on a file that is as it should be."""
        for name, words in _LINES:
            yield self._on(name, words, self.kinds[name].corpus[0])

    def draw(self) -> list[str]:
        """A line on a changed file, perhaps with a wrong word."""
        name, words = _LINES[int(self.rng.integers(len(_LINES)))]
        kind = self.kinds[name]
        mild = self.rng.random() < _MILD
        line = self._on(name, words, kind.digit(kind.corpus[kind.below(kind.fixed)]) if mild else kind.draw())
        return self._mistyped(line, kind) if self.rng.random() < _WRONG_WORDS else line

    def _on(self, name: str, words: str, data: bytes) -> list[str]:
        path = self.folder / f"input{self.every[name].suffix}"
        path.write_bytes(data)
        for made in ("garage", "policy", "out"):
            shutil.rmtree(self.folder / made, ignore_errors=True)
        for robot in ("one", "two") if "GARAGE" in words else ():
            (self.folder / "garage" / robot).mkdir(parents=True)
            (self.folder / "garage" / robot / path.name).write_bytes(data)
        if name == "policy":
            _policy_folder(path).rename(self.folder / "policy")
        names = {"FILE": path.name, "OUT": "out", "RUN": "run.csv", "BAG": "run.bag", "GARAGE": "garage",
                 "POLICY": "policy"}  # fmt: skip
        return [re.sub("[A-Z]{3,}$", lambda of: str(self.folder / names[of[0]]), word) for word in words.split()]

    def _mistyped(self, line: list[str], kind: Mutator) -> list[str]:
        """The line with a word left out, put in, another, or a letter short."""
        at, token = 1 + kind.below(len(line)), kind.token().decode(errors="replace").replace("\0", " ")
        word = line[at : at + 1]
        ways: list[list[str]] = [[], [token, *word], [token], [word[0][:-1]] if word else [token]]
        return [*line[:at], *ways[kind.below(4)], *line[at + 1 :]]


def _commands(args: Args) -> Tally:
    """Run commands in forks of a process that has everything loaded and compiled."""
    from homeward import __main__ as command

    tally, out = Tally(), args.out / "commands"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    with tempfile.TemporaryDirectory(dir=_FAST) as name:
        folder = Path(name)
        lines = Lines(folder, np.random.default_rng([args.seed, 1]))
        for line in lines.plain():
            warm(command.run, line, folder)
        gc.collect()
        gc.freeze()  # or every fork copies what its collector looks at
        for number in range(args.commands):
            line = lines.draw()
            end = _forked(command.run, line, folder)
            fault = end.fault()
            counted = f"{line[0]}: {fault}" if fault else _REFUSED if end.code else _READ
            tally += Tally(Counter({counted: 1}), end.took_s)
            if number % _SHOWN == 0:
                print(_row("commands", tally), flush=True)
            if fault and tally.ends[counted] == 1:
                (out / f"{number}.trace").write_text(f"{' '.join(line)}\n{counted}\n{end.said}")
                shutil.copytree(folder, out / str(number), ignore=shutil.ignore_patterns("out"))
    return tally


@dataclass(frozen=True)
class End:
    """How a command ended."""

    code: int
    took_s: float  # of the processor
    said: str  # on stderr
    printed: str

    def fault(self) -> str:
        """What is wrong with that, or "": a command does what it is asked, or says in its last line why not."""
        last = (self.said.strip().splitlines() or [""])[-1]
        if self.code not in (0, 2) or "Traceback" in self.said:
            return f"code {self.code}, {_shape(last)}"
        usage = "For full helptext" in self.said  # tyro's words on an option that there is not
        if self.code == 2 and not usage and not last.startswith("homeward"):
            return f"refused without a line, {_shape(last)}"
        if "\x1b" in self.said + self.printed:
            return "an escape reaches the terminal"
        return ""


def _forked(run: Run, line: list[str], folder: Path) -> End:
    """Run a command in a child; its code is -24 or -9 if it took too long."""
    said, printed = folder / "said", folder / "printed"
    code, took_s = wait(fork(run, line, folder, said, printed, _limit), 6 * LONGEST_S)  # processor time ends before
    return End(code, took_s, said.read_text(errors="replace"), printed.read_text(errors="replace"))


def limit_memory() -> None:
    """Let this process allocate no more than `MOST_BYTES` beyond what it has."""
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MOST_BYTES, resource.RLIM_INFINITY))


def _limit() -> None:
    limit_memory()
    resource.setrlimit(resource.RLIMIT_CPU, (int(LONGEST_S), int(LONGEST_S) + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _row(name: str, one: Tally) -> str:
    guided = " (coverage)" if one.guided else ""
    inputs, read, refused, broke = one.ends.total(), one.ends[_READ], one.ends[_REFUSED], one.findings.total()
    return f"| {name}{guided} | {inputs:,} | {read:,} | {refused:,} | {one.longest_s:.2f} s | {broke} |"


def _table(tallies: dict[str, Tally]) -> str:
    head = ["| what is read | inputs | read | refused in one line | longest | broke |", "|---|---|---|---|---|---|"]
    rows = [_row(name, one) for name, one in tallies.items()]
    ways = [f"* {name}: {end} ({count})" for name, one in tallies.items() for end, count in one.findings.items()]
    return "\n".join([*head, *rows, _row("all", sum(tallies.values(), Tally())), "", *ways]) + "\n"


if __name__ == "__main__":
    found = main(tyro.cli(Args, description=__doc__))
    sys.exit(1 if any(one.findings for one in found.values()) else 0)
