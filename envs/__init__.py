"""Gymnasium environments whose dynamics are the battery-dissemination model.

`homeward/OutAndBack-v0`, `homeward/Survey-v0` and `homeward/Patrol-v0` are registered on
`import homeward`; without an import use `gym.make("homeward:homeward/Survey-v0")`.
`homeward/MOOutAndBack-v0`, `homeward/MOSurvey-v0` and `homeward/MOPatrol-v0` have a vector of
rewards, see `homeward.envs.multi_objective`.
"""

if __name__ == "envs":
    raise ImportError("import it as homeward.envs: the folder envs/ is the source of that package")

# not `gymnasium`, of which old versions come here half imported
from gymnasium.envs import registration

__all__ = [
    "IDS", "MISSION_FILES", "MULTI_OBJECTIVE_IDS", "actions", "features", "multi_objective", "options", "register",
    "routes", "scalar", "vector", "viewer",
]  # fmt: skip

MISSION_FILES = {
    "OutAndBack": "out_and_back",
    "Survey": "survey",
    "Patrol": "patrol",
}
"""File of each mission; a further one is one file and one line here."""
IDS = {mission: f"homeward/{mission}-v0" for mission in MISSION_FILES}
"""Environment id of each mission."""
MULTI_OBJECTIVE_IDS = {mission: f"homeward/MO{mission}-v0" for mission in IDS}
"""Environment id of each mission with a vector of rewards."""


def register() -> None:
    """Register the environments with Gymnasium; called on `import homeward`. A second call does
    nothing."""
    for mission, env_id in IDS.items():
        if env_id not in registration.registry:
            registration.register(
                env_id,
                entry_point="homeward.envs.scalar:HomewardEnv",
                vector_entry_point="homeward.envs.vector:HomewardVectorEnv",
                kwargs={"mission": mission},
            )
    for mission, env_id in MULTI_OBJECTIVE_IDS.items():
        if env_id not in registration.registry:
            registration.register(
                env_id,
                entry_point="homeward.envs.multi_objective:MultiObjectiveEnv",
                disable_env_checker=True,  # it expects a scalar reward
                kwargs={"mission": mission, "shaping": "none"},
            )
