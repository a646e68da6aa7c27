"""Losses inside the battery by the state of charge: it falls faster at some loads or temperatures
than at others."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.optimize import minimize_scalar

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import CATALOGUE, battery
from homeward.diagnosis.explain.channel_effects.inside import inside_w, matters
from homeward.diagnosis.explain.channel_effects.reading import Reading, least_squares
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect, values_of
from homeward.diagnosis.explain.hypothesis import SMALL_STEP, TINY, Hypothesis, Numbers, Setting
from homeward.diagnosis.fit.estimates import standard_errors
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Proof, Value
from homeward.logs.channels import Array
from homeward.physics import Robot
from homeward.physics.terminal_power import lost_inside

# upper end of the search, over the linear estimate; chosen: room for one that bends
_SEARCHED = 3.0


@dataclass(frozen=True)
class Losses:
    """Losses that may make the charge of a battery fall faster than by the energy drawn."""

    fit: Refit
    runs: Runs
    channel: Reading
    drawn: Array  # fall of the charge by the energy drawn, (known windows, 1)
    sag: ChannelEffect | None  # that the voltage shows

    @property
    def robot(self) -> Robot:
        """The robot as its file has it."""
        return self.fit.parameters.nominal

    @cached_property
    def in_file_w(self) -> Array:
        """What the effects of the robot file lose inside, W, shape (windows,)."""
        return inside_w(self.robot, self.runs)

    @cached_property
    def forms(self) -> "list[_Loss]":
        """Every loss that the runs can show, in each of its forms."""
        setting = Setting.of(self.fit, self.runs)
        losses = []
        for hypothesis in CATALOGUE.values():
            if (
                not lost_inside(hypothesis.entry)
                or hypothesis.steady is None
                or hypothesis.missing(self.runs)
            ):
                continue
            size_in_file, numbers_in_file = hypothesis.in_file(self.robot)
            is_sag = self.sag is not None and hypothesis is self.sag.hypothesis
            if is_sag or hypothesis.entry.switch.high - size_in_file <= TINY:
                continue
            shapes = [numbers_in_file] if size_in_file else hypothesis.shapes(setting)
            losses += [_Loss(self, hypothesis, shape) for shape in shapes]
        return losses

    def proven(self, rng: Generator) -> ChannelEffect | None:
        """The loss that explains most beside a capacity, if one is proven."""
        searched = [loss.per_size for loss in self.forms]
        proven: list[_ProvenLoss] = []
        for loss in self.forms:
            proof = self.channel.proof(self.drawn, loss.per_size, rng, searched)
            if proof is not None:
                proven.append(_ProvenLoss(loss, proof))
        if not proven:
            return None
        likeliest = max(proven, key=lambda candidate: candidate.gained)
        loss = likeliest.loss
        size, half_width = loss.size_beside_capacity()
        lost_w = loss.lost_w(size)
        if not matters(lost_w, self.runs):
            return None
        return ChannelEffect(
            hypothesis=loss.hypothesis,
            parameters=loss.values(size, half_width),
            contribution=lost_w,
            proof=likeliest.proof,
            rivals=_rivals(likeliest, proven),
            sentence="The state of charge falls faster than the energy drawn implies where it is at work.",
        )

    def instead(self, rate: float) -> tuple[str, ...]:
        """Losses that explain a charge which falls `rate` times as fast as the file's capacity
        implies, as well as a smaller capacity does; a voltage that was recorded would have shown a
        resistance."""
        by_capacity = self.channel.target - rate * self.drawn[:, 0]
        limit = thresholds.NO_WORSE * float(by_capacity @ by_capacity)
        unexplained = self.channel.target - self.drawn[:, 0]
        voltage_v = self.runs.context.get("voltage_v", np.zeros(1))
        has_voltage = bool((voltage_v > 0.0).any())

        def residual(fallen: Array) -> Array:
            return np.asarray(unexplained - fallen[:, 0])

        explaining = []
        for loss in self.forms:
            linear_size = float(least_squares(loss.per_size, unexplained)[0])
            is_resistance = loss.hypothesis.id == battery.INTERNAL_RESISTANCE.id
            if linear_size <= 0.0 or (has_voltage and is_resistance):
                continue
            size = loss.closest_size(linear_size, residual)
            if float(np.sum(residual(loss.fallen(size)) ** 2)) <= limit:
                explaining.append(loss.hypothesis.id)
        return tuple(dict.fromkeys(explaining))

    def residual_beside_capacity(self, fallen: Array) -> Array:
        """Residual of the charge with a loss, its capacity fitted: at most that of the file, as a
        larger one together with a larger loss fits a loss of any form."""
        design = self.drawn + fallen
        rate = np.maximum(least_squares(design, self.channel.target), 1.0)
        return np.asarray(self.channel.target - design @ rate)


@dataclass(frozen=True)
class _Loss:
    """One loss in one form; its size counts beyond the robot file's."""

    among: Losses
    hypothesis: Hypothesis
    shape: Numbers

    @cached_property
    def per_size(self) -> Array:
        """Fall of the charge by a small loss, per unit of its size, shape (known windows, 1)."""
        return self.fallen(TINY) / TINY

    @property
    def largest_size(self) -> float:
        """Largest size beyond the robot file's."""
        return self.hypothesis.entry.switch.high - self.hypothesis.in_file(self.among.robot)[0]

    def fallen(self, size: float) -> Array:
        """Fall of the charge by the loss, shape (known windows, 1)."""
        among = self.among
        return among.channel.summed(self.lost_w(size) / among.robot.usable_energy_j)[:, None]

    def lost_w(self, size: float) -> Array:
        """What is lost that is larger by this size than the robot file's, W, shape (windows,)."""
        robot = self.among.robot
        size_in_file = self.hypothesis.in_file(robot)[0]
        numbers = {**self.shape, self.hypothesis.entry.switch.name: size_in_file + size}
        larger = dataclasses.replace(robot, effects={**robot.effects, self.hypothesis.id: numbers})
        return inside_w(larger, self.among.runs) - self.among.in_file_w

    def closest_size(self, linear_size: float, residual: Callable[[Array], Array]) -> float:
        """Size with the least squared residual: searched up to a multiple of the linear estimate,
        as sizes are often far below their bound."""
        up_to = float(np.clip(_SEARCHED * linear_size, TINY * self.largest_size, self.largest_size))

        def squared_error(size: float) -> float:
            return float(np.sum(residual(self.fallen(size)) ** 2))

        return float(minimize_scalar(squared_error, bounds=(0.0, up_to), method="bounded").x)

    def size_beside_capacity(self) -> tuple[float, float]:
        """Size fitted together with the capacity, and half the width of its 95 % interval."""
        among = self.among
        rate, per_size = least_squares(
            np.column_stack([among.drawn, self.per_size]), among.channel.target
        )
        linear_size = per_size / max(float(rate), 1e-9)
        size = self.closest_size(linear_size, among.residual_beside_capacity)
        step = SMALL_STEP * max(size, TINY)
        if (1.0 + SMALL_STEP) * size > self.largest_size:  # at the bound, the derivative from below
            step = -step
        fallen = self.fallen(size)
        derivative = (self.fallen(size + step) - fallen) / step
        design = np.column_stack([among.drawn + fallen, derivative])
        errors = standard_errors(
            design, among.residual_beside_capacity(fallen), among.channel.block
        )
        return size, thresholds.NORMAL_95 * float(errors[-1])

    def values(self, size: float, half_width: float) -> dict[str, Value]:
        """The parameters of the effect, with what the robot file has of it."""
        total = self.hypothesis.in_file(self.among.robot)[0] + size
        return values_of(
            self.hypothesis, total, (max(total - half_width, 0.0), total + half_width), self.shape
        )


class _ProvenLoss(NamedTuple):
    loss: _Loss
    proof: Proof

    @property
    def gained(self) -> float:
        """Share of the held-out squared error of the charge that it explains."""
        return self.proof.held_out_gain or 0.0


def _rivals(likeliest: _ProvenLoss, proven: Sequence[_ProvenLoss]) -> tuple[str, ...]:
    """Other proven losses that explain half as much as the likeliest."""
    rivals = []
    for candidate in proven:
        effect = candidate.loss.hypothesis.id
        is_other = effect != likeliest.loss.hypothesis.id
        if is_other and candidate.gained > thresholds.HALF * likeliest.gained:
            rivals.append(effect)
    return tuple(dict.fromkeys(rivals))
