"""The verdict as the terminal shows it."""

from collections.abc import Mapping

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from homeward.diagnosis.evidence import Analysis
from homeward.diagnosis.result import Fit, FittedGroup, MissingPhysics, Range
from homeward.diagnosis.tell.next_drive import GUIDE
from homeward.diagnosis.tell.words import ARMS, PAPER_ACCURACY, UNLIMITED, spanned
from homeward.layout.notation import decimal, interval, number, unit_after

_WIDE = 70  # columns that the table of all figures takes


def show(analysis: Analysis, console: Console) -> None:
    """Print the verdict, how well each model predicts, what is missing and what to do next; lines
    wrap at the width."""
    diagnosis = analysis.diagnosis
    console.print(diagnosis.verdict, style="bold", highlight=False)
    say(console, diagnosis.summary)
    if diagnosis.fit is not None and analysis.evidence is not None:
        console.print()
        _show_arms(diagnosis.fit, analysis.evidence.range_accuracy_pct, console)
    for effect in diagnosis.missing_physics:
        console.print()
        _show_effect(effect, console)
    if diagnosis.parameters_off:
        console.print()
        console.print("parameters off", style="bold", highlight=False)
    for group in diagnosis.parameters_off:
        _show_group(group, console)
    for product in diagnosis.products:
        value = product.value
        fitted = number(value.value) + unit_after(value.unit)
        fitted = f"{fitted} (95 %: {interval(value.ci95)})"
        say(console, f"{product.name}: {fitted}, only identifiable together", indent=2)
    if diagnosis.range is not None:
        console.print()
        _show_range(diagnosis.range, console)
    if diagnosis.next_experiment:
        console.print()
        say(
            console,
            f"Next experiment: {diagnosis.next_experiment} How to drive and record it: {GUIDE}.",
        )


def _show_arms(fit: Fit, accuracy_pct: Mapping[str, float | None], console: Console) -> None:
    """Print the held-out figures of each model, as a table that fits the width."""
    table = _arms(fit, accuracy_pct, with_intervals=console.width >= _WIDE)
    console.print(Padding(table, (0, 0, 0, 2)))
    claim = ""
    if fit.unit == "W":
        claim = f"; the paper claims a range accuracy of {PAPER_ACCURACY}"
    say(console, f"held out by {fit.held_out_by}, {fit.folds} folds{claim}", indent=2)


def _arms(fit: Fit, accuracy_pct: Mapping[str, float | None], with_intervals: bool) -> Table:
    """A row for each arm, of power with errors of energy and range; a narrow terminal has no room
    for intervals."""
    gap = 2 if with_intervals else 1  # columns of the terminal
    table = Table(box=None, padding=(0, gap, 0, 0), header_style="dim")
    table.add_column("model", no_wrap=True)
    headings = [f"RMSE, {fit.unit}"]
    if with_intervals:
        headings.append("95 %")
    headings.append("R^2")
    if fit.unit == "W":
        headings += ["trip energy\nerror", "range\naccuracy"]
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for name in ARMS:
        if name not in fit.arms:
            continue
        arm = fit.arms[name]
        figures = [number(arm.rmse)]
        if with_intervals:
            figures.append(interval(arm.rmse_ci95))
        figures.append("-" if arm.r2 is None else decimal(arm.r2, 3))
        if fit.unit == "W":
            figures += [_percent(arm.energy_error_pct), _percent(accuracy_pct.get(name))]
        style = "bold" if name == "corrected" else None
        table.add_row(name.replace("_", " "), *(plain(figure) for figure in figures), style=style)
    return table


def _show_effect(effect: MissingPhysics, console: Console) -> None:
    console.print(effect.name, style="bold", highlight=False)
    for name, value in effect.parameters.items():
        size = number(value.value) + unit_after(value.unit)
        limits = UNLIMITED if value.ci95 is None else f"95 %: {spanned(value)}"
        say(console, f"{name} = {size} ({limits})", indent=2)
    if effect.confused_with:
        rivals = ", ".join(effect.confused_with).replace("_", " ")
        say(console, f"confounded with: {rivals}. {effect.to_tell_apart}", indent=2)


def _show_group(group: FittedGroup, console: Console) -> None:
    """Print the fitted and the assumed value of a parameter that is off, and what explains as
    much."""
    fitted = f"{number(group.fitted)} {group.unit} (95 %: {interval(group.ci95)})"
    confounded = ""
    if group.confused_with:
        confounded = f"; or as much is lost by {' or '.join(group.confused_with)}"
    say(
        console,
        f"{group.group}: {fitted}, not {number(group.assumed)} as assumed{confounded}",
        indent=2,
    )


def _show_range(reach: Range, console: Console) -> None:
    """Print the range by both files beside the recorded one, and d_max by both."""
    by_files = (
        f"{number(reach.file_m)} m by corrected.toml, {number(reach.nominal_m)} m by the robot file"
    )
    recorded = f"recorded {number(reach.recorded_m)} m (95 %: {interval(reach.ci95)})"
    d_max = f"{number(reach.d_max_file_m)} m instead of {number(reach.d_max_nominal_m)} m"
    as_recorded = f"Range on one charge, driven as recorded: {by_files}; {recorded}."
    say(console, f"{as_recorded} d_max, at best speed on the level: {d_max}.")


def _percent(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{decimal(value, 1)} %"


def plain(text: str) -> str:
    """Text with ASCII dashes and minus signs."""
    return text.replace("–", "-").replace("−", "-")


def say(console: Console, text: str, indent: int = 0) -> None:
    """Print text that may hold names given by others: no markup, no control characters, only
    encodable ones."""
    printable = "".join(character if character.isprintable() else "?" for character in plain(text))
    encodable = printable.encode(console.encoding, "replace").decode(console.encoding)
    console.print(Padding(Text(encodable), (0, 0, 0, indent), expand=False))
