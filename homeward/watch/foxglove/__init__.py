"""`homeward watch --foxglove` and `--mcap`: an advice as live pictures, by `foxglove-sdk` (extra
`foxglove`).

`stream` publishes it by a WebSocket server, and writes the same to an MCAP file. `layout.json` is a
layout for it, and `layout_ros2.json` one for the topics that `homeward watch --ros2` publishes.
"""
