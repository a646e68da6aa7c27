"""Prints whether all of it works on this robot, a line each; exit code 1 if something does not.

`ros2 run homeward_ros2 check --ros-args -p robot:=/etc/robot/corrected.toml -p
homeward:=/opt/homeward/bin/homeward` with the robot's drivers running; it runs for up to two
minutes, and publishes as the node does.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time

import rclpy

from homeward_ros2.messages import UnknownType, class_of
from homeward_ros2.node import INTERFACE, PERIOD_S, Bridge

LONGEST_S = 120.0
"""Time for the first start of homeward, which compiles, and its first advice. Chosen."""
TYPES = "sensor_msgs/msg/BatteryState", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"


class Report:
    """Prints lines, and counts what fails."""

    def __init__(self):
        self.failed = 0

    def say(self, works, text, remedy=""):
        """Print whether something works and, if not, what to do."""
        self.failed += not works
        print(
            f"{'works' if works else 'FAILS'}: {text}"
            + ("" if works or not remedy else f"; {remedy}"),
            flush=True,
        )


class Listens(Bridge):
    """A bridge that keeps what was said in both directions."""

    def __init__(self, node):
        super().__init__(node)
        self.asked, self.published = {}, {}

    def _subscribe(self, name, kind, fields):
        self.asked[name] = kind
        super()._subscribe(name, kind, fields)

    def _publish(self, name, kind, content):
        if kind != "diagnostic_msgs/msg/DiagnosticArray":
            self.published[name] = content
        super()._publish(name, kind, content)

    def heard(self):
        """Topics of which a message was received."""
        return set(self._heard)

    def wrong(self):
        """Why homeward does not run, or an empty text."""
        return "" if self._process is not None else self._why


def check(node, report, longest_s=LONGEST_S):
    """Check everything, with a node."""
    report.say(
        sys.version_info >= (3, 10), f"Python {sys.version.split()[0]}", "3.10 or later is needed"
    )
    for kind in [*TYPES, *dict.fromkeys(INTERFACE["published"].values())]:
        try:
            class_of(kind)
            report.say(True, f"type {kind}")
        except UnknownType as error:
            report.say(
                False,
                str(error),
                f"apt install ros-$ROS_DISTRO-{kind.split('/')[0].replace('_', '-')}",
            )
    try:
        bridge = Listens(node)
    except ValueError as error:
        report.say(False, str(error))
        return
    command = bridge.command()[0]
    if shutil.which(command) is None:
        report.say(
            False,
            f"command {command} is not there",
            "set the parameter homeward to that of its environment",
        )
        bridge.end()
        return
    version = subprocess.run([command, "watch", "--help"], capture_output=True, text=True)
    report.say(
        version.returncode == 0 and "--stdin" in version.stdout,
        f"command {command} knows watch --stdin",
    )
    try:
        _run(node, report, bridge, longest_s)
    finally:
        bridge.end()


def _run(node, report, bridge, longest_s):
    """Run homeward until it advises, or the time is over."""
    ends_s = time.monotonic() + longest_s
    wanted = {name for name in INTERFACE["published"] if name != "/diagnostics"}
    while time.monotonic() < ends_s and not bridge.wrong():
        rclpy.spin_once(node, timeout_sec=PERIOD_S)
        bridge.step()
        said = {name[name.index("/homeward/") :] for name in bridge.published}
        if wanted <= said:
            break
    report.say(not bridge.wrong(), f"homeward runs: {' '.join(bridge.command())}", bridge.wrong())
    report.say(
        bool(bridge.asked),
        "homeward subscribes",
        "no topic of a known type is published: are drivers running?",
    )
    for name, kind in sorted(bridge.asked.items()):
        report.say(name in bridge.heard(), f"messages of {name} ({kind})", "none was received")
    for name in sorted(wanted):
        there = any(other.endswith(name) for other in bridge.published)
        report.say(there, f"advice on {name}", "none yet: speed, by odometry, is needed")


def main(arguments=None):
    """Check, and exit with 1 if something fails."""
    rclpy.init(args=arguments)
    node, report = rclpy.create_node("homeward"), Report()
    try:
        check(node, report)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    print("all of it works" if not report.failed else f"{report.failed} of it fail")
    raise SystemExit(1 if report.failed else 0)


if __name__ == "__main__":
    main()
