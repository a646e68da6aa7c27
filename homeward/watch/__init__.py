"""Drives watched: recordings replayed to a companion as if live, and routes looked at before they are driven."""
