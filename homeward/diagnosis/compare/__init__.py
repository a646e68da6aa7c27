"""Groups of runs and robots that stand: what differs between them."""
