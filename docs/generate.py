"""What the pages take from the code when the site is built, so that it cannot drift; MkDocs calls the hooks by name.

A page asks with a comment on a line of its own: `<!-- generated: features -->`. An unknown name fails the build.
"""

from __future__ import annotations

import dataclasses
import functools
import html
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

from homeward.agents.registry import AGENTS
from homeward.diagnosis.explain.hypotheses import CATALOGUE
from homeward.envs import IDS
from homeward.envs.difficulty import DIFFICULTY, DRAWN
from homeward.envs.features import FEATURES
from homeward.envs.instruments import INSTRUMENTS, Instruments
from homeward.envs.options import Options, known_of
from homeward.physics import CAUSES, EFFECTS, Robot, d_max, load_robot, optimal_speed, preset_names
from homeward.physics.effects import Parameter
from homeward.physics.kernel import BASE_CAUSES

ROOT = Path(__file__).resolve().parents[1]

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
    "how much harder the roughest ground rolls, as a share,",
)
"""What is drawn, in the order of `homeward.envs.difficulty.DRAWN`."""

AGENT_WORDS = {
    "random": "draws from the action space: the least that any agent must beat",
    "soc50": "turns back at half charge",
    "dmax": "the paper's rule: turns back when Eq. 8, at the average grade, just reaches home",
    "dmax_mapped": "costs the way home over the ground that it drove on the way out",
    "dmax_adaptive": "scales that cost by what it measures, and keeps a reserve of k standard deviations",
    "dmax_belief": "estimates robot and wind, costs the way home by that, and keeps k standard deviations in reserve",
    "planner": "finds out what the robot is today and turns back by that; senses and stops by what it is worth",
    "ppo": "a network trained by PPO from the d_max rule, with what the robot believes as inputs",
    "ppo_scratch": "a network trained by PPO from nothing, on the observation alone",
}
"""What each agent does."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown; bars inside cells are escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def features() -> str:
    """What an agent observes."""
    rows = ([str(i), f"`{name}`", unit, meaning] for i, (name, unit, meaning) in enumerate(FEATURES))
    return table(("index", "feature", "in units of", "what it is"), rows)


def causes() -> str:
    """Columns of the energy ledger."""
    own = ", ".join(f"`{name}`" for name in BASE_CAUSES)
    effects = ", ".join(f"[`{name}`](effects.md#{name})" for name in CAUSES[len(BASE_CAUSES) :])
    return f"* of the paper's model: {own}\n* of effects, where they are on: {effects}"


def missions() -> str:
    """Scale of each mission with the default robot."""
    rows = []
    for mission, env_id in IDS.items():
        s = known_of(Options(mission)).shared[0]
        rows.append(
            (
                *(f"`{env_id}`", f"{s['length_m']:.0f} m", f"{s['cruise_mps']:.2g} m/s"),
                *(f"{s['decision_s']:g} s", f"{s['max_decisions']}", f"{s['score_scale']:.4g}"),
            )
        )
    head = ("id", "route", "cruise", "decision every", "time limit, decisions", "good score")
    return table(head, rows)


def difficulties() -> str:
    """What is hidden at each difficulty, from the table of it."""
    rows = []
    for name, one in DIFFICULTY.items():
        drawn = [
            f"{words} {number.low:g} to {number.high:g}"
            for words, number in zip(DRAWN_WORDS, (getattr(one, drawn) for drawn in DRAWN), strict=True)
            if number.high > number.low
        ]
        rows.append((
            *(f"`{name}`", f"`{one.instruments}`", "changes" if one.weather_changes else "as at the start"),
            "known" if one.route_is_known else "seen two places ahead, forecast beyond",
            "; ".join(drawn) or "nothing",
        ))  # fmt: skip
    return table(
        ("difficulty", "instruments", "weather", "route and wind", "drawn anew for each mission, hidden"), rows
    )


def instruments() -> str:
    """Sizes of the errors of each set of instruments."""
    names = [field.name for field in dataclasses.fields(Instruments)]
    rows = ((f"`{size}`", *(f"{getattr(one, size):g}" for one in INSTRUMENTS.values())) for size in names)
    return table(("size", *(f"`{name}`" for name in INSTRUMENTS)), rows)


def robots() -> str:
    """Robots that ship, with the range that the model gives them."""
    rows = []
    for name in preset_names():
        robot = load_robot(name)
        rows.append(
            (
                *(f"`{name}`", f"{robot.mass_kg:g} kg", f"{robot.usable_energy_j / 3600.0:.3g} Wh"),
                *(f"{float(optimal_speed(robot)):.2g} m/s", f"{float(d_max(robot)) / 1000.0:.3g} km"),
            )
        )
    return table(
        ("robot", "mass", "battery", "speed with the longest range", "d_max on the flat, sensing nothing"), rows
    )


def robot_file() -> str:
    """Numbers of a robot file, as the fields of `Robot` declare them."""
    rows = []
    for field in dataclasses.fields(Robot):
        if "bounds" in field.metadata:
            default = "required" if field.default is dataclasses.MISSING else f"{field.default:g}"
            said = field.metadata
            rows.append((said["section"], f"`{field.name}`", said["meaning"], str(said["bounds"]), default))
    return table(("section", "name", "what it is", "allowed", "if left out"), sorted(rows, key=lambda row: row[0]))


def agents() -> str:
    """Agents that `evaluate.py` knows."""
    return table(("name", "what it does"), ((f"`{name}`", AGENT_WORDS[name]) for name in AGENTS))


def effects() -> str:
    """Every effect and every fault of an instrument: a table of all, then one section each."""
    rows = ([f"[`{name}`](#{name})", ENTERS[one.entry.kind], one.entry.sentence] for name, one in CATALOGUE.items())
    return "\n\n".join([table(("id", "enters", "in words"), rows), *map(_effect, CATALOGUE)])


def _effect(name: str) -> str:
    hypothesis = CATALOGUE[name]
    one = hypothesis.entry
    head = ("parameter", "unit", "least", "most", "if left out", "what it is")
    numbers = [_number(parameter, hypothesis.physical) for parameter in one.parameters]
    alike = ", ".join(f"[`{other}`](#{other})" for other in one.confused_with) or "nothing"
    switch = one.switch.name
    parts = [
        f"## `{name}` {{ #{name} }}",
        one.sentence,
        f"```text\n{one.equation}\n```",
        table(head, numbers),
        f"Source: {one.source}.  \nChannels that show it: {', '.join(f'`{need}`' for need in one.needs)}.  \n"
        f"Easily confused with: {alike}.",
    ]
    if hypothesis.physical:
        parts.append(f"In a robot file it is the section `[effects.{name}]`; `{switch}` at zero switches it off.")
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


def counts() -> str:
    """How many hypotheses there are."""
    return (
        f"{len(CATALOGUE)} hypotheses: {len(EFFECTS)} effects, which the environments know too, and "
        f"{len(CATALOGUE) - len(EFFECTS)} faults of instruments, which correct the reading and nothing else."
    )


def results(heading: str) -> str:
    """A section of the page of results, so that they stand in one place."""
    sections = re.split(r"^## +(.+)\n", (ROOT / "docs" / "results.md").read_text("utf-8"), flags=re.MULTILINE)
    found = dict(zip(sections[1::2], sections[2::2], strict=True))
    if heading not in found:
        raise KeyError(f"results.md has no section {heading!r}, only {', '.join(found)}")
    return found[heading].strip()


@functools.cache
def _diagnosed() -> tuple[str, bytes]:
    """What `diagnose.py` prints of the recording that ships, and its report."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(ROOT / "diagnose.py"), "--robot", "husky", "--out", folder]
        run = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "COLUMNS": "80"})
        if run.returncode:
            raise RuntimeError(f"diagnose.py --robot husky ended with {run.returncode}: {run.stderr.strip()}")
        return run.stdout.replace(folder, "runs/diagnosis"), (Path(folder) / "report.html").read_bytes()


