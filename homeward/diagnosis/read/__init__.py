"""Recordings in, signals out: tables, ROS bags, and what their instruments do to them."""
