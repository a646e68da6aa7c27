"""Recordings in, signals out: what their instruments do to them."""
