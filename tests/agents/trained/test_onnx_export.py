"""An exported policy commands on a robot what the original decides in the environment."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

from homeward.agents.trained.environment import setting_of  # noqa: E402
from homeward.agents.trained.onnx_export import Args, ExportError, check_equal, main  # noqa: E402
from homeward.agents.trained.onnx_graph import to_onnx  # noqa: E402
from homeward.agents.trained.onnx_policy import INPUT, OUTPUTS  # noqa: E402
from homeward.agents.trained.policy_file import NetworkPolicy  # noqa: E402
from homeward.envs.features import NAMES  # noqa: E402
from homeward.envs.options import Options, known_of  # noqa: E402
from tests.agents.trained.drawn import save_drawn_policy  # noqa: E402


def test_the_file_says_what_goes_in_and_what_comes_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_drawn_policy(tmp_path)
    main(Args(tmp_path, tmp_path / "policy.onnx"))
    metadata = {one.key: one.value for one in onnx.load(tmp_path / "policy.onnx").metadata_props}
    assert [one["name"] for one in json.loads(metadata["inputs"])[INPUT]] == list(NAMES)
    assert list(json.loads(metadata["outputs"])) == list(OUTPUTS)
    assert (metadata["env"], metadata["robot"]) == ("homeward/Survey-v0", "husky")
    assert (
        float(metadata["decision_s"])
        == known_of(Options("Survey", robot="husky")).shared["decision_s"][0]
    )
    printed = capsys.readouterr().out
    assert all(name in printed for name in (*NAMES, *OUTPUTS))


@pytest.mark.parametrize("beliefs", [False, True])
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_a_file_that_decides_otherwise_is_refused(
    action_type: str, beliefs: bool, tmp_path: Path
) -> None:
    policy = save_drawn_policy(tmp_path, action_type, beliefs)
    options, known = setting_of(policy)
    check_equal(
        to_onnx(policy, options, known).SerializeToString(), policy, known, np.random.default_rng(0)
    )
    weight, bias = policy.layers[-1]
    other = NetworkPolicy(
        (*policy.layers[:-1], (weight[::-1], bias)), policy.action_space, policy.description
    )
    with pytest.raises(
        ExportError, match=r"onnxruntime commands another \w+ than the policy in \d+ of 2000"
    ):
        check_equal(
            to_onnx(other, options, known).SerializeToString(),
            policy,
            known,
            np.random.default_rng(0),
        )
