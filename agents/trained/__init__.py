"""Trained policies: as files, on the robot, and with their provenance; without torch."""

__all__ = ["inputs", "onnx_policy", "policy_file"]
