"""The environment of a policy's training is found in its file, or the file says that it is not
there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from homeward.agents.trained.environment import options_of, setting_of
from homeward.agents.trained.policy_file import PolicyFileError
from homeward.agents.trained.provenance import robot_hash
from homeward.envs.options import OptionError, Options, known_of
from tests.agents.trained.drawn import save_drawn_policy


def test_another_robot_than_the_trained_one_is_refused(tmp_path: Path) -> None:
    hashed = robot_hash(known_of(Options("Survey", robot="jackal")))
    policy = save_drawn_policy(tmp_path, made_with={"robot": hashed})
    with pytest.raises(
        PolicyFileError,
        match=r"robot 'husky' has other parameters .* give the file of that one with --robot",
    ):
        setting_of(policy)
    assert setting_of(policy, "jackal")[1].robot.name == "jackal"


@pytest.mark.parametrize("training", [None, {}, {"env": "homeward/Nothing-v0"}])
def test_a_policy_of_unknown_origin_is_refused(training: Any, tmp_path: Path) -> None:
    with pytest.raises(PolicyFileError, match="does not say which environment"):
        setting_of(save_drawn_policy(tmp_path, training=training))


def test_keywords_are_those_of_the_training(tmp_path: Path) -> None:
    training = {
        "env": "homeward/Patrol-v0", "robot": "husky", "difficulty": "harsh", "decision_s": 60.0, "discount": 0.9,
        "seed": 3, "steps": 1000,
    }  # fmt: skip
    options = options_of(save_drawn_policy(tmp_path, training=training))
    assert options == Options(
        "Patrol", robot="husky", difficulty="harsh", decision_s=60.0, discount=0.9
    )


def test_keywords_that_are_given_go_before_those_of_the_training(tmp_path: Path) -> None:
    policy = save_drawn_policy(tmp_path)
    assert options_of(policy, difficulty="known", robot="jackal") == Options(
        "Survey", robot="jackal", action_type="discrete", difficulty="known"
    )


def test_the_setting_is_of_the_robot_that_the_policy_was_trained_on(tmp_path: Path) -> None:
    trained_in = known_of(Options("Survey", robot="husky"))
    options, known = setting_of(
        save_drawn_policy(tmp_path, made_with={"robot": robot_hash(trained_in)})
    )
    assert (options.mission, options.robot) == ("Survey", "husky")
    assert known.shared.tobytes() == trained_in.shared.tobytes()


@pytest.mark.parametrize("made_with", [None, {}, []])
def test_a_policy_that_does_not_say_what_it_was_made_with_is_taken_at_its_word(
    made_with: Any, tmp_path: Path
) -> None:
    assert setting_of(save_drawn_policy(tmp_path, made_with=made_with))[1].robot.name == "husky"


def test_a_training_of_invalid_options_says_which(tmp_path: Path) -> None:
    training = {"env": "homeward/Survey-v0", "robot": "husky", "difficulty": "easy"}
    with pytest.raises(OptionError, match="difficulty = 'easy' is not allowed"):
        setting_of(save_drawn_policy(tmp_path, training=training))
