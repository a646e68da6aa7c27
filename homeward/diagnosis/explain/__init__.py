"""Residual tests, location, hypotheses, their validation and the joint fit."""
