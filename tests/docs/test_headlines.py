"""Headline figures of the README are those of the page of results; here each is computed from
it."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

WORDS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
FIGURE = re.compile(
    rf"\d|\b(?:{'|'.join(WORDS[2:])}|half|third|quarter|twice|hundred|thousand|million)\b"
)


class Results:
    """The page of results, by sections."""

    def __init__(self, page: str) -> None:
        parts = re.split(r"^###? (.+)\n", page, flags=re.MULTILINE)
        self._sections = dict(zip(parts[1::2], parts[2::2], strict=True))

    def text(self, heading: str) -> str:
        """A section in one line."""
        return " ".join(self._sections[heading].split())

    def rows(self, heading: str) -> Iterator[dict[str, str]]:
        """Rows of all tables of a section: cells by the name of their column."""
        for table in re.findall(r"(?:^\|.*\n?)+", self._sections[heading], re.MULTILINE):
            head, _, *lines = (
                [cell.strip() for cell in line.strip("|").split(" |")]
                for line in table.splitlines()
            )
            yield from (dict(zip(head, line, strict=True)) for line in lines)

    def cell(self, heading: str, row: str, column: str) -> str:
        """The one cell of a column in the row that has a cell `row`."""
        (found,) = (
            one[column] for one in self.rows(heading) if column in one and row in one.values()
        )
        return found

    def number(self, heading: str, row: str, column: str) -> float:
        """The first number of that cell."""
        found = re.match(r"[-+]?[\d.]+", self.cell(heading, row, column))
        assert found is not None, (heading, row, column)
        return float(found[0])


def train_and_simulate(results: Results) -> str:
    """Of the policies that a training keeps."""
    section = "How much is learned"
    start = results.number(section, "OutAndBack", "`dmax_belief`")
    best = results.number(section, "OutAndBack", "`dmax_adaptive`")
    kept = results.number(section, "OutAndBack, `dmax`", "kept")
    from_rule = results.number(section, "OutAndBack, `dmax`", "kept minus best rule")
    from_nothing = results.number(section, "OutAndBack, `scratch`", "kept minus best rule")
    return (
        f"on OutAndBack, PPO that starts from the rule `dmax_belief` scores {100.0 * (kept / start - 1.0):.0f} % above "
        f"it and {100.0 * from_rule / best:.0f} % above the best d_max rule without online estimates; from nothing, "
        f"{100.0 * from_nothing / best:.0f} % above the latter"
    )


def compare_agents(results: Results) -> str:
    share = results.cell(
        "How close the bound and the rollout are", "OutAndBack", "planner over rollout"
    )
    return f"on OutAndBack in still weather, the planner reaches {share} of the score found with full knowledge"


def diagnose_logs(results: Results) -> str:
    section = "Later drives of real vehicles"
    rows = [
        row
        for row in results.rows(section)
        if "later drives" in row and re.fullmatch(r"\*\*.*, mean of \d+\*\*", row["later drives"])
    ]
    vehicles = WORDS[len(rows)]

    def errors_pct(*columns: str) -> str:
        """Smallest and largest error over the vehicles, of the column that is best for each."""
        best = [
            min(results.number(section, row["later drives"], column) for column in columns)
            for row in rows
        ]
        return f"{min(best):.0f} to {max(best):.0f} %"

    corrected = errors_pct("`corrected.toml`")
    given = errors_pct("given file")
    regression = errors_pct("ridge", "least squares")
    return (
        f"later drives of {vehicles} vehicles: all energy is off by {corrected} with the corrected "
        f"file, by {given} with the given one, by {regression} with the better of two regressions; "
        "anybody can repeat those of the Husky and the F1TENTH car"
    )


def watch_a_robot(results: Results) -> str:
    gauges = results.text("Gauges")
    companion = re.search(r"\| all \| \d+ of (\d+), ([\d.]+ %) \([^)]*\) \| (\d+ %)", gauges)
    at_half = re.search(r'\| "turn at half charge" \| \d+ of \d+, (\d+ %)', gauges)
    assert companion is not None and at_half is not None
    return (
        f"of {companion[1]} simulated drives with old, cold packs and wrong gauges {companion[2]} strand, and "
        f"{companion[3]} of the charge is left at home; of those that turn at half charge {at_half[1]} strand"
    )


def when_not_to_use(results: Results) -> str:
    def in_ten(row: str) -> str:
        """How many of ten, in a word, as the mean of the seeds at which nobody has looked."""
        counts = [results.number("Concealed cases", row, f"now, {seed}") for seed in (434, 435)]
        return f"{WORDS[round(sum(counts) / len(counts) / 10.0)]} of ten"

    single = in_ten("found first")
    both = in_ten("both by name")
    not_in_catalogue = in_ten("a wrong name")
    return (
        f"names one missing effect in {single} [concealed cases](docs/concealed.md), and two at once in {both}. "
        f"A cause that its catalogue lacks gets a wrong name in {not_in_catalogue}"
    )


TABLE = (train_and_simulate, compare_agents, diagnose_logs, watch_a_robot)


@pytest.fixture(scope="module")
def results(root: Path) -> Results:
    return Results((root / "docs" / "results.md").read_text("utf-8"))


def part_of(root: Path, heading: str) -> str:
    """A section of the README."""
    page = (root / "README.md").read_text("utf-8")
    return page.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def test_the_table_of_the_readme_has_the_figures_of_the_results(
    root: Path, results: Results
) -> None:
    lines = [line for line in part_of(root, "I want to ...").splitlines() if line.startswith("| ")][
        1:
    ]
    headlines = [line.split(" | ")[2] for line in lines]
    assert headlines == [sentence(results) for sentence in TABLE]


def test_the_limits_of_the_readme_have_the_figures_of_the_results(
    root: Path, results: Results
) -> None:
    limits = " ".join(part_of(root, "When not to use this").split())
    sentence = when_not_to_use(results)
    assert sentence in limits
    assert FIGURE.findall(limits.replace(sentence, "")) == [], (
        "a figure that is compared with no result"
    )
