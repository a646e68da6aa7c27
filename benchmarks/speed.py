"""Print the project's speed compared with that of peers, measured in pairs in one run.

    python benchmarks/speed.py

Ratios are medians over pairs: the peer and ours in turn, so that a drift of the machine affects
both. Effects are just above zero: their computation is timed, without a change of the mission.
"""

from __future__ import annotations

import dataclasses
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[1]))

import homeward
from benchmarks.tables import table
from homeward.diagnosis import Recording, analyse
from homeward.envs import IDS
from homeward.physics import EFFECTS, Robot, load_robot, replay
from homeward.synthetic import record

SIZES = (4096, 256, 16)
"""Missions side by side. Chosen: a large batch to a small one, by factors of 16."""
TARGETS = {
    "no effects": (1.5, 4.0, 5.0),
    "3 effects": (1.3, 3.0, 4.0),
    "all effects": (0.6, 2.0, 3.0),
}
THREE = ("turning", "wind", "internal_resistance")
PAIRS = 9  # timings of both in turn, of which the median counts; chosen
PPO_STEPS = 65_536  # of our learner in a timing, of its peer a quarter; chosen
QUIET = 0.95
"""Share of the cores from which a machine counts as quiet: the rest is what the system itself
takes."""


@dataclass(frozen=True)
class Timing:
    """One line of the table: what was measured, the result, and its target."""

    measure: str
    ours: str
    peer: str
    ratio: float | None
    target: str


def main() -> None:
    """Measure everything and print the table."""
    tasks: list[Callable[[], Timing]] = [
        lambda name=name, place=place: vector_step(name, place)  # type: ignore[misc]
        for name in TARGETS
        for place in range(len(SIZES))
    ]
    tasks += [scalar_step, replay_rate, lambda: diagnosis_time({}, "20 s")]
    tasks += [
        lambda: diagnosis_time({"turning": {"scrub": 0.3}, "inertia": {"mass_factor": 1.0}}, "60 s")
    ]
    tasks += [import_time, ppo_rate]
    console = Console()
    share_free = free_share()
    if share_free < QUIET:
        taken = f"{1.0 - share_free:.0%}"
        console.print(
            f"The machine is busy: {taken} of its cores are taken, and what is printed is too slow."
        )
    rows = [task() for task in track(tasks, "measuring", console=Console(stderr=True))]
    title = f"homeward {homeward.__version__}, gymnasium {gym.__version__}, {os.cpu_count()} cores"
    shown = table(title, ("measure",), ("ours", "peer", "ratio", "asked for"))
    for row in rows:
        ratio = "" if row.ratio is None else f"{row.ratio:.2f} x"
        shown.add_row(row.measure, row.ours, row.peer, ratio, row.target)
    console.print(shown)
    console.print(
        "Survey, difficulty known, automatic resets included. Actions are drawn beforehand: any speed and rate, "
        "10 % stops, 0.2 % returns (a mission lasts about as long as a trained agent's). CartPole gets a fixed random "
        "action, as its own step costs the same with any."
    )


def robot_with(effects: str) -> Robot:
    """The default robot with some effects just above zero."""
    ids = {
        "no effects": (),
        "3 effects": THREE,
        "all effects": tuple(effect.id for effect in EFFECTS),
    }[effects]
    switches = {effect.id: {effect.switch.name: 1e-3} for effect in EFFECTS if effect.id in ids}
    return dataclasses.replace(load_robot("rusti_computer"), track_m=0.15, effects=switches)


def some_actions(count: int, rounds: int = 100) -> list[NDArray[np.int64]]:
    """Actions of some steps, each of shape (count, 3): missions last about as long as those of a
    trained agent."""
    rng = np.random.default_rng(0)
    chance = rng.random((rounds, count))
    modes = np.where(chance < 0.002, 2, np.where(chance < 0.1, 0, 1))
    levels = rng.integers(0, 5, (2, rounds, count))
    return list(np.ascontiguousarray(np.stack((*levels, modes), axis=-1)))


