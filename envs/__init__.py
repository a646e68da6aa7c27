"""Gymnasium environments whose dynamics are the battery-dissemination model.

`homeward/OutAndBack-v0`, `homeward/Survey-v0` and `homeward/Patrol-v0`, registered on `import homeward`; without an
import, `gym.make("homeward:homeward/Survey-v0")` does both.
"""

if __name__ == "envs":
    raise ImportError("import it as homeward.envs: the folder envs/ is the source of that package")

import gymnasium as gym

IDS = {mission: f"homeward/{mission}-v0" for mission in ("OutAndBack", "Survey", "Patrol")}
"""Environment id of each mission."""


def register() -> None:
    """Register the environments with Gymnasium; called on `import homeward`, and doing nothing a second time."""
    for mission, env_id in IDS.items():
        if env_id not in gym.registry:
            gym.register(
                env_id,
                entry_point="homeward.envs.scalar:HomewardEnv",
                vector_entry_point="homeward.envs.vector:HomewardVectorEnv",
                kwargs={"mission": mission},
            )
