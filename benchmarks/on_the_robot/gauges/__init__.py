"""Companion against faulty battery gauges, on a simulator of its own.

`python -m benchmarks.on_the_robot.gauges --drives 200 --seed 1` drives robots with five chemistries
and eight kinds of gauge out until an agent says that they must turn, and then home. Of `homeward`
it imports only the companion, as a user does, and the table helper of the benchmarks. Battery,
ground, gauges and instruments are in this package; the size of every fault is in
`gauge_faults.toml`.
"""
