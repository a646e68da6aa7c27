"""Parts of the pages that are generated from the code: `python -m docs.generate` writes all of them
into the pages.

A page asks for one by a comment on a line of its own, `<!-- generated: features -->`; the part and
another comment, `<!-- end of generated -->`, are written below it. So the files read whole on any
viewer. MkDocs calls the hooks by name; it makes the parts anew, warns of a page whose parts are out
of date, and an unknown name fails the build.
"""

from __future__ import annotations

import dataclasses
import functools
import html
import inspect
import json
import logging
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from latex2mathml.converter import convert
from mkdocs.structure.files import File

from docs import reference_scores as reference
from homeward.agents.registry import AGENTS
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.conditions import CONDITIONS, TOGETHER, Condition
from homeward.diagnosis.explain.menu import MENU, SAMPLES, Manoeuvre
from homeward.envs import IDS
from homeward.envs.actions import action_space
from homeward.envs.batch import observation_space
from homeward.envs.conditions.difficulty import DIFFICULTY, DRAWN
from homeward.envs.conditions.gauges import GAUGES, rms_error, suits
from homeward.envs.conditions.instruments import INSTRUMENTS, Instruments
from homeward.envs.features import DOCK_FEATURES, FEATURES, INDEX, RANGES
from homeward.envs.options import Options, known_of
from homeward.logs.channels import CHANNELS, Array
from homeward.physics import CAUSES, EFFECTS, Robot, d_max, load_robot, optimal_speed, preset_names
from homeward.physics.effects import Parameter
from homeward.physics.kernel import BASE_CAUSES

ROOT = Path(__file__).resolve().parents[1]
LOG = logging.getLogger("mkdocs.plugins.generate")

_END = "<!-- end of generated -->"
_MARK = re.compile(r"^<!-- generated: (\w+) ?(.*?) -->$", re.MULTILINE)
# A part ends before the next begins: a comment that is new has no end yet.
_FILLED = re.compile(
    rf"^(<!-- generated: [^\n]*? -->)\n\n(?:(?!<!-- generated: ).)*?\n\n{_END}$",
    re.MULTILINE | re.DOTALL,
)
_COMMENTS = re.compile(rf"^(?:<!-- generated: .*? -->\n\n|\n{_END}\n)", re.MULTILINE)

ENTERS = {
    "force": "force at the wheels",
    "drive": "power of the drive",
    "ancillary": "ancillary power",
    "battery": "loss in the battery",
    "instrument": "instrument",
}
"""Where each kind of effect enters the model; a fault of an instrument enters the reading only."""

DRAWN_WORDS = (
    "capacity of the battery, times",
    "rolling resistance, times",
    "payload, over the robot's mass,",
    "additional rolling resistance of the roughest ground, as a share,",
)
"""Hidden quantities, in the order of `homeward.envs.conditions.difficulty.DRAWN`."""

