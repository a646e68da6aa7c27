"""One companion updated many times: time, memory and state are printed, and memory does not grow with the updates."""

import re

import pytest

from benchmarks.on_the_robot.update import Args, main
from homeward.companion import CompanionError


def test_memory_stays_flat(capsys: pytest.CaptureFixture[str]) -> None:
    main(Args(updates=2000))
    printed = capsys.readouterr().out
    first_mb, _, last_mb = (float(one) for one in re.findall(r"(\d+\.\d)(?=,| MB)", printed))
    assert last_mb - first_mb < 5.0
    assert re.search(r"CPU time of an update, median, 99 % +\d+\.\d\d, \d+\.\d\d ms", printed)


def test_too_few_updates() -> None:
    with pytest.raises(CompanionError, match="at least 100 --updates"):
        main(Args(updates=3))
