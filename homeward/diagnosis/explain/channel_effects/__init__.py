"""Effects that other channels than power identify, one file for each channel or law.

Power at the terminals does not show losses inside the battery. But the voltage sags by the current
times a resistance, and the state of charge falls by the energy drawn and lost over the capacity.
One capacity for all runs is a parameter, refitted like the others; one that shrinks from run to run
is ageing; and a loss that grows with the load or in the cold is an effect of the battery. Each is
validated as any effect: it must lower the held-out error of its channel, by more than on random
signs of blocks (wild cluster bootstrap).
"""
