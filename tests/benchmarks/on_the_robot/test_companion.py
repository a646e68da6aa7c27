"""Who turns when the companion says so comes home, nearly as far out as with the shield."""

from benchmarks.on_the_robot.companion import Advised, AdvisedByGauge
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.shield import Shield
from homeward.agents.shield.reckless import Onward
from homeward.envs.options import Options, known_of


def test_missions_come_home_nearly_as_far_out_as_with_the_shield() -> None:
    options, seeds = Options("OutAndBack"), episode_seeds(0, 8)
    known = known_of(options)
    companion = run_episodes(Advised(known), options, seeds).episodes
    shield = run_episodes(Shield(Onward(known), known), options, seeds).episodes
    assert companion.home.all() and companion.score.min() > 0.5 * shield.score.max()
    assert companion.score.sum() > 0.9 * shield.score.sum()


def test_they_come_home_by_a_coarse_gauge_that_lags() -> None:
    options, seeds = Options("OutAndBack"), episode_seeds(0, 16)
    policy = AdvisedByGauge(known_of(options))
    assert run_episodes(policy, options, seeds).episodes.home.all()
