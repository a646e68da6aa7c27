"""The learner, and trained policies as files; only what trains imports torch and Stable-Baselines3."""
