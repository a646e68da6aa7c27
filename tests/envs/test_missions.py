"""All missions: each is found by its name, and kernels find its functions by its number."""

from __future__ import annotations

from types import SimpleNamespace

from homeward.envs import IDS, MISSION_FILES
from homeward.envs.missions import CODES, MISSIONS, by_mission


def test_every_mission_has_its_file_its_name_and_its_id() -> None:
    assert list(MISSIONS) == list(MISSION_FILES) == list(IDS)
    assert [mission.name for mission in MISSIONS.values()] == list(MISSIONS)


def test_a_function_by_mission_is_that_of_the_mission() -> None:
    m = SimpleNamespace(furthest_m=1.0, delivered=2.0, backlog_information=3.0, legs=8.0)
    score = by_mission("score", "m, shared")
    assert [
        score(m, SimpleNamespace(mission=CODES[name]))
        for name in ("OutAndBack", "Survey", "Patrol")
    ] == [1, 5, 4]
