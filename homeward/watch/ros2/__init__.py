"""`homeward watch --ros2`: a robot's ROS 2 network joined without ROS, by Eclipse Cyclone DDS (extra `ros2`).

Topics are subscribed under the names that ROS 2 gives them in DDS (`network`), with types made from their message
definitions (`idl`). A mapping selects fields as readings (`listener`), on a continuous clock (`stamps`) and in a
continuous frame (`odometry`), whatever the publishers do. `node` runs the companion and publishes its advice
(`advice_messages`).
"""

LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General>"
    '<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="localhost"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)
"""CYCLONEDDS_URI that keeps all traffic on this computer."""
