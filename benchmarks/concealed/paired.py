"""Diagnose the same recordings with this version and with another, and count what fell.

`python -m benchmarks.concealed.paired CHECKOUT --seed 432 --cases 100 --out runs/paired`

CHECKOUT is a folder with another version of the project. The cases, their recordings and the
counting are this version's, so that only the diagnosis differs. Writes DIR/paired.json (every
outcome of both) and DIR/paired.md (the table).
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import tyro
from rich.console import Console
from rich.markdown import Markdown
from scipy import stats

from benchmarks.concealed.plants.cases import Case, Part
from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.scoring.count import (
    Table,
    all_visible,
    false_alarm,
    first_class,
    found_first,
    in_some_class,
    is_mismatch_missed,
    mean_errors_pct,
    named_itself,
    usable,
    wrongly_named,
)
from benchmarks.concealed.scoring.outcome import (
    NOMINAL,
    RECORDINGS,
    Outcome,
    ask,
    error_pct,
    read_diagnosis,
    unanswered,
    write_inputs,
)
from homeward.parallel import run_tasks
from homeward.physics import load_robot

GUARDED: tuple[Part, ...] = ("singles", "pairs", "controls", "outside")
"""Parts that a change of the diagnosis must not make worse."""
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Args:
    """Which versions are compared, and on what."""

    before: Annotated[Path, tyro.conf.Positional]
    """Folder of a checkout of the other version, whose dependencies are those of this one."""
    seed: int = 1
    """Seed of all cases."""
    cases: int = 100
    """Cases of each part."""
    parts: tuple[Part, ...] = GUARDED
    """Parts of the benchmark."""
    unknown_before: tuple[str, ...] = ()
    """Fields of a robot file that the other version refuses; their lines are left out of its copy.
    A field that a case sets is not left out: the command stops and says so."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/paired")
    """Folder for paired.json, paired.md and the diagnoses."""


class Pair(NamedTuple):
    """One case, diagnosed by the other version and by this one."""

    before: Outcome
    now: Outcome


def main(args: Args) -> list[Pair]:
    """Diagnose with both versions, print and write the table."""
    before = args.before.resolve()
    check_version(before)
    args.out.mkdir(parents=True, exist_ok=True)
    tasks = {
        f"{part} {number}": (part, number) for part in args.parts for number in range(args.cases)
    }

    def diagnose_both(task: tuple[Part, int]) -> Pair:
        part, number = task
        case = make_case(part, args.seed, number)
        folder = args.out.resolve() / part / f"{number:04d}"
        earlier = ask_version(case, folder / "before", before, args.unknown_before)
        return Pair(earlier, ask(case, folder / "now"))

    pairs = list(run_tasks(diagnose_both, tasks, jobs=args.workers, title="cases").values())
    text = table(pairs).markdown()
    console = Console()
    console.width = max(console.width, 120)  # a log file has no width of its own
    console.print(Markdown(text))
    outcomes = [
        {name: dataclasses.asdict(outcome) for name, outcome in pair._asdict().items()}
        for pair in pairs
    ]
    written = {"seed": args.seed, "cases": args.cases, "parts": args.parts, "pairs": outcomes}
    (args.out / "paired.json").write_text(json.dumps(written, indent=1))
    (args.out / "paired.md").write_text(text)
    return pairs


def check_version(checkout: Path) -> None:
    """Exit with a line if Python, started in the checkout, does not import the checkout's version:
    both diagnoses would be this version's."""
    asked = "import homeward; print(homeward.__file__)"
    answer = _python(checkout, "-c", asked)
    imported = Path(answer.stdout.strip())
    if answer.returncode != 0 or not imported.is_relative_to(checkout):
        reason = f"it imports {imported}" if answer.returncode == 0 else answer.stderr.strip()
        sys.exit(f"{checkout} is no checkout of homeward that runs here: {reason}")


def ask_version(case: Case, folder: Path, checkout: Path, unknown: Sequence[str] = ()) -> Outcome:
    """Diagnose a case with the version in `checkout`, by its command line.

    The outcome's errors of later drives are those of the given and the corrected file.

    Raises:
        ValueError: The case sets a field that the other version does not know.
    """
    outcome = unanswered(case)
    runs = write_inputs(case, folder)
    _leave_out(folder / NOMINAL, unknown)
    words = [*map(str, runs), "--robot", str(folder / NOMINAL), "--out", str(folder)]
    answer = _python(checkout, "-m", "homeward", "diagnose", *words)
    shutil.rmtree(folder / RECORDINGS)
    diagnosis = folder / "diagnosis.json"
    if diagnosis.exists():
        read_diagnosis(outcome, json.loads(diagnosis.read_text()), case)
        _read_file(outcome, case, folder / "corrected.toml")
        return outcome
    outcome.verdict = "crash" if "Traceback" in answer.stderr else "refused"
    outcome.summary = answer.stderr
    return outcome


def _python(checkout: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python with the checkout's packages before those that are installed."""
    return subprocess.run(
        [sys.executable, *words],
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(checkout)},
        capture_output=True,
        text=True,
        check=False,
    )


def _leave_out(robot_file: Path, unknown: Sequence[str]) -> None:
    kept = []
    for line in robot_file.read_text().splitlines(keepends=True):
        name, _, rest = line.partition("=")
        if name.strip() not in unknown:
            kept.append(line)
            continue
        value = rest.partition("#")[0].strip()
        if float(value) != 0.0:
            raise ValueError(
                f"{robot_file} sets {name.strip()} = {value}, which the other version does not know."
            )
    robot_file.write_text("".join(kept))


