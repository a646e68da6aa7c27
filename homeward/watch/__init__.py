"""Tests of the companion on recordings, replayed as if live, and predictions of routes before they
are driven."""
