"""The verdict as the terminal shows it."""

from collections.abc import Mapping

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from homeward.diagnosis.evidence import Analysis
from homeward.diagnosis.result import Fit, MissingPhysics
from homeward.diagnosis.tell.next_drive import GUIDE
from homeward.diagnosis.tell.words import ARMS, PAPER_ACCURACY
from homeward.layout.notation import decimal, interval, number

_WIDE = 70  # columns that the table of all figures takes


def show(analysis: Analysis, console: Console) -> None:
    """Print the verdict, how well each model predicts, what is missing and what to do next; lines wrap at the width."""
    diagnosis, evidence = analysis.diagnosis, analysis.evidence
    console.print(diagnosis.verdict, style="bold", highlight=False)
    say(console, diagnosis.summary)
    if diagnosis.fit is not None and evidence is not None:
        console.print()
        table = _arms(diagnosis.fit, evidence.range_accuracy_pct, wide=console.width >= _WIDE)
        console.print(Padding(table, (0, 0, 0, 2)))
        claim = f"; the paper claims a range accuracy of {PAPER_ACCURACY}" if diagnosis.fit.unit == "W" else ""
        say(console, f"held out by {diagnosis.fit.held_out_by}, {diagnosis.fit.folds} folds{claim}", indent=2)
    for one in diagnosis.missing_physics:
        console.print()
        _show_effect(one, console)
    if diagnosis.parameters_off:
        console.print()
        console.print("parameters off", style="bold", highlight=False)
    for off in diagnosis.parameters_off:
        fitted = f"{number(off.fitted)} {off.unit} (95 %: {interval(off.ci95)})"
        alike = f"; or as much is lost by {' or '.join(off.confused_with)}" if off.confused_with else ""
        say(console, f"{off.group}: {fitted}, not {number(off.assumed)} as assumed{alike}", indent=2)
    for product in diagnosis.products:
        value = f"{number(product.value.value)} {product.value.unit} (95 %: {interval(product.value.ci95)})"
        say(console, f"{product.name}: {value}, only identifiable together", indent=2)
    if found := diagnosis.range:
        console.print()
        by_files = f"{number(found.file_m)} m by corrected.toml, {number(found.nominal_m)} m by the robot file"
        recorded = f"recorded {number(found.recorded_m)} m (95 %: {interval(found.ci95)})"
        d_max = f"{number(found.d_max_file_m)} m instead of {number(found.d_max_nominal_m)} m"
        say(console, f"Range on one charge, driven as recorded: {by_files}; {recorded}. "
                     f"d_max, at best speed on the level: {d_max}.")  # fmt: skip
    if diagnosis.next_experiment:
        console.print()
        say(console, f"Next experiment: {diagnosis.next_experiment} How to drive and record it: {GUIDE}.")


def _arms(fit: Fit, accuracy: Mapping[str, float | None], wide: bool) -> Table:
    table = Table(box=None, padding=(0, 2 if wide else 1, 0, 0), header_style="dim")
    table.add_column("model", no_wrap=True)
    energy = ("trip energy\nerror", "range\naccuracy") if fit.unit == "W" else ()
    for heading in (f"RMSE, {fit.unit}", *(["95 %"] if wide else []), "R^2", *energy):
        table.add_column(heading, justify="right", no_wrap=True)
    for name in ARMS:
        if name in fit.arms:
            arm = fit.arms[name]
            r2 = "-" if arm.r2 is None else decimal(arm.r2, 3)
            figures = [number(arm.rmse), *([interval(arm.rmse_ci95)] if wide else []), r2]
            if energy:
                figures += [_percent(arm.energy_error_pct), _percent(accuracy.get(name))]
            style = "bold" if name == "corrected" else None
            table.add_row(name.replace("_", " "), *(plain(figure) for figure in figures), style=style)
    return table


def _show_effect(one: MissingPhysics, console: Console) -> None:
    console.print(one.name, style="bold", highlight=False)
    for name, value in one.parameters.items():
        unit = "" if value.unit == "1" else f" {value.unit}"
        say(console, f"{name} = {number(value.value)}{unit} (95 %: {interval(value.ci95)})", indent=2)
    if one.confused_with:
        rivals = ", ".join(one.confused_with).replace("_", " ")
        say(console, f"confounded with: {rivals}. {one.to_tell_apart}", indent=2)


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{decimal(value, 1)} %"


def plain(text: str) -> str:
    """Text with ASCII dashes and minus signs."""
    return text.replace("–", "-").replace("−", "-")


def say(console: Console, text: str, indent: int = 0) -> None:
    """Print text that may hold names given by others: no markup, no control characters, only encodable ones."""
    shown = "".join(c if c.isprintable() else "?" for c in plain(text))
    shown = shown.encode(console.encoding, "replace").decode(console.encoding)
    console.print(Padding(Text(shown), (0, 0, 0, indent), expand=False))
