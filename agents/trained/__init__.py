"""Trained policies: as files, on the robot, and what they were made with; free of torch."""

__all__ = ["inputs", "onnx_policy", "policy_file"]
