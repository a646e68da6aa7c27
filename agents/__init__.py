"""Agents: baselines, planner and learners."""

if __name__ == "agents":
    raise ImportError("import it as homeward.agents: the folder agents/ is the source of that package")
