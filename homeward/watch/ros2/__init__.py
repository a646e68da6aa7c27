"""`homeward watch --ros2`: a robot's ROS 2 network joined without ROS, by Eclipse Cyclone DDS
(extra `ros2`).

Topics are subscribed under the names that ROS 2 gives them in DDS (`network`), with types made from
their message definitions (`idl`). Advice is published as messages of ROS 2 (`advice_messages`).
"""

LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General>"
    '<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="localhost"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)
"""CYCLONEDDS_URI that keeps all traffic on this computer."""