def _read_file(outcome: Outcome, case: Case, corrected_file: Path) -> None:
    corrected = load_robot(corrected_file)
    outcome.holds = list(corrected.active_effects)
    for drive in case.later:
        errors_pct = {
            "nominal": error_pct(case.nominal, drive),
            "corrected": error_pct(corrected, drive),
        }
        outcome.later.append(errors_pct)


@dataclass(frozen=True)
class Count:
    """What is counted of which cases."""

    part: Part
    what: str
    is_so: Callable[[Outcome], bool]
    is_asked: Callable[[Outcome], bool] = lambda outcome: True


def _without_ageing(outcome: Outcome) -> bool:
    """Whether no worn battery is hidden, of which a part of a charge tells little."""
    return "ageing" not in outcome.hidden


def _by_first_name(outcome: Outcome) -> bool:
    return bool(outcome.classes) and outcome.classes[0][0] == outcome.hidden[0]


def _both_in_class(outcome: Outcome) -> bool:
    return all(in_some_class(outcome, effect) for effect in outcome.hidden)


def _both_by_name(outcome: Outcome) -> bool:
    return all(named_itself(outcome, effect) for effect in outcome.hidden)


def _first_is_one_of_them(outcome: Outcome) -> bool:
    return not set(first_class(outcome)).isdisjoint(outcome.hidden)


def _honest(outcome: Outcome) -> bool:
    """Whether physics outside the catalogue is called unknown, or described fairly."""
    seen = outcome.verdict in ("unknown_physics", "missing_physics")
    return seen and not wrongly_named(outcome)


def _file_is_worse(outcome: Outcome) -> bool:
    """Whether corrected.toml is off by over a point more than the given file on later drives."""
    if not outcome.later:
        return False
    errors = _errors_pct(outcome)
    return errors["corrected"] > errors["nominal"] + 1.0


def _errors_pct(outcome: Outcome) -> Mapping[str, float]:
    return dict(zip(outcome.later[0], mean_errors_pct(outcome), strict=True))


COUNTS = (
    Count("singles", "found first", found_first),
    Count("singles", "found first, but ageing", found_first, _without_ageing),
    Count("singles", "the first name", _by_first_name),
    Count("singles", "visible, and the verdict names no missing physics", is_mismatch_missed, all_visible),
    Count("singles", "corrected.toml worse than the given file", _file_is_worse),
    Count("pairs", "both found, each in some class", _both_in_class),
    Count("pairs", "both found, but ageing", _both_in_class, _without_ageing),
    Count("pairs", "both by name", _both_by_name),
    Count("pairs", "one of them in the first class", _first_is_one_of_them),
    Count("pairs", "corrected.toml worse than the given file", _file_is_worse),
    Count("controls", "false alarm", false_alarm),
    Count("controls", "false alarm, of those that are usable", false_alarm, usable),
    Count(
        "controls",
        "exact file, called `parameters_off`",
        lambda case: case.verdict == "parameters_off",
        lambda case: case.label == "exact",
    ),
    Count("outside", "wrongly named", wrongly_named),
    Count("outside", "unknown physics, or a fair name", _honest),
)  # fmt: skip


def table(pairs: Sequence[Pair]) -> Table:
    """Counts of both versions, and their paired difference with its 95 % interval."""
    rows = []
    for count in COUNTS:
        counted = [
            pair for pair in pairs if pair.now.part == count.part and count.is_asked(pair.now)
        ]
        if counted:
            before = [count.is_so(pair.before) for pair in counted]
            now = [count.is_so(pair.now) for pair in counted]
            shares = (f"{sum(before)} of {len(before)}", f"{sum(now)} of {len(now)}")
            rows.append((count.part, count.what, *shares, change(before, now, 100.0, " %", 0)))
    for part in ("singles", "pairs"):
        filed = [
            pair for pair in pairs if pair.now.part == part and pair.before.later and pair.now.later
        ]
        if filed:
            before_pct = [_errors_pct(pair.before)["corrected"] for pair in filed]
            now_pct = [_errors_pct(pair.now)["corrected"] for pair in filed]
            means = (f"{np.mean(before_pct):.2f} %", f"{np.mean(now_pct):.2f} %")
            what = f"mean error of corrected.toml on later drives, {len(filed)} cases"
            rows.append((part, what, *means, change(before_pct, now_pct, 1.0, " points", 2)))
    return Table(
        "Both versions", ("part", "what is counted", "before", "now", "difference, 95 %"), rows
    )


def change(
    before: Sequence[float], now: Sequence[float], scale: float, unit: str, digits: int
) -> str:
    """Mean of the paired differences, with its interval by Student's t.

    >>> change([True, True, False, True], [True, False, False, False], 100.0, " %", 0)
    '-50 % (-142 to 42)'
    >>> change([True, False], [True, False], 100.0, " %", 0)
    '0 %, no case differs'
    >>> change([1.5], [1.0], 1.0, " points", 2)
    '-0.50 points, of one case'
    """
    differences = scale * (np.asarray(now, dtype=float) - np.asarray(before, dtype=float))
    mean = float(np.mean(differences))
    if not np.any(differences):
        return f"0{unit}, no case differs"
    if len(differences) == 1:
        return f"{mean:.{digits}f}{unit}, of one case"
    error = stats.sem(differences)
    half_width = float(error * stats.t.ppf(0.5 + CONFIDENCE / 2.0, len(differences) - 1))
    return f"{mean:.{digits}f}{unit} ({mean - half_width:.{digits}f} to {mean + half_width:.{digits}f})"


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
