"""The interface of agents: what a column of observations is called, and that no agent inherits from
another."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from homeward import agents
from homeward.agents.base import Policy, feature
from homeward.envs.features import NAMES


def test_a_feature_is_the_column_of_its_name_in_double_precision() -> None:
    observations = np.random.default_rng(0).normal(size=(3, len(NAMES))).astype(np.float32)
    for column, name in enumerate(NAMES):
        values = feature(observations, name)
        assert values.dtype == np.float64 and values.shape == (3,)
        np.testing.assert_array_equal(values, observations[:, column])


def test_a_feature_is_a_copy() -> None:
    observations = np.ones((2, len(NAMES)), np.float32)
    feature(observations, "energy")[:] = 0.0
    assert (observations == 1.0).all()


def test_a_feature_of_no_such_name_is_refused() -> None:
    with pytest.raises(KeyError, match="luck"):
        feature(np.zeros((1, len(NAMES)), np.float32), "luck")


def below(policy: type[Any]) -> Iterator[type[Any]]:
    for one in policy.__subclasses__():
        yield one
        yield from below(one)


def test_agents_are_abstract_or_final() -> None:
    for module in pkgutil.walk_packages(agents.__path__, f"{agents.__name__}."):
        # slow to load, and it has no policies
        if not module.name.startswith(f"{agents.__name__}.learning."):
            with contextlib.suppress(ModuleNotFoundError):  # of an extra that is not installed
                importlib.import_module(module.name)
    ours = [one for one in below(Policy) if one.__module__.startswith(agents.__name__)]
    assert len(ours) > 10
    open_ended = [
        one for one in ours if not inspect.isabstract(one) and not getattr(one, "__final__", False)
    ]
    assert open_ended == []


def test_a_policy_without_actions_cannot_be_made() -> None:
    with pytest.raises(TypeError, match="abstract"):
        Policy()  # type: ignore[abstract]
