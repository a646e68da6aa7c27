"""Groups of runs, driven or standing: what differs between them. Uses the diagnosis, which knows nothing of groups."""
