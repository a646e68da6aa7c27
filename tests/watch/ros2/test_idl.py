"""DDS types of messages: names, and bytes on the wire as another library has them."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from homeward.companion import CompanionError
from homeward.watch.ros2 import idl
from homeward.watch.ros2.idl import kind_of, message, struct_of

KINDS = (
    "sensor_msgs/msg/BatteryState", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState",
    "std_msgs/msg/Bool", "std_msgs/msg/Float64", "diagnostic_msgs/msg/DiagnosticArray",
    "geometry_msgs/msg/TwistStamped",
)  # fmt: skip


def drawn(store: Any, definition: Any, rng: np.random.Generator) -> Any:
    """A random content of a field, as rosbags wants it."""
    node, content = definition
    if node == Nodetype.NAME:
        return store.types[content](
            *(drawn(store, one, rng) for _, one in store.fielddefs[content][1])
        )
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        inner, size = content
        several = [drawn(store, inner, rng) for _ in range(size or int(rng.integers(0, 4)))]
        plain = inner[0] == Nodetype.NAME or inner[1][0] == "string"
        return several if plain else np.array(several, inner[1][0])
    name = content[0]
    if name == "string":
        return "grüße"[: int(rng.integers(0, 6))]
    if name == "bool":
        return bool(rng.integers(2))
    return (
        float(np.float32(rng.normal())) if name.startswith("float") else int(rng.integers(0, 100))
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("release", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
def test_bytes_on_the_wire_are_those_of_rosbags(kind: str, release: Stores) -> None:
    store: Any = get_typestore(release)
    rng = np.random.default_rng(1)
    for _ in range(5):
        content = bytes(store.serialize_cdr(drawn(store, (Nodetype.NAME, kind), rng), kind))
        read = struct_of(kind).deserialize(content)
        assert bytes(read.serialize(use_version_2=False)) == content


@pytest.mark.parametrize("kind", KINDS)
def test_a_type_has_the_name_that_ros_2_gives_it(kind: str) -> None:
    package, _, name = kind.split("/")
    type_name = f"{package}::msg::dds_::{name}_"
    assert struct_of(kind).__idl_typename__.replace(".", "::") == type_name
    assert kind_of(type_name) == kind
    assert kind_of(type_name.removesuffix("_")) is None


def test_a_type_that_ships_here_is_known() -> None:
    assert (
        kind_of("clearpath_platform_msgs::msg::dds_::Power_") == "clearpath_platform_msgs/msg/Power"
    )
    assert kind_of("some_robot_msgs::msg::dds_::Battery_") is None


def test_a_message_is_filled_up() -> None:
    state: Any = message("sensor_msgs/msg/BatteryState", voltage=24.5)
    assert (state.voltage, state.header.stamp.sec, state.cell_voltage) == (24.5, 0, [])
    assert len(message("sensor_msgs/msg/Imu").serialize(use_version_2=False)) > 300


def test_a_field_without_a_type_in_dds_takes_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(idl._BASES, "float64")
    idl.struct_of.cache_clear()
    with pytest.raises(CompanionError, match="a field of type float64 cannot be read"):
        struct_of("std_msgs/msg/Float64")
