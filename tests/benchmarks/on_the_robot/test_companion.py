"""The benchmark of the companion: who turns when it says so comes home, and no part is driven twice."""

import json
from pathlib import Path

import pytest

from benchmarks.on_the_robot import companion
from benchmarks.on_the_robot.companion import Args, main
from homeward.envs.options import OptionError


def test_missions_come_home_and_parts_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(Args(missions=8, out=tmp_path))
    file, first = tmp_path / "companion.json", capsys.readouterr().out
    content = json.loads(file.read_text())
    part = content["results"]["0"]
    assert part["stranded"] == 0 and min(part["score"]) > 0.5 * max(part["shield_score"])
    assert sum(part["score"]) > 0.9 * sum(part["shield_score"])
    part["stranded"] = 3
    file.write_text(json.dumps(content))
    main(Args(missions=8, out=tmp_path))
    assert "3, 37.500%" in capsys.readouterr().out and "0, 0.000%" in first


def test_arguments_that_cannot_be_used(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="--missions"):
        main(Args(missions=1, out=tmp_path))
    assert companion.PART <= 512
