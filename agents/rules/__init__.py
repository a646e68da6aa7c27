"""Rules for turning back, with one shared choice of speed, sensing and stops."""
