"""The ROS 2 network: topics found, subscribed and published by Cyclone DDS, under their names in
DDS."""

from __future__ import annotations

from typing import Any, ClassVar

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, InstanceState, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from homeward.companion import CompanionError
from homeward.watch.online.link import Message, News
from homeward.watch.ros2.advice_messages import Content, messages
from homeward.watch.ros2.idl import kind_of, message, struct_of
from homeward.watch.ros2.interface import PUBLICATIONS, SUBSCRIPTIONS, Quality, is_meant

_PREFIX = "rt"  # of topics, before their name with its slash (design.ros2.org)
_MOST = 1000  # news of publishers read at a time; chosen: more than a robot has topics
# the one that every ROS 2 has
_REPRESENTATION = Policy.DataRepresentation(use_cdrv0_representation=True)
_RELIABILITY = {
    "best_effort": Policy.Reliability.BestEffort,
    "reliable": Policy.Reliability.Reliable(0),
}
_DURABILITY = {"volatile": Policy.Durability.Volatile}


def _qos(quality: Quality) -> Qos:
    return Qos(
        _RELIABILITY[quality.reliability], _DURABILITY[quality.durability], Policy.History.KeepLast(quality.depth),
        _REPRESENTATION,
    )  # fmt: skip


class Network:
    """One participant of a domain.

    Args:
        domain: Its number, ROS_DOMAIN_ID in ROS 2.
        namespace: Topics of others are found, and advice is published, below it; "" for all.

    Attributes:
        unreadable: Number of messages of each topic that could not be read.

    Raises:
        CompanionError: It cannot be joined.
    """

    SAVED: ClassVar[tuple[str, ...]] = ()

    def __init__(self, domain: int, namespace: str = "") -> None:
        try:
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise CompanionError(
                f"cannot join domain {domain}: {error}; check CYCLONEDDS_URI and the network interface that it names"
            ) from None
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._namespace = namespace
        self.unreadable: dict[str, int] = {}
        self._found: dict[str, str] = {}
        self._readers: dict[str, DataReader[Any]] = {}
        self._writers: dict[str, DataWriter[Any]] = {}

    def found(self) -> dict[str, str]:
        """Topics that others publish or have published, with the types of their messages, as far as
        known."""
        for publication in self._publications.take(_MOST):
            alive = publication.sample_info.instance_state == InstanceState.Alive
            if (
                alive
                and publication.topic_name.startswith(f"{_PREFIX}/")
                and publication.participant_key != self._participant.guid
            ):
                kind = kind_of(publication.type_name)
                name = publication.topic_name.removeprefix(_PREFIX)
                if kind is not None and is_meant(name, self._namespace):
                    self._found[name] = kind
        return dict(self._found)

    def subscribe(self, topics: dict[str, str], fields: dict[str, list[str]]) -> None:
        """Subscribe to topics, by name and type, that are not subscribed yet: best effort, as
        sensors publish."""
        for name, kind in topics.items():
            if name not in self._readers:
                topic = Topic(self._participant, f"{_PREFIX}{name}", struct_of(kind))
                self._readers[name] = DataReader(self._participant, topic, qos=_qos(SUBSCRIPTIONS))

    def take(self) -> list[Message]:
        """Messages since the last call, in order for each topic."""
        messages = []
        for name, reader in self._readers.items():
            try:
                samples = reader.take(SUBSCRIPTIONS.depth)
            # bytes that do not fit the type raise anything, from struct.error to UnicodeDecodeError
            except Exception:
                self.unreadable[name] = self.unreadable.get(name, 0) + 1
                continue
            messages += [
                Message(name, sample, sample.sample_info.publication_handle)
                for sample in samples
                if sample.sample_info.valid_data
            ]
        return messages

    def faults(self) -> list[str]:
        """Messages that could not be read."""
        return [
            f"messages of {name} do not fit their type and are left out" for name in self.unreadable
        ]

    def tell(self, news: News) -> None:
        """Publish an advice.

        Raises:
            CompanionError: It cannot be published now.
        """
        try:
            for name, kind, content in messages(*news, self._namespace):
                self.publish(name, kind, content)
        except DDSException as error:
            raise CompanionError(str(error)) from None

    def publish(self, name: str, kind: str, content: Content) -> None:
        """Publish a message, reliably for subscribers that request that."""
        if name not in self._writers:
            topic = Topic(self._participant, f"{_PREFIX}{name}", struct_of(kind))
            self._writers[name] = DataWriter(self._participant, topic, qos=_qos(PUBLICATIONS))
        self._writers[name].write(message(kind, **content))