def worked_case() -> str:
    """What the command of the page on diagnosis prints."""
    return f"```text\n{_diagnosed()[0].rstrip()}\n```"


GENERATED: dict[str, Callable[..., str]] = {
    "features": features, "causes": causes, "missions": missions, "difficulties": difficulties,
    "instruments": instruments, "robots": robots,
    "robot_file": robot_file, "agents": agents, "effects": effects, "counts": counts, "results": results,
    "worked_case": worked_case,
}  # fmt: skip
"""What pages may ask for; `results` takes a heading, as in `<!-- generated: results Speed -->`."""


def on_config(config: Any) -> Any:
    """Put pages that the navigation does not name yet at its end, so that none is lost."""
    named = set(re.findall(r"[\w/]+\.md", repr(config["nav"])))
    docs = Path(config["docs_dir"])
    others = sorted(path.relative_to(docs).as_posix() for path in docs.rglob("*.md"))
    if more := [name for name in others if name not in named]:
        config["nav"] = [*config["nav"], {"More": more}]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the report of the worked case to the site."""
    files.append(File.generated(config, "worked_case/report.html", content=_diagnosed()[1]))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in what is generated. A link to a file beside the pages becomes its name: the site holds pages only."""
    filled = re.sub(
        r"^<!-- generated: (\w+) ?(.*?) -->$",
        lambda mark: GENERATED[mark[1]](*filter(None, [mark[2]])),
        markdown,
        flags=re.MULTILINE,
    )
    return re.sub(r"\[([^\]]+)\]\(\.\./([^)#]+)[^)]*\)", _outside, filled)


def _outside(link: re.Match[str]) -> str:
    said, path = link[1].strip("`"), link[2]
    return f"`{path}`" if said == path else f"{said} (`{path}`)"


def on_page_content(content: str, **_: Any) -> str:
    """Turn equations into MathML, which browsers set by themselves: no script, nothing to fetch."""
    return re.sub(r'<(span|div) class="arithmatex">\\[(\[](.+?)\\[)\]]</\1>', _equation, content, flags=re.DOTALL)


def _equation(found: re.Match[str]) -> str:
    block = found[1] == "div"
    mathml = convert(html.unescape(found[2]).strip(), display="block" if block else "inline")
    return f'<div class="equation">{mathml}</div>' if block else mathml