def paired(peer: Callable[[], Any], ours: Callable[[], Any]) -> tuple[float, float, float]:
    """Median seconds of the peer, of ours, and of their ratio."""
    peer()  # the first call compiles
    ours()
    peers_s = []
    ours_s = []
    for _ in range(PAIRS):
        peers_s.append(_seconds(peer))
        ours_s.append(_seconds(ours))
    ratios = [peer_s / own_s for peer_s, own_s in zip(peers_s, ours_s, strict=True)]
    return statistics.median(peers_s), statistics.median(ours_s), statistics.median(ratios)


def _seconds(work: Callable[[], Any]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def vector_step(effects: str, place: int) -> Timing:
    """Environment steps per second of the native vector env against CartPole's."""
    count = SIZES[place]
    rounds = max(100, 100_000 // SIZES[place])
    entry: Any = gym.VectorizeMode.VECTOR_ENTRY_POINT
    cartpole = gym.make_vec("CartPole-v1", num_envs=count, vectorization_mode=entry)
    survey = gym.make_vec(
        IDS["Survey"],
        num_envs=count,
        vectorization_mode=entry,
        difficulty="known",
        robot=robot_with(effects),
    )
    cartpole.reset(seed=0)
    survey.reset(seed=0)
    push = np.random.default_rng(0).integers(0, 2, count)
    actions = some_actions(count)

    def step_cartpole() -> None:
        for _ in range(rounds):
            cartpole.step(push)

    def step_survey() -> None:
        for round_ in range(rounds):
            survey.step(actions[round_ % len(actions)])

    peer_s, ours_s, ratio = paired(step_cartpole, step_survey)
    steps = rounds * count / 1e6
    return Timing(
        f"vector step, {effects}, {count} envs", f"{steps / ours_s:.1f} M/s", f"CartPole {steps / peer_s:.1f} M/s",
        ratio, f"{TARGETS[effects][place]:g} x",
    )  # fmt: skip


def free_share() -> float:
    """Share of the cores' time that one busy process per core gets: 1 on a quiet machine."""
    code = "import time; s = time.perf_counter()\nwhile time.perf_counter() < s + 0.5: pass\n" + (
        "print(time.process_time() / (time.perf_counter() - s))"
    )
    call = [sys.executable, "-c", code]
    count = os.cpu_count() or 1
    processes = [subprocess.Popen(call, stdout=subprocess.PIPE, text=True) for _ in range(count)]
    return statistics.fmean(float(process.communicate()[0]) for process in processes)


def scalar_step() -> Timing:
    """Microseconds of a scalar step against CartPole's, both unwrapped."""
    rounds = 20_000
    cartpole = gym.make("CartPole-v1").unwrapped
    survey = gym.make(IDS["Survey"], difficulty="known").unwrapped
    cartpole.reset(seed=0)
    survey.reset(seed=0)
    actions = [action for (action,) in some_actions(1)]

    def step(env: gym.Env[Any, Any], choices: list[Any]) -> None:
        for round_ in range(rounds):
            _, _, terminated, truncated, _ = env.step(choices[round_ % len(choices)])
            if terminated or truncated:
                env.reset()

    peer_s, ours_s, ratio = paired(lambda: step(cartpole, [0, 1]), lambda: step(survey, actions))
    per_step = 1e6 / rounds
    return Timing(
        "scalar step",
        f"{ours_s * per_step:.1f} us",
        f"CartPole {peer_s * per_step:.1f} us",
        ratio,
        "1 x",
    )


def replay_rate() -> Timing:
    """Samples of a recording per second, by the public function as a whole."""
    samples = 1_000_000
    time_s: NDArray[np.float64] = np.arange(samples, dtype=np.float64) / 10.0
    speed_mps = 0.5 + 0.5 * np.sin(time_s)
    grade_rad = 0.05 * np.sin(time_s / 30.0)
    robot = load_robot("husky")
    replay(robot, time_s, speed_mps, grade_rad=grade_rad)
    seconds = statistics.median(
        _seconds(lambda: replay(robot, time_s, speed_mps, grade_rad=grade_rad))
        for _ in range(PAIRS)
    )
    return Timing(
        "replay of a recording",
        f"{samples / seconds / 1e6:.1f} M samples/s",
        "",
        None,
        "5 M samples/s",
    )


def diagnosis_time(hidden: dict[str, dict[str, float]], target: str) -> Timing:
    """Time of a diagnosis of an hour at 10 Hz in five runs, with concealed effects."""
    robot = load_robot("husky")
    runs = []
    for seed in range(5):
        drive = record(dataclasses.replace(robot, effects=hidden), seed)
        channels = {str(name): np.resize(drive[name].to_numpy(dtype=float), 7200) for name in drive}
        channels["time_s"] = np.arange(7200) / 10.0
        runs.append(Recording(f"run{seed}.csv", str(seed), channels))
    analyse(runs[:1], robot)  # compiles
    seconds = _seconds(lambda: analyse(runs, robot))
    hidden_effects = f"{', '.join(hidden) or 'nothing'} concealed"
    return Timing(
        f"diagnosis, 1 h at 10 Hz, 5 runs, {hidden_effects}", f"{seconds:.1f} s", "", None, target
    )


def import_time() -> Timing:
    """Seconds of `import homeward` beyond NumPy and Gymnasium, in fresh processes, and whether it
    compiles."""
    code = (
        "import time, numpy, gymnasium; start = time.perf_counter(); import homeward; "
        "print(time.perf_counter() - start)"
    )
    with tempfile.TemporaryDirectory() as folder:
        seconds = statistics.median(float(_python(code, folder)) for _ in range(5))
        compiled = sum(name.endswith(".nbi") for _, _, names in os.walk(folder) for name in names)
    return Timing(
        "import homeward",
        f"{seconds:.2f} s",
        f"{compiled} kernels compiled",
        None,
        "0.5 s, 0 kernels",
    )


def _python(code: str, cache: str) -> str:
    env = os.environ | {"HOMEWARD_CACHE": cache}
    return subprocess.run(
        [sys.executable, "-c", code], env=env, stdout=subprocess.PIPE, text=True, check=True
    ).stdout


def ppo_rate() -> Timing:
    """Environment steps per second of `train.py`'s learner against stable-baselines3's PPO on
    CartPole with 8 envs."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    from homeward.agents.learning.ppo import make_model, one_thread
    from homeward.agents.learning.settings import PPOSettings
    from homeward.envs.options import Options

    ours = make_model(Options("Survey"), PPOSettings(), seed=0)
    peer = PPO("MlpPolicy", make_vec_env("CartPole-v1", n_envs=8, seed=0), seed=0, device="cpu")

    # One thread for both: beside numba's, torch's idle threads would slow the peer by an order of
    # magnitude.
    def learn_ours() -> None:
        with one_thread():
            ours.learn(PPO_STEPS)

    def learn_peer() -> None:
        with one_thread():
            peer.learn(PPO_STEPS // 4)

    learn_ours()
    ours_rate = []
    peer_rate = []
    ratios = []
    for _ in range(3):
        ours_rate.append(PPO_STEPS / _seconds(learn_ours))
        peer_rate.append(PPO_STEPS / 4 / _seconds(learn_peer))
        ratios.append(ours_rate[-1] / peer_rate[-1])
    return Timing(
        "PPO", f"{statistics.median(ours_rate):,.0f} steps/s",
        f"SB3 CartPole {statistics.median(peer_rate):,.0f} steps/s", statistics.median(ratios), "3 x",
    )  # fmt: skip


if __name__ == "__main__":
    main()
