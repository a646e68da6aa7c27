"""A comparison of groups as the terminal and the page show it, and as groups.json."""

from collections.abc import Mapping
from pathlib import Path

import plotly.graph_objects as go
import plotly.offline
from markupsafe import Markup
from rich.console import Console
from rich.padding import Padding
from rich.table import Table

from homeward.diagnosis.tell.terminal import plain, say
from homeward.files import write_files
from homeward.groups.comparison import Comparison, Level
from homeward.layout.notation import interval, labels, number, page, templates, unit_after
from homeward.layout.plots import embedded

_BESIDE = (
    # of the distance between groups, from a mean to its runs in the plot; chosen: the intervals
    # stay visible
    0.15
)


def write_groups(comparison: Comparison, folder: str | Path) -> list[Path]:
    """Write groups.json and groups.html, each whole or not at all.

    Raises:
        OSError: The folder cannot be written to.
    """
    return write_files(
        folder, {"groups.json": comparison.to_json(), "groups.html": _page(comparison)}
    )


def show_groups(comparison: Comparison, console: Console) -> None:
    """Print the verdict, each group's level, each pair's difference and remarks; lines wrap at the
    width."""
    if len(comparison.groups) > 1:
        console.print(comparison.verdict, style="bold", highlight=False)
    say(console, comparison.summary)
    levels = _table("group", "quantity", "runs", "mean", "95 %", "between runs")
    for level in comparison.levels:
        cells = [
            level.group,
            level.quantity,
            str(level.runs),
            number(level.value, 4) + unit_after(level.unit),
            interval(level.ci95, 4),
            number(level.run_spread),
        ]
        levels.add_row(*(plain(cell) for cell in cells))
    pairs = _table("pair", "quantity", "difference", "95 %", "p, FDR", "held-out error", "")
    for pair in comparison.differences:
        cells = [
            f"{pair.group} - {pair.minus}",
            pair.quantity,
            number(pair.value) + unit_after(pair.unit),
            interval(pair.ci95),
            f"{pair.p_fdr:.2g}",
            f"{number(pair.held_out_rmse, 2)} for {number(pair.held_out_rmse_without_groups, 2)}",
            "differs" if pair.named else "",
        ]
        pairs.add_row(*(plain(cell) for cell in cells), style="bold" if pair.named else None)
    for table in (levels, pairs):
        if table.row_count:
            console.print()
            console.print(Padding(table, (0, 0, 0, 2)))
    for remark in _remarks(comparison, _labels(comparison)):
        say(console, f"- {remark}", indent=2)


def _table(*headings: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for heading in headings:
        is_text = heading in ("group", "quantity", "pair", "")
        table.add_column(heading, justify="left" if is_text else "right", overflow="fold")
    return table


def _page(comparison: Comparison) -> str:
    quantities = dict.fromkeys((level.quantity, level.unit) for level in comparison.levels)
    figures = [
        (quantity, unit, _figure(comparison, quantity, f"group-{index}"))
        for index, (quantity, unit) in enumerate(quantities)
    ]
    names = _labels(comparison)
    return page(
        templates("homeward.groups"),
        "groups.html",
        comparison=comparison,
        figures=figures,
        names=names,
        remarks=_remarks(comparison, names),
        verdict=comparison.verdict.replace("_", " ").capitalize(),
        plotly=Markup(plotly.offline.get_plotlyjs()) if figures else "",
    )


def _labels(comparison: Comparison) -> dict[str, str]:
    return labels([run.path for run in comparison.runs])


def _remarks(comparison: Comparison, names: Mapping[str, str]) -> list[str]:
    """The remarks, of which those of a recording begin with its name, with short names."""
    parts = [remark.partition(": ") for remark in comparison.remarks]
    return [f"{names.get(path, path)}{colon}{text}" for path, colon, text in parts]


def _figure(comparison: Comparison, quantity: str, name: str) -> Markup:
    """Levels and runs by the number of the group: a plot would interpret markup in names given by
    others."""
    number_of = {group: index for index, group in enumerate(comparison.groups, start=1)}
    levels = [level for level in comparison.levels if level.quantity == quantity]
    runs = [run for run in comparison.runs if run.values.get(quantity) is not None]
    figure = go.Figure()
    figure.add_scatter(
        x=[number_of[run.group] + _BESIDE for run in runs],
        y=[run.values[quantity] for run in runs],
        mode="markers",
        name="runs",
        marker={"color": "#7b8794"},
    )
    figure.add_scatter(
        x=[number_of[level.group] for level in levels],
        y=[level.value for level in levels],
        mode="markers",
        name="mean, 95 %",
        error_y={"type": "data", "array": [_half_interval(level) for level in levels]},
        marker={"color": "#0b7285", "size": 9},
    )
    figure.update_xaxes(title_text="group, in the order of the table", dtick=1)
    means = "; ".join(
        f"{level.group} {number(level.value, 4)} {level.unit}, 95 % {interval(level.ci95, 4)}"
        for level in levels
    )
    return embedded(
        figure, name, f"{quantity}, means: {means}. The tables below have them and each run."
    )


def _half_interval(level: Level) -> float:
    """Half of the 95 % interval, 0 where there is none."""
    if level.ci95 is None:
        return 0.0
    _, high = level.ci95
    return high - level.value