AGENT_WORDS = {
    "random": "samples uniformly from the action space, as a lower baseline",
    "soc50": "turns back at half charge",
    "dmax": "the paper's rule: turns back when the energy left, less a reserve, just reaches home by Eq. 8 at the mean "
    "grade",
    "dmax_mapped": "the same, with the way home predicted over the ground of the way out",
    "dmax_adaptive": "scales that prediction by the measured consumption, and keeps a reserve of k standard deviations",
    "dmax_belief": "predicts the way home by the belief, and keeps a reserve of k standard deviations",
    "planner": "turns back by the belief, and plans speed, sensing and stops",
    "ppo": "a network trained by PPO from the rule `dmax_belief`, which sees the observation and the belief",
    "ppo_scratch": "a network trained by PPO from nothing, which sees the observation alone",
}
"""What each agent does."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown; bars inside cells are escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def features() -> str:
    """Observed features."""
    rows = []
    for index, (name, unit, meaning) in enumerate(FEATURES):
        lowest, highest = RANGES[name]
        rows.append([str(index), f"`{name}`", f"{lowest:g}", f"{highest:g}", unit, meaning])
    return table(("index", "feature", "lowest", "highest", "unit", "meaning"), rows)


def dock_features() -> str:
    """Observed features of missions with docks."""
    rows = ([str(INDEX[name]), f"`{name}`", unit, meaning] for name, unit, meaning in DOCK_FEATURES)
    return table(("index", "feature", "unit", "meaning"), rows)


def spaces(mission: str) -> str:
    """The head of an environment's page, as Gymnasium's have it."""
    rows = (
        ("make", f'`gymnasium.make("homeward:{IDS[mission]}")`'),
        (
            "action space",
            f'`{action_space(True)}`; `{action_space(False)}` with `action_type="continuous"`',
        ),
        ("observation space", f"`{observation_space()}`"),
    )
    return table(("", f"`{IDS[mission]}`"), rows)


def reference_scores(mission: str) -> str:
    """Scores that were measured of a mission, with the command that measures them."""
    measured = json.loads(reference.measured(mission).read_text("utf-8"))
    optimum = measured.get("optimum")
    head = ["agent", "score, mean (95 %)", "stranded (95 %, Wilson)"]
    rows = []
    for name, agent in measured["agents"].items():
        low, high = map(_figures, agent["score_ci95"])
        score = f"{_figures(agent['score_mean'])} ({low} to {high})"
        rate, fewest, most = (
            100.0 * share for share in (agent["stranded_rate"], *agent["stranded_ci95"])
        )
        row = [f"`{name}`", score, f"{rate:.1f} % ({fewest:.1f} to {most:.1f})"]
        if optimum:
            row.append(
                f"{_per_cent(agent['share_of_optimum_at_least'])} to {_per_cent(agent['share_of_optimum'])}"
            )
        rows.append(row)
    if optimum:
        head.append("of the optimum")
        rows.append(
            [
                "optimum, between",
                f"{_figures(optimum['lower'])} and {_figures(optimum['upper'])}",
                "",
                "",
            ]
        )
    versions = ", ".join(f"{name} {version}" for name, version in measured["versions"].items())
    episodes = f"{measured['episodes']} episodes at `uncertain`, seed {measured['seed']}"
    conditions = f"{episodes}, at commit {measured['commit']}"
    return (
        f"{conditions}, by\n\n```\n{measured['command']}\n```\n\n{table(head, rows)}\n\n{versions}"
    )


def _per_cent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _figures(score: float) -> str:
    """A score with four digits, the whole part in full."""
    return f"{score:.0f}" if score >= 1000.0 else f"{score:.4g}"


def causes() -> str:
    """Columns of the energy ledger."""
    own = ", ".join(f"`{name}`" for name in BASE_CAUSES)
    effects = ", ".join(f"[`{name}`](effects.md#{name})" for name in CAUSES[len(BASE_CAUSES) :])
    return f"* without effects: {own}\n* of effects, where they are on: {effects}"


def missions() -> str:
    """Scale of each mission with the default robot."""
    rows = []
    for mission, env_id in IDS.items():
        settings = known_of(Options(mission)).shared[0]
        rows.append([
            f"`{env_id}`",
            f"{settings['length_m']:.0f} m",
            f"{settings['cruise_mps']:.2g} m/s",
            f"{settings['decision_s']:g} s",
            f"{settings['max_decisions']}",
            f"{settings['score_scale']:.4g}",
        ])  # fmt: skip
    head = (
        "id",
        "route",
        "cruise speed",
        "length of a decision",
        "time limit, decisions",
        "good score",
    )
    return table(head, rows)


def difficulties() -> str:
    """Hidden quantities at each difficulty."""
    rows = []
    for name, difficulty in DIFFICULTY.items():
        hidden = []
        for field, words in zip(DRAWN, DRAWN_WORDS, strict=True):
            drawn = getattr(difficulty, field)
            if drawn.high > drawn.low:
                hidden.append(f"{words} {drawn.low:g} to {drawn.high:g}")
        weather = "changes" if difficulty.weather_changes else "as at the start"
        route = (
            "known" if difficulty.route_is_known else "two places ahead in sight, the rest forecast"
        )
        rows.append(
            [
                f"`{name}`",
                f"`{difficulty.instruments}`",
                weather,
                route,
                "; ".join(hidden) or "nothing",
            ]
        )
    return table(
        (
            "difficulty",
            "instruments",
            "weather",
            "route and wind",
            "hidden, drawn for each mission",
        ),
        rows,
    )


def instruments() -> str:
    """Sizes of the errors of each set of instruments, with their meanings from the docstring."""
    _, _, attributes = (inspect.getdoc(Instruments) or "").partition("Attributes:\n")
    # A meaning goes on in lines that are indented further than its name.
    entries = re.findall(r"^ {4}(\w+): (.+(?:\n {8}.+)*)$", attributes, re.MULTILINE)
    meanings = {name: " ".join(meaning.split()) for name, meaning in entries}
    rows = []
    for field in dataclasses.fields(Instruments):
        if field.name != "gauges":
            sizes = [
                f"{getattr(instruments, field.name):g}" for instruments in INSTRUMENTS.values()
            ]
            rows.append([f"`{field.name}`", *sizes, meanings[field.name]])
    names = []
    for instruments in INSTRUMENTS.values():
        has_all = instruments.gauges == tuple(GAUGES)
        names.append("all" if has_all else ", ".join(instruments.gauges))
    rows.append(
        [
            "`gauges`",
            *names,
            "gauges of the next table, of which each mission has one, all equally likely",
        ]
    )
    return table(("size", *(f"`{name}`" for name in INSTRUMENTS), "meaning"), rows)


def gauges() -> str:
    """Gauges of the state of charge, and how far they are off."""
    batteries = {
        "rusti_computer": "constant voltage",
        "turtlebot3_burger": "Li-Po",
        "husky": "lead acid",
    }
    rows = []
    for name, gauge in GAUGES.items():
        errors = []
        for preset in batteries:
            robot = load_robot(preset)
            lasts_s = float(d_max(robot)) / float(optimal_speed(robot))
            errors.append(
                f"{rms_error(gauge, robot, lasts_s):.1%}" if suits(gauge, robot) else "none"
            )
        rows.append((f"`{name}`", gauge.meaning, *errors, gauge.source))
    heads = [f"error, {battery}" for battery in batteries.values()]
    return table(("gauge", "what it shows", *heads, "source of its sizes"), rows)


def robots() -> str:
    """Robots that ship, with the range that the model gives them."""
    rows = []
    for name in preset_names():
        robot = load_robot(name)
        rows.append([
            f"`{name}`",
            f"{robot.mass_kg:g} kg",
            f"{robot.usable_energy_j / 3600.0:.3g} Wh",
            f"{float(optimal_speed(robot)):.2g} m/s",
            f"{float(d_max(robot)) / 1000.0:.3g} km",
        ])  # fmt: skip
    return table(
        (
            "robot",
            "mass",
            "battery",
            "speed with the longest range",
            "d_max on level ground, without sensing",
        ),
        rows,
    )


def robot_file() -> str:
    """Numbers of a robot file, as the fields of `Robot` declare them."""
    rows = []
    for field in dataclasses.fields(Robot):
        if "bounds" in field.metadata:
            default = "required" if field.default is dataclasses.MISSING else f"{field.default:g}"
            about = field.metadata
            rows.append(
                (
                    about["section"],
                    f"`{field.name}`",
                    about["meaning"],
                    str(about["bounds"]),
                    default,
                )
            )
    return table(
        ("section", "name", "meaning", "allowed", "default"), sorted(rows, key=lambda row: row[0])
    )


def agents() -> str:
    """Agents that `evaluate.py` knows."""
    return table(("name", "what it does"), ((f"`{name}`", AGENT_WORDS[name]) for name in AGENTS))


def effects() -> str:
    """Every effect and every fault of an instrument: a table of all, then one section each."""
    rows = []
    for name, hypothesis in CATALOGUE.items():
        entry = hypothesis.entry
        rows.append([f"[`{name}`](#{name})", ENTERS[entry.kind], entry.sentence])
    return "\n\n".join([table(("id", "enters", "description"), rows), *map(_effect, CATALOGUE)])


def _effect(name: str) -> str:
    hypothesis = CATALOGUE[name]
    entry = hypothesis.entry
    head = ("parameter", "unit", "minimum", "maximum", "default", "meaning")
    numbers = [_number(parameter, hypothesis.physical) for parameter in entry.parameters]
    needed = ", ".join(f"`{channel}`" for channel in entry.needs)
    confused_with = (
        ", ".join(f"[`{effect}`](#{effect})" for effect in entry.confused_with) or "nothing"
    )
    parts = [
        f"## `{name}`",
        entry.sentence,
        f"```text\n{entry.equation}\n```",
        table(head, numbers),
        f"Source: {entry.source}.  \nChannels that show it: {needed}.  \nEasily confused with: {confused_with}.",
    ]
    if hypothesis.physical:
        switch = f"`{entry.switch.name}` at zero switches it off"
        parts.append(f"In a robot file it is the section `[effects.{name}]`; {switch}.")
    return "\n\n".join(parts)


def _number(parameter: Parameter, physical: bool) -> list[str]:
    default = f"{parameter.default:g}" if physical else "-"
    return [
        f"`{parameter.name}`",
        parameter.unit,
        f"{parameter.low:g}",
        f"{parameter.high:g}",
        default,
        parameter.meaning,
    ]


LEVELS = {
    "speed": ("speed, of top speed", 1.0, ""),
    "turning": ("turning rate, of that on the spot at half the top speed", 1.0, ""),
    "yaw_rate_radps": ("turning rate", 1.0, " rad/s"),
    "grade_rad": ("slope", 180.0 / np.pi, "°"),
    "heading_rad": ("heading, from the direction of the wind", 180.0 / np.pi, "°"),
    "sensing": ("sensing rate, of the fastest", 1.0, ""),
    "switched_on": ("switched on", 1.0, ""),
    "known_mass": ("additional mass, of the robot's own", 1.0, ""),
    "temperature_c": ("air temperature", 1.0, " °C"),
    "base_distance_s": ("distance from base, in driving time at top speed", 1.0, ""),
}
"""Quantities that a drive sets: name, and the factor and unit in which it is shown."""
_MOST_LEVELS = 8  # of a series that is written out


def drives() -> str:
    """The drives of the menu that the diagnosis advises from, each as an instruction and as a
    timetable."""
    return "\n\n".join(map(_drive, MENU))


def _drive(drive: Manoeuvre) -> str:
    """One drive: its instruction, how long it takes, and each quantity that it sets."""
    step_s = np.broadcast_to(np.asarray(drive.step_s, np.float64), SAMPLES)
    rows = []
    for field in dataclasses.fields(drive):
        levels = getattr(drive, field.name)
        if field.name in LEVELS and levels is not field.default:
            words, factor, unit = LEVELS[field.name]
            rows.append(
                f"* {words}: {_timetable(factor * np.broadcast_to(levels, SAMPLES), step_s, unit)}"
            )
    duration = _minutes(float(step_s.sum()))
    instruction = f"{drive.sentence[0].upper()}{drive.sentence[1:]} ({duration})."
    return "\n".join([f"### {drive.id.replace('_', ' ')}", "", instruction, "", *rows])


def _timetable(levels: Array, step_s: Array, unit: str) -> str:
    """A series in words: its levels in turn, how long each is held, and how often the whole series
    comes."""
    changes = np.flatnonzero(np.diff(levels, prepend=np.nan) != 0.0)
    stages = levels[changes]
    count = len(stages)
    if count == 1:
        return f"{stages[0]:.3g}{unit} throughout"
    period = next(
        n for n in range(1, count + 1) if np.array_equal(np.tile(stages[:n], count // n), stages)
    )
    if period > _MOST_LEVELS:  # no levels, but a ramp
        peaks = np.flatnonzero(np.diff(np.sign(np.diff(stages))) < 0.0) + 1
        turns = [0, *peaks, count - 1]
        return "evenly from " + " to ".join(f"{stages[turn]:.4g}{unit}" for turn in turns)
    shown = ", ".join(f"{level:.3g}{unit}" for level in stages[:period])
    durations = [_minutes(float(time_s)) for time_s in np.add.reduceat(step_s, changes)[:period]]
    are_equal = len(set(durations)) == 1
    lasts = f"{durations[0]} each" if are_equal else ", ".join(durations)
    repeats = count // period
    repeated = f", {repeats} times" if repeats > 1 else ""
    return f"{shown}: {lasts}{repeated}"


def _minutes(time_s: float) -> str:
    return f"{time_s / 60.0:.0f} min" if time_s % 60.0 == 0.0 else f"{time_s:.0f} s"


def channels() -> str:
    """Channels of a recording, and which effects ask for each."""
    rows = []
    for name, channel in CHANNELS.items():
        effects = [
            effect for effect, hypothesis in CATALOGUE.items() if name in hypothesis.entry.needs
        ]
        rows.append(
            (f"`{name}`", channel.unit, channel.meaning, ", ".join(map(_effect_link, effects)))
        )
    return table(("channel", "unit", "meaning", "effects that need it"), rows)


def bench() -> str:
    """The measurement that identifies each effect alone."""
    rows = [(_effect_link(name), hypothesis.measurement) for name, hypothesis in CATALOGUE.items()]
    return table(("effect", "measurement"), rows)


def _effect_link(name: str) -> str:
    return f"[`{name}`](effects.md#{name})"


def conditions() -> str:
    """Conditions under which an effect is named: its own, and those on all named effects
    together."""

    def rows(conditions: Sequence[Condition[Any]]) -> list[tuple[str, ...]]:
        return [
            (
                condition.name,
                condition.asks,
                f"{condition.side} {condition.limit_in_words}",
                condition.applies_to,
                condition.origin,
            )
            for condition in conditions
        ]

    heads = ("condition", "what is compared", "limit", "applies to", "origin of the limit")
    of_each = table(heads, rows(CONDITIONS))
    of_all = table(heads, rows(TOGETHER))
    return f"{of_each}\n\nAll named effects together:\n\n{of_all}"


def counts() -> str:
    """How many hypotheses there are."""
    return (
        f"The catalogue has {len(CATALOGUE)} hypotheses: {len(EFFECTS)} effects, which the environments also have, and "
        f"{len(CATALOGUE) - len(EFFECTS)} faults of instruments, which change only the readings."
    )


def results(heading: str) -> str:
    """A section of the page of results, with its subsections, for inclusion in other pages."""
    page = emptied((ROOT / "docs" / "results.md").read_text("utf-8"))
    sections = {match[2]: match for match in re.finditer(r"^(##+) +(.+)\n", page, re.MULTILINE)}
    if heading not in sections:
        raise KeyError(f"results.md has no section {heading!r}, only {', '.join(sections)}")
    section = sections[heading]
    level = len(section[1])
    # The section ends where the next heading of its level or a higher one begins.
    until_next = re.split(
        rf"^#{{2,{level}}} ", page[section.end() :], maxsplit=1, flags=re.MULTILINE
    )[0]
    return until_next.strip()


@functools.cache
def _diagnosed() -> tuple[str, bytes]:
    """Output of `diagnose.py` for the shipped recording, and its report."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(ROOT / "diagnose.py"), "--robot", "husky", "--out", folder]
        run = subprocess.run(
            command, capture_output=True, text=True, env={**os.environ, "COLUMNS": "80"}
        )
        if run.returncode:
            raise RuntimeError(
                f"diagnose.py --robot husky ended with {run.returncode}: {run.stderr.strip()}"
            )
        return run.stdout.replace(folder, "runs/diagnosis"), (
            Path(folder) / "report.html"
        ).read_bytes()


