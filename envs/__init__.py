"""Gymnasium environments around the model."""

if __name__ == "envs":
    raise ImportError("import it as homeward.envs: the folder envs/ is the source of that package")
