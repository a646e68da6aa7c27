"""A robot watched over its ROS 2 network, without ROS: by Eclipse Cyclone DDS (extra `ros2`).

Topics are found and subscribed under the names that ROS 2 gives them in DDS (`network`), with types made from their
message definitions (`idl`). What a mapping names of them becomes readings (`listener`), on a clock (`stamps`) and in a
frame (`odometry`) that go on whatever the publishers do. `node` asks the companion, and publishes its advice
(`advice_messages`).
"""

LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General>"
    '<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="localhost"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)
"""CYCLONEDDS_URI with which nothing leaves this computer."""
