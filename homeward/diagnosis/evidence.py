"""The evidence behind a verdict, and the diagnosis with it, for the report, the terminal and other
tools."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from homeward.diagnosis.explain.channel_effects.shown import Capacity, ChannelEffect
from homeward.diagnosis.explain.formula import Empirical
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.explain.limits import Limit
from homeward.diagnosis.explain.named import Naming
from homeward.diagnosis.explain.places import Location
from homeward.diagnosis.explain.residual_test import Dependence
from homeward.diagnosis.explain.together import RemainingDependence
from homeward.diagnosis.explain.uncertainty import Joint
from homeward.diagnosis.fit.estimates import Estimate
from homeward.diagnosis.fit.folds import cut_folds
from homeward.diagnosis.fit.held_out import range_accuracy_pct
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs, power_w
from homeward.diagnosis.fit.usable import Finding
from homeward.diagnosis.result import Diagnosis, FittedGroup, Product
from homeward.logs.channels import Array, Index
from homeward.physics import Robot


@dataclass(frozen=True)
class Evidence:
    """The evidence behind the verdict, for the report; arrays of shape (windows,).

    There is no arm `nominal` where the robot file cannot predict what was recorded (motor current
    without a known thrust per ampere), and none `corrected` where nothing was named and no formula
    was found.
    """

    runs: Runs
    fitted: Refit
    # groups that are not identifiable held at the robot file's value, where the data allow that
    plain: Refit
    block: Index
    fold: Index  # windows held out together have one number
    held_out_by: Literal["run", "block"]
    predictions: Mapping[str, Array]  # by arm, held out
    estimates: tuple[Estimate, ...]
    dependences: tuple[Dependence, ...]
    location: Location | None
    naming: Naming
    corrected: Corrected | None  # the fitted model, where effects were named
    # the formula that the mismatch follows, where no effect explains it
    empirical: Empirical | None
    capacity: Capacity | None  # of the battery, where its state of charge was recorded
    channel_effects: tuple[ChannelEffect, ...]  # effects that other channels than power show
    # the residual of the named effects, where it still depends on a channel
    remaining: RemainingDependence | None
    limits: Mapping[str, Limit]  # of numbers that are known from one side only, by name
    products: tuple[Product, ...]  # identifiable although their factors are not
    joint: Joint  # covariance of everything that was fitted together

    @property
    def model(self) -> Refit | Corrected:
        """The model with the named effects or, where there are none, the refit."""
        return self.fitted if self.corrected is None else self.corrected

    @property
    def range_accuracy_pct(self) -> dict[str, float | None]:
        """Accuracy of the range that each arm estimates for held-out trips, per cent."""
        trip = self.trip
        return {
            arm: range_accuracy_pct(predicted, self.runs, trip)
            for arm, predicted in self.predictions.items()
        }

    @property
    def measured(self) -> tuple[FittedGroup, ...]:
        """The identifiable groups."""
        measured = []
        for estimate in self.estimates:
            if estimate.fitted is not None and estimate.ci95 is not None:
                group = estimate.group
                measured.append(
                    FittedGroup(
                        group.symbol, estimate.assumed, estimate.fitted, estimate.ci95, group.unit
                    )
                )
        return tuple(measured)

    @property
    def held(self) -> tuple[str, ...]:
        """Symbols of the groups held at the robot file's values."""
        model = self.plain if self.corrected is None else self.corrected
        fit = model.groups
        return tuple(
            group.symbol
            for group, is_held in zip(fit.parameters.groups, fit.held, strict=True)
            if is_held
        )

    @property
    def blocks(self) -> int:
        """Number of stretches that count as independent."""
        return int(self.block.max()) + 1

    @property
    def trip(self) -> Index:
        """What counts as one trip: a run or, of fewer than three runs, a stretch; shape
        (windows,)."""
        fold, kind = cut_folds(self.runs, self.block)
        return self.runs.run if kind == "run" else fold

    @property
    def contributions(self) -> tuple[Array, ...]:
        """Power or current that each named effect adds, in the order of the diagnosis, shape
        (windows,) each."""
        named = () if self.corrected is None else self.corrected.contribution
        shown_by_channels = [effect.contribution for effect in self.channel_effects]
        return (*named, *shown_by_channels)

    @property
    def residual(self) -> Array:
        """Residual of the model, shape (windows,)."""
        return self.runs.observed - self.model.predicted


@dataclass(frozen=True)
class Analysis:
    """A diagnosis with its evidence and the corrected robot."""

    diagnosis: Diagnosis
    robot: Robot
    corrected: Robot
    findings: tuple[Finding, ...]
    evidence: Evidence | None  # None where no run can be used

    def per_sample(self, name: str) -> Array:
        """Battery power that the corrected file predicts for the run of a path, W, shape
        (samples,), at its `time_s`.

        Raises:
            KeyError: No usable run has this name.
        """
        usable = () if self.evidence is None else self.evidence.runs.signals
        run_of_name = {run.name: run for run in usable}
        return power_w(run_of_name[name], self.corrected)
