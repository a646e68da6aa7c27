"""The viewer: it shows what is so, changes nothing, fits its frame and works without a screen."""

from __future__ import annotations

import copy
import importlib.util
import itertools
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import homeward
from homeward.envs import IDS
from homeward.envs.features import INDEX
from homeward.envs.options import OptionError
from homeward.envs.routes import Route
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.viewer import palette
from homeward.envs.viewer.canvas import HEIGHT, WIDTH, Canvas
from homeward.envs.viewer.read_scene import GROUPS
from homeward.envs.viewer.scene import Scene
from homeward.envs.viewer.text import describe
from homeward.physics import CAUSES, d_max
from homeward.physics.robot import preset_names
from tests.envs.rollouts import MISSIONS, SHORT_S, make

pygame = pytest.importorskip("pygame")


@pytest.fixture(autouse=True)
def no_screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


def flat(length_m: float, places: int = 32) -> Route:
    plain = np.zeros(places)
    return Route(length_m / places, plain, plain, plain + 1.0, plain)


def seen(env: HomewardEnv) -> Scene:
    assert env._viewer is not None
    return env._viewer.scene()


class Text:
    """Where a text was drawn."""

    def __init__(self, left: float, top: float, width: float, height: float, words: str) -> None:
        self.left, self.top, self.right, self.bottom = left, top, left + width, top + height
        self.words = words

    def meets(self, other: Text) -> bool:
        return (
            min(self.right, other.right) - max(self.left, other.left) > 1.0
            and min(self.bottom, other.bottom) - max(self.top, other.top) > 3.0
        )


@pytest.fixture
def texts(monkeypatch: pytest.MonkeyPatch) -> list[Text]:
    """All texts that are drawn from now on."""
    from homeward.envs.viewer.canvas import Canvas

    drawn: list[Text] = []
    draw = Canvas.text

    def note(
        canvas: Canvas, at: Any, text: str, size: int = 12, *rest: Any, **keywords: Any
    ) -> float:
        width = draw(canvas, at, text, size, *rest, **keywords)
        left = (
            at[0]
            - {"left": 0.0, "centre": 0.5, "right": 1.0}[keywords.get("align", "left")] * width
        )
        drawn.append(Text(left, at[1] - 0.5 * size, width, size, text))
        return width

    monkeypatch.setattr(Canvas, "text", note)
    return drawn