def worked_case() -> str:
    """Output of the command on the page of the diagnosis."""
    return f"```text\n{_diagnosed()[0].rstrip()}\n```"


GENERATED: dict[str, Callable[..., str]] = {
    part.__name__: part
    for part in (
        agents, causes, channels, conditions, counts, difficulties, dock_features, drives, effects, features, gauges,
        instruments, missions, bench,
        reference_scores, results, robot_file, robots, spaces, worked_case,
    )
}  # fmt: skip
"""Parts by the name that pages use; some take an argument, as in
`<!-- generated: results Speed -->`."""


def on_config(config: Any) -> Any:
    """Append pages that the navigation lacks."""
    named = set(re.findall(r"[\w/]+\.md", repr(config["nav"])))
    docs = Path(config["docs_dir"])
    pages = sorted(path.relative_to(docs).as_posix() for path in docs.rglob("*.md"))
    not_named = [page for page in pages if page not in named]
    if not_named:
        config["nav"] = [*config["nav"], {"More": not_named}]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the report of the worked case to the site."""
    files.append(File.generated(config, "worked_case/report.html", content=_diagnosed()[1]))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Make the generated parts anew. A link to a file outside the site becomes the file's name."""
    up_to_date = filled(markdown)
    if up_to_date != markdown:
        LOG.warning(
            f"{page.file.src_uri}: its generated parts are out of date; run python -m docs.generate"
        )
    up = r"\.\./" * (page.file.src_uri.count("/") + 1)
    return re.sub(rf"\[([^\]]+)\]\({up}([^)#]+)[^)]*\)", _outside, _COMMENTS.sub("", up_to_date))


