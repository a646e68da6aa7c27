"""From recordings to signals: corrections for noise and faults of their instruments."""
