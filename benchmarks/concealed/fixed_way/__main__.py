"""Diagnose drives along one fixed way in which the ground, the motion or a load is not as the robot
file says, and count the correct diagnoses.

`python -m benchmarks.concealed.fixed_way --cases 01 07 --workers 2 --out runs/fixed_way` prints a
table, writes DIR/fixed_way.json (every outcome), and the outputs of the diagnosis of each case. It
diagnoses all cases if none is given.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from rich.table import Table

from benchmarks.concealed.fixed_way.cases import CASES, Case, simulate
from benchmarks.concealed.fixed_way.score import is_right, wrong_names
from benchmarks.concealed.plants.cases import Case as Concealed
from benchmarks.concealed.scoring.count import named
from benchmarks.concealed.scoring.outcome import Outcome, ask
from benchmarks.tables import table
from homeward.parallel import run_tasks
from homeward.physics import load_robot

ROBOT = "husky"  # the preset that the simulated robot equals
WIDTH = 170  # chosen: characters, so that most rows stay in a line


@dataclass(frozen=True)
class Args:
    """What to run."""

    cases: tuple[str, ...] = tuple(CASES)
    """Numbers of cases."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/fixed_way")
    """Folder for fixed_way.json and the diagnoses."""

    def __post_init__(self) -> None:
        unknown = [number for number in self.cases if number not in CASES]
        if unknown:
            raise ValueError(f"no case {', '.join(unknown)}; there are {', '.join(CASES)}")


@dataclass(frozen=True)
class Answer:
    """A case and its diagnosis."""

    number: str
    energy_shares: dict[str, float]  # of all energy, by hidden part
    outcome: Outcome

    @property
    def case(self) -> Case:
        """The case."""
        return CASES[self.number]


def main(args: Args) -> list[Answer]:
    """Simulate the cases, diagnose them, print and write the answers."""
    args.out.mkdir(parents=True, exist_ok=True)
    tasks = {f"case {number}": (number, args.out) for number in args.cases}
    answers = list(
        run_tasks(lambda task: run_case(*task), tasks, jobs=args.workers, title="cases").values()
    )
    console = Console()
    console.width = max(console.width, WIDTH)  # a log file has no width of its own
    console.print(answer_table(answers))
    written = [dataclasses.asdict(answer) for answer in answers]
    (args.out / "fixed_way.json").write_text(json.dumps(written, indent=1))
    return answers


def run_case(number: str, out: Path) -> Answer:
    """Simulate one case and diagnose it."""
    case = CASES[number]
    simulated = simulate(case)
    robot = load_robot(ROBOT)
    concealed = Concealed(
        part="outside",  # of the parts, it is nearest to the one with mechanisms of other forms
        number=int(number),
        vehicle=ROBOT,
        label=case.title,
        hidden=case.effects,
        truth=robot,
        nominal=robot,
        recordings=list(simulated.recordings),
        refit_misses={},
        fair=frozenset((*case.effects, *case.tolerated)),
    )
    outcome = ask(concealed, out / number)
    return Answer(number, simulated.scene.energy_shares(), outcome)


def answer_table(answers: Sequence[Answer]) -> Table:
    """The cases with what is hidden, what is said, and whether it is right; last the totals."""
    made = table("One fixed way", ("case", "hidden", "verdict", "names"), ("right", "wrong names"))
    right_count = 0
    wrong_count = 0
    for answer in answers:
        case = answer.case
        outcome = answer.outcome
        right = is_right(case, outcome)
        wrong = wrong_names(case, outcome)
        right_count += right
        wrong_count += wrong
        made.add_row(
            f"{case.number} {case.title}",
            hidden_text(case, answer.energy_shares),
            outcome.verdict,
            ", ".join("/".join(names) for names in named(outcome)),
            "yes" if right else "no",
            str(wrong),
        )
    made.add_section()
    made.add_row(f"{len(answers)} cases", "", "", "", str(right_count), str(wrong_count))
    return made


def hidden_text(case: Case, energy_shares: dict[str, float]) -> str:
    """The true effects and the share of all energy that each hidden part consumes.

    >>> hidden_text(CASES["01"], {"surface_share": 0.11, "payload_kg": 0.09, "all": 0.18})
    'surface, payload: 11 %, 9 %'
    >>> hidden_text(CASES["05"], {"drive_share": 0.08, "all": 0.08})
    'not in the catalogue: 8 %'
    >>> hidden_text(CASES["14"], {"all": 0.0})
    'nothing'
    """
    parts = [share for part, share in energy_shares.items() if part != "all"]
    if not parts:
        return "nothing"
    effects = ", ".join(case.effects) or "not in the catalogue"
    shares = ", ".join(f"{100 * share:.0f} %" for share in parts)
    return f"{effects}: {shares}"


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