def emptied(page: str) -> str:
    """A page without its generated parts, but with the comments that ask for them."""
    return _FILLED.sub(r"\1", page)


def filled(page: str) -> str:
    """A page with its generated parts made anew."""
    return _MARK.sub(lambda mark: f"{mark[0]}\n\n{_generated(mark)}\n\n{_END}", emptied(page))


def main() -> None:
    """Write the generated parts into all pages."""
    for path in sorted((ROOT / "docs").rglob("*.md")):
        page = path.read_text("utf-8")
        up_to_date = filled(page)
        if up_to_date != page:
            path.write_text(up_to_date, "utf-8")
            print(f"wrote {path.relative_to(ROOT)}")


def _generated(mark: re.Match[str]) -> str:
    """A part, its highest headings one level below the section of the page in which the comment
    is."""
    name, argument = mark.groups()
    make = GENERATED[name]
    part = make(argument) if argument else make()
    headings = re.compile(r"^(##+) ", re.MULTILINE)
    headings_above = ["#", *headings.findall(mark.string[: mark.start()])]
    level_above = len(headings_above[-1])
    highest = min(map(len, headings.findall(part)), default=level_above)
    deeper = level_above + 1 - highest
    return headings.sub(lambda heading: "#" * (len(heading[1]) + deeper) + " ", part)


def _outside(link: re.Match[str]) -> str:
    """A link to a file outside the site as the file's name."""
    text = link[1].strip("`")
    path = link[2]
    return f"`{path}`" if text == path else f"{text} (`{path}`)"


def on_page_content(content: str, **_: Any) -> str:
    """Turn equations into MathML, which browsers render without scripts."""
    return re.sub(
        r'<(span|div) class="arithmatex">\\[(\[](.+?)\\[)\]]</\1>',
        _equation,
        content,
        flags=re.DOTALL,
    )


def _equation(equation: re.Match[str]) -> str:
    is_block = equation[1] == "div"
    mathml = convert(html.unescape(equation[2]).strip(), display="block" if is_block else "inline")
    return f'<div class="equation">{mathml}</div>' if is_block else mathml


if __name__ == "__main__":
    main()
