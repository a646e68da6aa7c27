"""Drives of a known robot through the project's own kernel, for the tests."""

import dataclasses
import functools
import hashlib
import os
from collections.abc import Callable, Sequence

import cloudpickle
import pytest
from filelock import FileLock

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.fit.refit import Refit, refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.physics.battery import FLAT
from homeward.synthetic import STEP_S, record
from tests.logs.conftest import csv as csv
from tests.logs.conftest import table as table

Drive = Callable[..., list[Recording]]
Analyse = Callable[[Sequence[Recording], Robot], Analysis]


@pytest.fixture(scope="session")
def husky() -> Robot:
    return dataclasses.replace(load_robot("husky"), chemistry=FLAT, cells_in_series=0)


@pytest.fixture(scope="session")
def drive() -> Drive:
    """Noisy recordings of a robot that may differ from what the diagnosis is told, the first
    minutes of each drive."""

    def recordings(
        robot: Robot, runs: int = 3, minutes: float = 8.0, **changes: object
    ) -> list[Recording]:
        robot = dataclasses.replace(robot, **changes)  # type: ignore[arg-type]
        tables = [
            record(robot, seed).iloc[: round(60.0 * minutes / STEP_S)] for seed in range(runs)
        ]
        return [
            Recording(
                f"run{i}.csv",
                str(i),
                {str(name): table[name].to_numpy(dtype=float) for name in table},
            )
            for i, table in enumerate(tables)
        ]

    return recordings


@pytest.fixture(scope="session")
def short_drive(drive: Drive) -> Drive:
    """As `drive`, four runs of two minutes, which are too short for the clock of power to be
    searched for a drift."""
    return functools.partial(drive, runs=4, minutes=2.0)


@pytest.fixture(scope="session")
def short_runs(short_drive: Drive, husky: Robot) -> Runs:
    """Windows of the short drives of a robot that is as its file says, for `observed` of the test's
    own."""
    return average(usable_runs(short_drive(husky), husky)[0])


@pytest.fixture(scope="session")
def short_fit(short_runs: Runs, husky: Robot) -> Refit:
    """The refit of these windows."""
    return refit(short_runs, husky)


@pytest.fixture(scope="session")
def analyse_once(tmp_path_factory: pytest.TempPathFactory) -> Analyse:
    """`analyse`, for all tests and processes that ask for the same recordings and robot: the first
    makes the analysis, and each gets a copy."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # of this run of the tests, and no other

    def analysis_of(recordings: Sequence[Recording], robot: Robot) -> Analysis:
        digest = hashlib.sha256(repr(robot).encode())
        for recording in recordings:
            digest.update(repr(dataclasses.replace(recording, channels={})).encode())
            for name, values in recording.channels.items():
                digest.update(name.encode() + values.tobytes())
        path = folder / f"analysis-{digest.hexdigest()}.pickle"
        with FileLock(f"{path}.lock"):
            if not path.exists():  # with what local functions close over, which pickle refuses
                path.write_bytes(cloudpickle.dumps(analyse(recordings, robot)))
            analysis: Analysis = cloudpickle.loads(path.read_bytes())
        return analysis

    return analysis_of


@pytest.fixture(scope="session")
def scrubbing(short_drive: Drive, husky: Robot, analyse_once: Analyse) -> Analysis:
    """What is said of a robot whose turning its file does not know, for all tests that ask
    something of it."""
    return analyse_once(short_drive(husky, effects={"turning": {"scrub": 0.3}}), husky)


@pytest.fixture(scope="session")
def faultless(short_drive: Drive, husky: Robot, analyse_once: Analyse) -> Analysis:
    """What is said of a robot that is as its file says."""
    return analyse_once(short_drive(husky), husky)


@pytest.fixture(scope="session")
def scrubbing_evidence(scrubbing: Analysis) -> Evidence:
    assert scrubbing.evidence is not None
    return scrubbing.evidence


@pytest.fixture(scope="session")
def faultless_evidence(faultless: Analysis) -> Evidence:
    assert faultless.evidence is not None
    return faultless.evidence
