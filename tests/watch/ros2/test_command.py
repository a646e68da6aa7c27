"""`homeward watch --ros2`: what cannot be used takes one line."""

import os
import sys
from pathlib import Path

import pytest

from homeward.commands.watch import Args, main
from homeward.companion import Companion, CompanionError
from homeward.diagnosis import RecordingError


@pytest.mark.parametrize("package", ["cyclonedds", "rosbags"])
def test_without_the_extra_a_line_names_it(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [
        one
        for one in sys.modules
        if one.startswith(
            ("homeward.watch.ros2", "homeward.watch.online", f"{package}.", "homeward.logs.bags.")
        )
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(
        CompanionError, match=rf"--ros2 needs {package}.*: pip install .*(ros2|cyclonedds rosbags)"
    ):
        main(Args((), "husky", ros2=True))


@pytest.mark.parametrize("domain", ["-1", "233", "one", "²"])
def test_a_domain_that_there_is_not(domain: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(
        CompanionError, match=f"ROS domain '{domain}' is not allowed; give a number from 0 to 232"
    ):
        main(Args((), "husky", ros2=True))


def test_what_does_not_go_together() -> None:
    with pytest.raises(RecordingError, match="accepts no recordings"):
        main(Args((Path("run.csv"),), "husky", ros2=True))
    with pytest.raises(CompanionError, match="with a leading slash"):
        main(Args((), "husky", ros2=True, namespace="robot1"))
    with pytest.raises(
        CompanionError, match="--namespace, --home and --docks are for --ros2 and --stdin"
    ):
        main(Args((Path("run.csv"),), "husky", docks=("bay=1,2",)))
    with pytest.raises(CompanionError, match="--domain is for --ros2"):
        main(Args((Path("run.csv"),), "husky", domain=3))


def test_docks_are_those_of_the_companion(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rosbags", reason="needs the extra logs")
    from homeward.watch.online import session

    met: list[Companion] = []

    class Met(session.Session):
        def run(self, *_: object) -> None:
            met.append(self.node.companion)

    monkeypatch.setattr(session, "Session", Met)
    with open(os.devnull) as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        main(Args((), "husky", stdin=True, docks=("bay=40,-12",)))
        with pytest.raises(
            CompanionError, match=r"dock 'bay' = 1.0 is not allowed; give \(east, north\)"
        ):
            main(Args((), "husky", stdin=True, docks=("bay=1",)))
    (companion,) = met
    (bay,) = companion.update(0.0, position=(0.0, 0.0)).others
    assert (bay.name, round(bay.way_m, 1)) == ("bay", 54.3)


def test_a_network_that_cannot_be_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cyclonedds", reason="needs the extra ros2")
    nowhere = '<General><Interfaces><NetworkInterface name="nowhere0"/></Interfaces></General>'
    monkeypatch.setenv("CYCLONEDDS_URI", f"<CycloneDDS><Domain>{nowhere}</Domain></CycloneDDS>")
    with pytest.raises(CompanionError, match=r"cannot join domain 230: .*check CYCLONEDDS_URI"):
        main(Args((), "husky", ros2=True, domain=230))
