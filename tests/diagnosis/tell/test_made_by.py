"""What made a verdict: version, seed and thresholds."""

import json

import homeward
from homeward.diagnosis import thresholds
from homeward.diagnosis.tell.made_by import made_by
from homeward.logs import thresholds as logs_thresholds


def test_it_names_version_seed_and_every_threshold() -> None:
    made = made_by(7)
    assert (made.version, made.seed) == (homeward.__version__, 7)
    assert made.thresholds["diagnosis.FALSE_ALARM_RATE"] == thresholds.FALSE_ALARM_RATE
    for package, module in (("diagnosis", thresholds), ("logs", logs_thresholds)):
        names = {
            f"{package}.{name}"
            for name in vars(module)
            if name.isupper() and not name.startswith("_")
        }
        assert len(names) > 20 and names <= made.thresholds.keys()
    assert json.loads(json.dumps(made.thresholds, allow_nan=False)) == made.thresholds
