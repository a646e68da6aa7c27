"""Rules: when to turn back, at one pace that all share."""
