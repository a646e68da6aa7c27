"""Print how long the first use of each part takes on a machine that has compiled nothing, and from
then on.

    python benchmarks/first_use.py

Each part runs in processes of its own: once with an empty folder for compiled kernels, and once
more.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[1]))

import homeward
from benchmarks.tables import table

ROOT = Path(__file__).parents[1]
FIRST_USES = {
    "reset and step": """
import gymnasium
env = gymnasium.make("homeward/Survey-v0")
env.reset(seed=0)
env.step([4, 2, 1])
""",
    "Companion": """
from homeward.companion import Companion
companion = Companion("husky", home=(0.0, 0.0))
for time_s in (0.0, 1.0):
    companion.update(time_s, position=(time_s, 0.0), speed_mps=1.0, power_w=100.0, soc=0.9, grade_rad=0.0)
""",
    "load_onboard": """
from homeward.agents.onboard import load_onboard
policy = load_onboard("ppo", "OutAndBack")
policy.update(0.0, 0.0, soc=1.0)
policy.update(30.0, 30.0, soc=0.99)
""",
    "diagnose": """
import contextlib, io, pathlib, sys
sys.path.insert(0, sys.argv[1])
import diagnose
with contextlib.redirect_stdout(io.StringIO()):
    diagnose.main(diagnose.Args(robot="husky", out=pathlib.Path(sys.argv[2]) / "diagnosis"))
""",
}
"""Code of each part; `diagnose` takes the recording that ships."""
_TIMED = "import time; start = time.perf_counter(); import homeward\n{}\nprint(time.perf_counter() - start)"


def seconds(code: str, folder: str) -> float:
    """Seconds that code takes in a new process, from `import homeward` on, with kernels kept in a
    folder."""
    done = subprocess.run(
        [sys.executable, "-c", _TIMED.format(code), str(ROOT), folder],
        cwd=ROOT, env=os.environ | {"HOMEWARD_CACHE": folder}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return float(done.stdout)


def main() -> None:
    """Measure each part and print the table."""
    shown = table(
        f"homeward {homeward.__version__}, {os.cpu_count()} cores",
        ("part",),
        ("first, s", "again, s"),
    )
    total_s = 0.0
    for part, code in FIRST_USES.items():
        with tempfile.TemporaryDirectory() as folder:
            first_s = seconds(code, folder)
            again_s = seconds(code, folder)
        total_s += first_s
        shown.add_row(part, f"{first_s:.1f}", f"{again_s:.1f}")
    shown.add_row("sum", f"{total_s:.1f}", "")
    Console().print(shown)


if __name__ == "__main__":
    main()
