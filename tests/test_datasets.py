"""Data sets come from a local folder or the network, and only as their checksums say."""

import errno
import shutil
import time
from pathlib import Path

import pooch
import pytest
import requests

from homeward import datasets
from homeward.datasets import DATASETS, DatasetError, DownloadError, fetch, groups_of
from homeward.diagnosis import load_columns, read_recording
from homeward.physics import load_robot


@pytest.fixture
def local(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A local data set of one file, and the environment that points to it."""
    folder = tmp_path / "data" / "husky_borealtc" / "ICE"
    folder.mkdir(parents=True)
    (folder / "pro_00.csv").write_text("time\n0\n")
    digest = pooch.file_hash(str(folder / "pro_00.csv"))
    monkeypatch.setattr(datasets, "_registry", lambda name: {"ICE/pro_00.csv": digest})
    monkeypatch.setenv(datasets.LOCAL_FOLDER, str(tmp_path / "data"))
    return folder / "pro_00.csv"


def test_local_folder_is_used_and_checked(local: Path) -> None:
    assert fetch("husky_borealtc", "ICE") == [local]
    local.write_text("changed")
    with pytest.raises(DatasetError, match="differs from its checksum"):
        fetch("husky_borealtc")
    local.unlink()
    with pytest.raises(DatasetError, match="does not exist"):
        fetch("husky_borealtc")


def test_unknown_name_and_group() -> None:
    with pytest.raises(DatasetError, match="known: husky_borealtc, f1tenth_frictionmaps"):
        fetch("kitti")
    with pytest.raises(DatasetError, match="groups: ASPHALT, FLOORING, ICE, SNOW"):
        fetch("husky_borealtc", "SAND")


def test_groups_are_folders_without_their_number(data_folder: Path) -> None:
    assert groups_of("ase_rover")[:2] == ["baseline_on_track", "before_intervention"]
    assert groups_of("f1tenth_frictionmaps") == []
    assert {path.parts[-3] for path in fetch("turtlebot3_tactics", "EE2")} == {"3_EE2"}


def test_offline_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(datasets.LOCAL_FOLDER, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def offline(*_: object, **__: object) -> None:
        raise requests.exceptions.ConnectionError("no route to host")

    monkeypatch.setattr(requests, "get", offline)
    monkeypatch.setattr(time, "sleep", lambda _: None)  # between tries
    with pytest.raises(
        DownloadError, match=r"set HOMEWARD_DATA to a folder that contains husky_borealtc/"
    ):
        fetch("husky_borealtc", "FLOORING", progress=False)


def test_a_full_disk_is_no_failed_download(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(datasets.LOCAL_FOLDER, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", full)
    with pytest.raises(
        DatasetError, match=r"cannot be written \(No space left on device\); set XDG_CACHE_HOME"
    ) as found:
        fetch("husky_borealtc", "FLOORING", progress=False)
    assert not isinstance(found.value, DownloadError)


def test_download_is_cached_and_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, local: Path
) -> None:
    monkeypatch.delenv(datasets.LOCAL_FOLDER)
    monkeypatch.setattr(pooch, "os_cache", lambda name: tmp_path / "cache")
    served = []

    def serve(self: object, url: str, output_file: str, pooch: object) -> None:
        served.append(url)
        shutil.copy(local, output_file)

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", serve)
    assert (
        fetch("husky_borealtc")[0].read_text()
        == fetch("husky_borealtc")[0].read_text()
        == "time\n0\n"
    )
    assert served == [f"{DATASETS['husky_borealtc'].base_url}ICE/pro_00.csv"]
    shutil.rmtree(tmp_path / "cache")
    local.write_text("tampered")
    monkeypatch.setattr(time, "sleep", lambda _: None)  # between tries
    with pytest.raises(DatasetError, match="differs from its checksum"):
        fetch("husky_borealtc", progress=False)


@pytest.mark.parametrize("dataset", DATASETS.values(), ids=DATASETS)
def test_mapping_and_robot_of_each_data_set_ship(dataset: datasets.Dataset) -> None:
    assert load_columns(dataset.columns).sources
    if dataset.robot is not None:
        load_robot(dataset.robot)


@pytest.mark.parametrize("dataset", DATASETS.values(), ids=DATASETS)
def test_a_local_copy_stands_for_the_network(dataset: datasets.Dataset, data_folder: Path) -> None:
    paths = fetch(dataset.name, progress=False)
    assert [path.is_relative_to(data_folder / dataset.name) for path in paths] == [True] * len(
        datasets._registry(dataset.name)
    )
    run = read_recording(paths[0], dataset.columns, standing=True)  # two have no motion channel
    assert run.duration_s > 5.0
    assert {"voltage_v", "current_a"} <= run.channels.keys() or {
        "motor_left_a",
        "motor_right_a",
    } <= run.channels.keys()


@pytest.mark.parametrize("dataset", DATASETS.values(), ids=DATASETS)
def test_addresses_cannot_change_and_digests_are_whole(dataset: datasets.Dataset) -> None:
    assert dataset.base_url.startswith("https://") and dataset.base_url.endswith("/")
    for file in datasets.files_of(dataset.name):
        # the commit
        assert any(len(part) == 40 for part in datasets.url_of(dataset.name, file).split("/"))
    registry = datasets._registry(dataset.name)
    assert registry and all(len(digest) == 64 for digest in registry.values())


def test_the_bar_shows_how_much_is_there(capsys: pytest.CaptureFixture[str]) -> None:
    bar = datasets._Bar()
    bar.reset()
    bar.total = 100
    bar.update(40)
    bar.update(60)
    assert bar._bar.tasks[0].completed == bar._bar.tasks[0].total == 100
    bar.close()