def random_walk(env: HomewardEnv, seed: int, most: int = 60) -> Iterator[Scene]:
    """Scenes of a mission with random commands that turns home in the end."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    yield seen(env)
    for decision in range(most):
        mode = RETURN if decision > most // 3 else int(rng.choice([STOP, GO], p=[0.2, 0.8]))
        _, _, terminated, truncated, _ = env.step([rng.integers(5), rng.integers(5), mode])
        yield seen(env)
        if terminated or truncated:
            return


@pytest.mark.parametrize("mission", MISSIONS)
def test_gymnasium_finds_nothing_to_say_in_any_mode(mission: str) -> None:
    modes = gym.spec(IDS[mission]).make().metadata["render_modes"]
    assert modes == ["human", "rgb_array", "ansi"]
    for mode in modes:
        env = gym.make(IDS[mission], render_mode=mode)
        check_env(env.unwrapped)
        env.close()


def test_pictures_are_of_one_size_and_follow_the_mission() -> None:
    env = make("Survey", render_mode="rgb_array")
    env.reset(seed=0)
    first, again = env.render(), env.render()
    env.step([4, 4, GO])
    second = env.render()
    assert isinstance(first, np.ndarray) and isinstance(second, np.ndarray)
    assert first.shape == (540, 960, 3) and first.dtype == np.uint8
    np.testing.assert_array_equal(first, again)
    assert (first != second).any(axis=-1).mean() > 0.01


@pytest.mark.parametrize("mode", ["human", "rgb_array", "ansi"])
def test_showing_a_mission_changes_nothing_in_it(mode: str) -> None:
    shown, hidden = (make("Survey", difficulty="harsh", render_mode=one) for one in (mode, None))
    np.testing.assert_array_equal(shown.reset(seed=3)[0], hidden.reset(seed=3)[0])
    for action in ([4, 2, GO], [0, 4, STOP], [3, 0, RETURN]):
        shown.render()
        one, other = shown.step(action), hidden.step(action)
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1:4] == other[1:4]
    shown.render()
    assert shown.batch.records.tobytes() == hidden.batch.records.tobytes()
    assert shown.batch.routes.tobytes() == hidden.batch.routes.tobytes()
    shown.close()


def test_recording_works_without_a_screen(tmp_path: Path, root: Path) -> None:
    pytest.importorskip("moviepy")
    program = (
        "import sys, gymnasium as gym, homeward\n"
        "env = gym.make('homeward/Survey-v0', render_mode='rgb_array', decision_s=300.0)\n"
        "env = gym.wrappers.RecordVideo(env, sys.argv[1], fps=10)\n"
        "env.reset(seed=0)\n"
        "for action in ([4, 2, 1], [4, 2, 1], [4, 0, 0], [4, 0, 2]):\n"
        "    env.step(action)\n"
        "env.close()\n"
        "from moviepy import VideoFileClip\n"
        "with VideoFileClip(sys.argv[1] + '/rl-video-episode-0.mp4') as clip:\n"
        "    print(clip.size, clip.duration)\n"
    )
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("DISPLAY", "SDL_VIDEODRIVER")
    }
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", program, str(tmp_path / "clips")],
        cwd=root, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stdout.strip()) == (0, "[960, 540] 0.5"), done.stderr


def test_a_window_pauses_goes_on_by_one_and_closes() -> None:
    from homeward.envs.viewer.window import Screen

    window = Screen(1000)
    picture = pygame.Surface((960, 540))

    def press(*keys: int) -> None:
        for key in keys:
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))

    press(pygame.K_SPACE, pygame.K_RIGHT)  # paused, and the next picture asked for
    window.show(picture)
    press(pygame.K_RIGHT)
    window.show(picture)
    press(pygame.K_SPACE)
    window.show(picture)
    window.show(picture)
    press(pygame.K_ESCAPE)
    window.show(picture)
    assert not window.is_open and not pygame.display.get_init()


def test_a_mission_goes_on_after_its_window_is_closed() -> None:
    env = make("OutAndBack", render_mode="human")
    env.reset(seed=0)
    assert pygame.display.get_init()
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    env.step([4, 0, GO])
    assert not pygame.display.get_init()
    assert env.step([4, 0, RETURN])[2] and env.render() is None
    env.close()


def test_rendering_needs_a_mode_and_a_mission() -> None:
    with pytest.warns(UserWarning, match="without a render mode"):
        assert HomewardEnv().render() is None
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        HomewardEnv(render_mode="ansi").render()


def test_a_missing_pygame_is_said_when_the_environment_is_made(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *rest: None if name == "pygame" else find(name, *rest),
    )
    with pytest.raises(
        OptionError,
        match=r"^render_mode = 'rgb_array' needs pygame: pip install 'homeward\[view\]'$",
    ):
        HomewardEnv(render_mode="rgb_array")
    env = HomewardEnv(render_mode="ansi")
    env.reset(seed=0)
    assert env.render()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_an_environment_that_has_shown_something_travels(copied: Any) -> None:
    env = make("Survey", render_mode="rgb_array")
    env.reset(seed=0)
    env.step([4, 4, GO])
    other = copied(env)
    np.testing.assert_array_equal(env.render(), other.render())
    other.step([4, 4, GO])
    assert (np.asarray(env.render()) != np.asarray(other.render())).any()


def test_every_cause_has_one_place_in_the_battery() -> None:
    assert sorted(cause for group in GROUPS.values() for cause in group) == sorted(CAUSES)


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("difficulty", ["known", "harsh"])
def test_the_battery_adds_up(mission: str, difficulty: str) -> None:
    scenes = list(random_walk(make(mission, difficulty=difficulty, render_mode="ansi"), seed=1))
    for scene in scenes:
        assert scene.worn_j + sum(scene.used_j.values()) + scene.left_j == pytest.approx(
            scene.full_j
        )
    for before, after in itertools.pairwise(scenes):
        passed_s = after.time_s - before.time_s
        assert after.power_w * passed_s == pytest.approx(before.left_j - after.left_j)


@pytest.mark.parametrize("instruments", ["exact", "meter", "gauge"])
def test_readings_are_shown_beside_the_truth(instruments: str, texts: list[Text]) -> None:
    env = HomewardEnv(
        mission="Survey", difficulty="harsh", instruments=instruments, render_mode="rgb_array"
    )
    apart = set()
    for scene in random_walk(env, seed=3, most=40):
        m = env.batch.records[0]
        assert (scene.left_j, scene.read_w) == (float(m["energy_j"]), float(m["read_w"]))
        assert scene.gauge_j == pytest.approx(float(m["soc"]) * scene.full_j)
        assert scene.margin_j == pytest.approx(float(m["metered"]) * scene.full_j - scene.home_j)
        if scene.decision == 0 or scene.over:
            continue
        charge = scene.left_j / (scene.full_j - scene.worn_j)
        apart.add(
            (
                abs(scene.gauge_j / scene.full_j - charge) > 1e-9,
                abs(scene.read_w - scene.power_w) > 1e-9,
            )
        )
        texts.clear()
        env.render()
        words = [text.words for text in texts]
        assert f"{scene.power_w:.3g}" in words and f"the meter reads {scene.read_w:.3g} W" in words
        rows = dict(itertools.pairwise(words))
        assert rows["gauge reads"] == f"{100.0 * scene.gauge_j / scene.full_j:.1f} %"
        assert rows["left"] == f"{100.0 * scene.left_j / scene.full_j:.1f} %"
        lines = describe(scene)
        assert (
            f"{scene.left_j / scene.full_j:.0%} left, gauge {scene.gauge_j / scene.full_j:.0%}, way home"
            in lines
        )
    assert (True, True) in apart if instruments != "exact" else apart == {(False, False)}


def test_a_robot_that_is_asked_to_return_is_seen_to_head_home() -> None:
    env = make("OutAndBack", render_mode="ansi", decision_s=None)
    env.reset(seed=0)
    for _ in range(4):
        env.step([4, 0, GO])
    assert (seen(env).state, seen(env).direction) == ("out", 1.0)
    env.step([1, 0, RETURN])
    assert not env.batch.records["returning"][0]
    assert (seen(env).state, seen(env).direction) == ("returning", -1.0)
    assert seen(env).no_return_m is not None
    env.step([1, 0, STOP])
    assert seen(env).state == "stopped"
    env.step([1, 0, GO])
    assert (seen(env).state, seen(env).direction) == ("out", 1.0)


def test_what_is_drawn_as_gathered_is_what_was_gathered() -> None:
    env = make("Survey", render_mode="ansi", decision_s=SHORT_S / 10.0)
    for scene in random_walk(env, seed=2, most=80):
        places = np.minimum(
            np.maximum(scene.edges_m[1:] - scene.sensed[:, :1], 0.0), np.diff(scene.edges_m)
        )
        overlap = places - np.minimum(
            np.maximum(scene.edges_m[1:] - scene.sensed[:, 1:2], 0.0), np.diff(scene.edges_m)
        )
        gathered = float((overlap * scene.sensed[:, 2:] * scene.interest).sum())
        assert gathered == pytest.approx(
            scene.delivered + scene.on_board + scene.lost, rel=1e-3, abs=1e-6
        )
    assert gathered > 0.0


def test_the_point_of_no_return_is_half_the_range_on_flat_ground() -> None:
    robot = homeward.load_robot("rusti")
    env = make(
        "OutAndBack", robot=robot, difficulty="known", route=flat(4000.0), render_mode="ansi"
    )
    env.reset(seed=0)
    assert seen(env).no_return_m == pytest.approx(float(d_max(robot)) / 2.0, rel=1e-3)


def drive(env: HomewardEnv, past_m: float) -> tuple[Scene, Scene]:
    """Go out until the next decision would end further than some metres past the point of no
    return; then home.

    Returns:
        The scene at the turn and that of the end.
    """
    step_m = float(
        env.batch.known.shared["decision_s"][0] * env.batch.known.shared["cruise_mps"][0]
    )
    while True:
        limit_m = seen(env).no_return_m
        if limit_m is not None and seen(env).position_m + step_m > limit_m + past_m:
            break
        env.step([4, 0, GO])
    while not env.batch.records["returning"][0]:
        env.step([4, 0, RETURN])
    turned = seen(env)
    while not seen(env).over:
        env.step([4, 0, RETURN])
    return turned, seen(env)


@pytest.mark.parametrize("seed", range(3))
def test_before_the_point_of_no_return_a_robot_gets_home_and_beyond_it_strands(seed: int) -> None:
    env = make("OutAndBack", difficulty="known", render_mode="ansi", decision_s=10.0)
    env.reset(seed=seed)
    turned, end = drive(env, 0.0)
    assert end.state == "home" and turned.runs_out_m is None
    assert end.left_j < 0.02 * end.full_j  # not a metre too early
    env.reset(seed=seed)
    turned, end = drive(env, 60.0)
    assert end.state == "stranded"
    assert turned.runs_out_m == pytest.approx(end.position_m, abs=30.0)


def test_the_point_of_no_return_knows_no_more_than_the_robot() -> None:
    """Two routes that look alike from the start, with the same mean, have the same point of no
    return there."""
    plain = np.zeros(32)
    hill = plain.copy()
    hill[4:18], hill[18:] = 0.2, -0.2
    limits = []
    for difficulty in ("uncertain", "known"):
        for grade in (plain, hill):
            route = Route(110.0, grade, plain, plain + 1.0, plain)
            env = make("OutAndBack", difficulty=difficulty, route=route, render_mode="ansi")
            env.reset(seed=0)
            limits.append(seen(env).no_return_m)
    assert limits[0] == pytest.approx(limits[1])
    assert limits[2] != pytest.approx(limits[3])


def test_patrols_have_laps_to_spare_instead() -> None:
    env = make("Patrol", difficulty="known", robot="rusti", render_mode="ansi", decision_s=30.0)
    laps = [scene.laps_left for scene in random_walk(env, seed=0)]
    assert all(one is not None for one in laps)
    env.reset(seed=0)
    hoped = seen(env).laps_left
    while True:
        observation, *_ = env.step([4, 0, GO])
        if observation[INDEX["energy"]] < 0.02:
            break
    assert hoped == pytest.approx(float(env.batch.records["legs"][0]) / 2.0, abs=1.0)


def test_lines_of_text_say_where_the_robot_is() -> None:
    env = make("OutAndBack", difficulty="known", render_mode="ansi")
    env.reset(seed=0)
    assert str(env.render()).startswith("ready: 0.0 m from home after 0 s")
    env.step([4, 0, GO])
    where, route, battery = str(env.render()).splitlines()
    assert where.startswith("out: 300 m from home after 5 min, 1 m/s, sensing 0 Hz, score 300")
    assert route.index(">") < route.index("!") and "point of no return" in route
    assert battery.startswith("battery |=") and "% left" in battery
    env.step([4, 0, RETURN])
    assert str(env.render()).startswith("home: 0.0 m from home")


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("robot", preset_names())
def test_words_stay_in_the_picture_and_apart(mission: str, robot: str, texts: list[Text]) -> None:
    env = HomewardEnv(mission=mission, robot=robot, difficulty="harsh", render_mode="rgb_array")
    for seed in range(2):
        for number, _ in enumerate(random_walk(env, seed, most=120)):
            if number % 40 and not env.batch.records["over"][0]:
                continue
            texts.clear()
            env.render()
            for index, one in enumerate(texts):
                assert (
                    one.left >= 0.0
                    and one.right <= 960.0
                    and one.top >= 0.0
                    and one.bottom <= 540.0
                ), one.words
                for other in texts[:index]:
                    assert not one.meets(other), f"{one.words!r} over {other.words!r}"


@pytest.mark.parametrize("grade", [-0.15, 0.0, 0.15])
@pytest.mark.parametrize("places", [1, 2, 64])
def test_routes_of_any_shape_are_drawn(grade: float, places: int) -> None:
    plain = np.zeros(places)
    route = Route(2000.0 / places, plain + grade, plain, plain + 1.0, plain)
    env = make("Survey", robot="rusti", route=route, difficulty="harsh", render_mode="rgb_array")
    for scene in random_walk(env, seed=0, most=30):
        assert np.isfinite(scene.elevation_m).all()
        assert np.asarray(env.render()).shape == (540, 960, 3)


def test_wheels_stand_on_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    wheels_foot_y: list[float] = []
    ground_y: list[float] = []
    circle, polygon = Canvas.circle, Canvas.polygon

    def noted_circle(canvas: Canvas, centre: Any, radius: float, fill: Any) -> None:
        if fill == palette.INK and radius > 3.0:
            wheels_foot_y.append(centre[1] + radius)
        circle(canvas, centre, radius, fill)

    def noted_polygon(canvas: Canvas, points: Any, fill: Any) -> None:
        if fill == palette.GROUND:
            ground_y.append(min(y for _, y in points))
        polygon(canvas, points, fill)

    monkeypatch.setattr(Canvas, "circle", noted_circle)
    monkeypatch.setattr(Canvas, "polygon", noted_polygon)
    env = make("Survey", route=flat(2000.0), render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
    assert wheels_foot_y == pytest.approx(2 * ground_y)


@pytest.mark.parametrize("mission", MISSIONS)
def test_panels_lie_apart_and_in_the_picture(mission: str, monkeypatch: pytest.MonkeyPatch) -> None:
    panels: list[tuple[float, float, float, float]] = []
    draw = Canvas.box

    def noted(canvas: Canvas, box: Any, fill: Any, radius: float = 0.0, edge: Any = None) -> None:
        if fill == palette.PANEL and edge == palette.EDGE and radius > 0.0:
            panels.append(box)
        draw(canvas, box, fill, radius, edge)

    monkeypatch.setattr(Canvas, "box", noted)
    env = make(mission, render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
    assert len(panels) >= 5
    for left, top, width, height in panels:
        assert left >= 0.0 and left + width <= WIDTH and top >= 0.0 and top + height <= HEIGHT
    for first, second in itertools.combinations(panels, 2):
        beside = first[0] + first[2] <= second[0] or second[0] + second[2] <= first[0]
        above = first[1] + first[3] <= second[1] or second[1] + second[3] <= first[1]
        assert beside or above, (first, second)
