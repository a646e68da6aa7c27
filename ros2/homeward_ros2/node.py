"""The node: subscribes to what homeward asks for, passes it on, and publishes what homeward
answers.

`ros2 run homeward_ros2 node --ros-args -p robot:=/etc/robot/corrected.toml -p
homeward:=/opt/homeward/bin/homeward`. The same topics, types and quality of service as `homeward
watch --ros2`, by the table in interface.json.
"""

from __future__ import annotations

import functools
import json
import os
import signal
import tempfile
import time
import zlib

import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from homeward_ros2.messages import UnknownType, class_of, filled, needed
from homeward_ros2.process import Process

with open(os.path.join(os.path.dirname(__file__), "interface.json")) as _file:
    INTERFACE = json.load(_file)
DEFAULTS = {
    "homeward": "homeward", "robot": "", "topics_below": "", "state": "", "arguments": [""], "restart_s": 5.0,
    "silent_s": 10.0, "hang_s": 300.0,
}  # fmt: skip
"""Parameters, as config/homeward.yaml describes them."""

PERIOD_S = 0.1  # as of `homeward watch --ros2`: messages are combined over so long
LOOKS_S = 1.0
"""Time between looks at the topics and their publishers, and between the node's own diagnostics.
Chosen."""
GAP_S = 0.3
"""Time without a message of a topic after which its publishers are looked at again before the next
is passed on: one that has started again is told from the one before. Chosen: no process starts
again within it."""
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
OK, WARN, ERROR, STALE = range(4)  # diagnostic_msgs/DiagnosticStatus
UNUSABLE = 2  # exit code of homeward for input that cannot be used: no start again mends it


def quality(of):
    """A quality of service of the table."""
    return QoSProfile(
        reliability=ReliabilityPolicy[of["reliability"].upper()],
        durability=DurabilityPolicy[of["durability"].upper()],
        history=HistoryPolicy.KEEP_LAST,
        depth=of["depth"],
    )


