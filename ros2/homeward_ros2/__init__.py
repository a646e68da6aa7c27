"""The node of homeward in a robot's own Python (3.10 or later), with the standard library and rclpy
alone.

`node` subscribes and publishes, `process` runs `homeward watch --stdin` in an environment of its
own, `messages` turns messages to JSON and back, `check` prints whether all of it works on a robot.
`interface.json` is the table of topics, types and quality of service, which homeward has too.
"""
