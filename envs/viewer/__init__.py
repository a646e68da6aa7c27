"""The viewer: a mission as a picture, in a window or as a few lines of text.

It reads the records of a batch and changes nothing in them. Pictures need pygame, the extra `view`.
"""

from homeward.envs.viewer.read_scene import scene_of
from homeward.envs.viewer.scene import Scene
from homeward.envs.viewer.text import describe
from homeward.envs.viewer.viewer import MODES, Viewer

__all__ = ["MODES", "Scene", "Viewer", "describe", "scene_of"]
