"""Pictures of one episode show a typical one."""

from homeward.agents.evaluation.episode_plots import typical_episode
from tests.agents.evaluation.runs import compared, made_up


def test_the_picture_shows_a_middling_episode() -> None:
    assert typical_episode(compared(a=made_up([9.0, 1.0, 5.0]), b=made_up([8.0, 0.0, 6.0]))) == 2
    assert typical_episode(compared(a=made_up([0.0, 0.0, 9.0]), b=made_up([5.0, 6.0, 7.0]))) == 1
