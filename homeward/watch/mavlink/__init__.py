"""`homeward watch --mavlink`: a vehicle with an autopilot (ArduPilot, PX4) advised by MAVLink, read
by `pymavlink`.

`vehicle` receives and sends. `translate` makes of MAVLink's messages those that the topic mappings
know, as MAVROS does. `telling` says how an advice is sent.
"""