class Bridge:
    """Connects a node with a process of homeward; `step` is called regularly.

    Args:
        node: A node of rclpy.

    Raises:
        ValueError: The parameter `robot` is missing.
    """

    def __init__(self, node):
        self._node = node
        for name, value in DEFAULTS.items():
            node.declare_parameter(name, value)
        self._settings = {name: node.get_parameter(name).value for name in DEFAULTS}
        if not self._settings["robot"]:
            raise ValueError("the parameter robot is missing: give a preset or a robot file")
        self._folder = None
        if not self._settings["state"]:
            self._folder = tempfile.TemporaryDirectory(prefix="homeward-")
            self._settings["state"] = os.path.join(self._folder.name, "state.json")
        self._process, self._why = None, ""
        self._starts_s, self._started, self._looked_s = 0.0, 0, -1e9
        self._topics = {}
        self._readers, self._fields, self._unknown = {}, {}, set()
        self._heard, self._identity = {}, {}  # by topic: when it last spoke, and who publishes it
        self._writers = {}
        self._silent = False

    def command(self):
        """The command that is run, with its arguments."""
        settings = self._settings
        command = [
            settings["homeward"],
            "watch",
            "--stdin",
            "--robot",
            settings["robot"],
            "--state",
            settings["state"],
        ]
        if settings["topics_below"]:
            command += ["--namespace", settings["topics_below"]]
        return command + [word for word in settings["arguments"] if word]

    def step(self):
        """Start homeward where it does not run, pass on what it writes, and say what is wrong."""
        now_s = time.monotonic()
        self._keep_running(now_s)
        if now_s - self._looked_s >= LOOKS_S:
            self._looked_s = now_s
            self._look()
            self._diagnose(now_s)
        if self._process is not None:
            for line in self._process.take():
                self._obey(line)

    def end(self):
        """End homeward, which saves its state."""
        if self._process is not None:
            self._process.end()
            self._process = None
        if self._folder is not None:
            self._folder.cleanup()

    def _keep_running(self, now_s):
        log = self._node.get_logger()
        if self._process is not None:
            code = self._process.code()
            if code is None and now_s - self._process.spoke_s > self._settings["hang_s"]:
                self._why = f"homeward wrote nothing for {now_s - self._process.spoke_s:.0f} s and was ended"
            elif code is None:
                return
            else:
                for line in self._process.take():
                    self._obey(line)
                self._why = f"homeward ended with exit code {code}: {self._process.last_error}"
            self._process.end()
            self._process, self._starts_s = None, now_s + self._settings["restart_s"]
            if code == UNUSABLE:
                self._starts_s = float("inf")
                self._why += "; mend it and start this node again"
            log.error(self._why)
        if self._process is None and now_s >= self._starts_s:
            try:
                self._process = Process(self.command(), lambda line: log.info(f"homeward: {line}"))
            except OSError as error:
                self._why = f"homeward cannot be started: {error}; set the parameter homeward to its command"
                log.error(self._why)
                self._starts_s = now_s + self._settings["restart_s"]
                return
            self._started += 1
            log.info(f"started: {' '.join(self.command())}")
            self._topics = {}

    def _look(self):
        """Tell homeward which topics are published, and by whom they are."""
        names = {name: kinds[0] for name, kinds in self._node.get_topic_names_and_types() if kinds}
        topics = {
            name: kind
            for name, kind in names.items()
            if self._node.get_publishers_info_by_topic(name)
        }
        if self._process is not None and topics != self._topics:
            self._topics = topics
            self._process.send({"topics": topics})
        for name in self._readers:
            self._identify(name)

    def _identify(self, name):
        """A number for the present publishers of a topic: another one after a restart."""
        infos = self._node.get_publishers_info_by_topic(name)
        if infos:  # one that has died may not be replaced yet
            self._identity[name] = zlib.crc32(
                repr(sorted(list(info.endpoint_gid) for info in infos)).encode()
            )

    def _obey(self, line):
        if "subscribe" in line:
            for name, wanted in line["subscribe"].items():
                self._subscribe(name, wanted["type"], wanted["fields"])
        elif "publish" in line:
            self._publish(line["publish"], line["type"], line["content"])

    def _subscribe(self, name, kind, fields):
        self._fields[name] = fields
        if name in self._readers or name in self._unknown:
            return
        try:
            made = class_of(kind)
        except UnknownType as error:
            self._unknown.add(name)
            self._node.get_logger().warn(f"{name} is left out: {error}")
            return
        self._identify(name)
        heard = functools.partial(self._pass_on, name)
        self._readers[name] = self._node.create_subscription(
            made, name, heard, quality(INTERFACE["subscriptions"])
        )

    def _pass_on(self, name, message):
        if self._process is None:
            return
        now_s = time.monotonic()
        if now_s - self._heard.get(name, -1e9) > GAP_S:
            self._identify(name)
        self._heard[name] = now_s
        content = needed(message, self._fields[name])
        self._process.send(
            {"topic": name, "publisher": self._identity.get(name, 0), "content": content}
        )

    def _publish(self, name, kind, content):
        if name not in self._writers:
            made = self._node.create_publisher(
                class_of(kind), name, quality(INTERFACE["publications"])
            )
            self._writers[name] = made
        self._writers[name].publish(filled(kind, content))

    def _diagnose(self, now_s):
        """Publish whether homeward runs and speaks, and log when that changes."""
        level, text = ERROR, self._why
        if self._process is not None:
            silent_s = now_s - self._process.spoke_s
            silent = silent_s > self._settings["silent_s"]
            level, text = (
                (STALE, f"homeward has written nothing for {silent_s:.0f} s")
                if silent
                else (OK, "runs")
            )
            if silent and not self._silent:
                self._node.get_logger().warn(text)
            self._silent = silent
            if level == OK and self._process.dropped:
                level, text = (
                    WARN,
                    f"homeward is too slow: {self._process.dropped} messages were dropped",
                )
        seconds, rest_ns = divmod(time.time_ns(), 10**9)
        status = {
            "level": level, "name": f"{self._settings['topics_below']}/homeward: process".lstrip("/"), "message": text,
            "values": [{"key": "starts", "value": str(self._started)}],
        }  # fmt: skip
        header = {"stamp": {"sec": seconds, "nanosec": rest_ns}}
        self._publish("/diagnostics", DIAGNOSTICS, {"header": header, "status": [status]})


def main(arguments=None):
    """Run the node until it is interrupted."""
    rclpy.init(args=arguments)
    node = rclpy.create_node("homeward")
    try:
        bridge = Bridge(node)
    except ValueError as error:
        node.get_logger().error(str(error))
        node.destroy_node()
        rclpy.try_shutdown()
        raise SystemExit(2) from None
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # homeward saves its state then, too
    node.create_timer(PERIOD_S, bridge.step)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        bridge.end()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
