"""A guess is a line of a mapping file, which reads as what was guessed."""

import tomllib

from homeward.logs.columns import Source, source_of
from homeward.logs.guess import Guess


def test_the_line_of_a_guess_reads_as_the_guess() -> None:
    guess = Guess('Temp "F"\n', "temperature_c", 5 / 9, -160 / 9, 2, "why\nso")
    (entry,) = tomllib.loads(guess.entry()).values()
    assert source_of("", entry, "column") == Source(
        (('Temp "F"\n', round(5 / 9, 12)),), round(-160 / 9, 8)
    )
    assert guess.entry().endswith("# a guess: why?so")
    both = Guess("Date", "time_s", 1.0, 0.0, 0, "joined", and_column="Time")
    assert tomllib.loads(both.entry()) == {"time_s": {"columns": ["Date", "Time"]}}
