"""What docs/ros2.md shows is what there is."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from homeward.companion import Companion
from homeward.watch.ros2 import LOOPBACK
from homeward.watch.ros2.advice_messages import messages


@pytest.fixture(scope="module")
def page(root: Path) -> str:
    return (root / "docs" / "ros2.md").read_text("utf-8")


@pytest.fixture(scope="module")
def published() -> dict[str, str]:
    """Topics and types, in their short form."""
    advice = Companion("husky").update(0.0, position=100.0)
    return {
        name: kind.replace("/msg/", "/")
        for name, kind, _ in messages(advice, 1.7e6, "husky", [], False, "")
    }


def test_every_topic_is_listed_with_its_type(page: str, published: dict[str, str]) -> None:
    assert dict(re.findall(r"^\| `(/\w\S*)` \| `(\w+/\w+)` \|", page, re.MULTILINE)) == published


def test_the_behaviour_tree_reads_a_battery_state_that_is_published(
    page: str, published: dict[str, str]
) -> None:
    (tree,) = re.findall(r"```xml\n(.+?)```", page, re.DOTALL)
    (condition,) = ElementTree.fromstring(tree).iter("IsBatteryLow")
    assert published[condition.attrib["battery_topic"]] == "sensor_msgs/BatteryState"


def test_the_settings_that_keep_traffic_private_are_those_of_the_tests(page: str) -> None:
    (settings,) = re.findall(r"CYCLONEDDS_URI='(.+?)'", page, re.DOTALL)
    assert re.sub(r">\s+<", "><", settings) == LOOPBACK
