"""Settings that all tests share."""

import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

from homeward.agents.evaluation import learning_curve as curve

os.environ.setdefault("MPLBACKEND", "Agg")  # draws without a display

# PyTorch's build for GPUs loads triton with the first optimizer. After a window of pygame that ends
# the process by a segmentation fault (triton 3.7.1, pygame-ce 2.5.8), before it does not.
if importlib.util.find_spec("triton") is not None:
    importlib.import_module("triton")

# The first call of a kernel compiles it, which no deadline should count; fixed examples keep two
# runs alike.
settings.register_profile("homeward", deadline=None, derandomize=True)
settings.load_profile("homeward")


@pytest.fixture(scope="session")
def root() -> Path:
    """Folder of the checkout."""
    return Path(__file__).parents[1]


@pytest.fixture(scope="session")
def load_example(root: Path) -> Callable[[str], ModuleType]:
    """Imports an example by its name, as examples are no package."""

    def load(name: str) -> ModuleType:
        spec = importlib.util.spec_from_file_location(name, root / "examples" / f"{name}.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture(scope="module")
def short_curves() -> Iterator[None]:
    """Learning curves of few missions; most of a tiny training would be spent on them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(curve, "EPISODES", 25)
        yield


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of real recordings, from HOMEWARD_DATA; tests that need it are skipped without it."""
    folder = os.environ.get("HOMEWARD_DATA")
    if not folder:
        pytest.skip("HOMEWARD_DATA does not name a folder of recordings")
    return Path(folder)
