"""The policy that stresses the shield never comes home alone, always with it, and draws alike."""

from benchmarks.agents.shield import wanderer
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.shield import Shield
from homeward.envs.options import Options, known_of


def test_a_wanderer_strands_alone_and_comes_home_with_the_shield() -> None:
    options, seeds = Options("OutAndBack"), episode_seeds(0, 8)
    known = known_of(options)
    policies = wanderer(known), wanderer(known), Shield(wanderer(known), known)
    alone, again, safe = (run_episodes(policy, options, seeds).episodes for policy in policies)
    assert alone.stranded.all() and not safe.stranded.any() and safe.score.min() > 0.0
    assert (alone.furthest_m == again.furthest_m).all()
