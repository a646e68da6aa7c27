"""The verdict as data: the content of `diagnosis.json`, with a round trip through JSON."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

SCHEMA = 3
"""Version of the format of diagnosis.json. Version 3 adds the numbers of corrected.toml."""

READ = (2, 3)
"""Versions that are read: a file of another one is refused."""

Verdict = Literal[
    "no_mismatch", "parameters_off", "missing_physics", "unknown_physics", "not_testable"
]
VERDICTS = get_args(Verdict)
Combination = Literal["product", "ratio", "mean power"]
Side = Literal["at least", "at most"]
Followed = Literal["charge", "voltage", "load"]


@dataclass(frozen=True)
class RecordingInfo:
    """A recording that the verdict is based on."""

    path: str
    sha256: str
    duration_s: float
    samples: int


@dataclass(frozen=True)
class FittedGroup:
    """An identifiable group of parameters; `assumed` is None where the robot file has no value.

    `confused_with` holds effects that explain the recordings as well, with the value that was
    assumed.
    """

    group: str
    assumed: float | None
    fitted: float
    ci95: tuple[float, float]
    unit: str
    confused_with: tuple[str, ...] = ()


@dataclass(frozen=True)
class Value:
    """A fitted parameter of an effect.

    If it is limited from one side only, as at its bound, `limit` says from which: it is at least
    the lower end of `ci95`, whose other end is its bound, or at most the upper end.
    """

    value: float
    ci95: tuple[float, float] | None  # None where the recordings do not limit it
    unit: str
    limit: Side | None = None


def limit_end(value: Value | FileNumber) -> float:
    """The end of the interval by which a value is limited from one side; such a value has an
    interval."""
    assert value.ci95 is not None
    low, high = value.ci95
    return low if value.limit == "at least" else high


@dataclass(frozen=True)
class Product:
    """The identifiable combination of confounded numbers: their product or ratio, or the mean power
    that they make."""

    of: tuple[str, ...]
    value: Value
    together: Combination = "product"

    @property
    def name(self) -> str:
        """In words."""
        if self.together == "mean power":
            return f"mean power of {' and '.join(self.of)}"
        sign = " over " if self.together == "ratio" else " x "
        return sign.join(self.of)


@dataclass(frozen=True)
class Range:
    """Range on one charge of a robot that drives on as recorded, and d_max at its best speed on
    level ground."""

    recorded_m: float  # by the recorded energy per metre
    ci95: tuple[float, float]  # over runs
    nominal_m: float  # predicted by the robot file for these trips
    file_m: float  # predicted by corrected.toml
    d_max_nominal_m: float
    d_max_file_m: float


@dataclass(frozen=True)
class Gauge:
    """What the recorded state of charge is worth, in words in `says`.

    It follows the charge drawn, the recorded voltage or, as a map of a voltage that was not
    recorded does, the load.
    """

    follows: Followed
    says: str
    drawn_j: float  # in all runs, by the meter
    covered: float | None  # share of the charge over which a counter was read
    question: str | None = None  # what nothing that was recorded answers


@dataclass(frozen=True)
class Place:
    """One stretch of one recording under the located condition, as `where` of diagnosis.json has
    it."""

    recording: str
    start_s: float
    end_s: float
    condition: str
    share_of_excess: float


@dataclass(frozen=True)
class Proof:
    """Strength of the evidence for an effect."""

    # against the model without it; None where two readings are compared and no model is
    delta_bic: float | None
    held_out_gain: float | None  # share of the squared held-out error of the model without it
    p_value: float


@dataclass(frozen=True)
class Checked:
    """The value of one condition under which an effect is named, beside its limit."""

    condition: str
    value: float
    side: Literal["at least", "at most", "more than"]
    limit: float
    holds: bool


@dataclass(frozen=True)
class MissingPhysics:
    """An effect that the simulator lacks, where it acts, and the evidence for it.

    `confused_with` holds effects that explain the recordings as well; one that is named beside it
    does so at another size.
    """

    effect: str
    name: str
    sentence: str
    equation: str
    source: str
    parameters: dict[str, Value]
    where: tuple[Place, ...]
    evidence: Proof
    confused_with: tuple[str, ...]
    to_tell_apart: str
    # under which it is named; none of one that another channel than power shows
    conditions: tuple[Checked, ...] = ()


@dataclass(frozen=True)
class NotNamed:
    """An effect that was tried, and the conditions up to the first that it does not meet."""

    effect: str
    conditions: tuple[Checked, ...]


@dataclass(frozen=True)
class FileNumber:
    """A changed number of corrected.toml: proven to differ from the given file, or only fitted so
    that it predicts; `limit` as of a `Value`."""

    name: str
    value: float
    ci95: tuple[float, float] | None  # None where the recordings do not limit it
    unit: str
    proven: bool
    limit: Side | None = None


@dataclass(frozen=True)
class CorrectedFile:
    """Content of corrected.toml and why: named effects, fitted parameters, a fit made to predict,
    or the given file."""

    holds: Literal["corrected", "refit", "predictive", "nominal"]
    why: str
    numbers: tuple[FileNumber, ...] = ()


@dataclass(frozen=True)
class Arm:
    """Held-out errors of one model; `energy_error_pct` is None where only current was recorded.

    `energy_error_pct` is the mean over held-out trips of |predicted - recorded| trip energy over
    the recorded one.
    """

    rmse: float
    r2: float | None
    energy_error_pct: float | None
    rmse_ci95: tuple[float, float]


@dataclass(frozen=True)
class Fit:
    """Arms of the comparison, by name, and how they were held out."""

    unit: str
    held_out_by: Literal["run", "block"]
    folds: int
    arms: dict[str, Arm]


@dataclass(frozen=True)
class MadeBy:
    """What made the verdict beside the recordings; see `homeward.diagnosis.tell.made_by`."""

    version: str  # of homeward
    seed: int
    thresholds: dict[str, Any]  # by package and name, such as diagnosis.FALSE_ALARM_RATE
    # SHA-256 of the file of --effects, by its name
    own_effects: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on a robot file and its recordings; the fields are those of `diagnosis.json`."""

    robot: str
    recordings: tuple[RecordingInfo, ...]
    verdict: Verdict
    summary: str
    parameters: tuple[FittedGroup, ...] = ()
    # those whose interval excludes what the robot file assumes
    parameters_off: tuple[FittedGroup, ...] = ()
    missing_physics: tuple[MissingPhysics, ...] = ()
    not_named: tuple[NotNamed, ...] = ()
    # conditions that the effects met together, up to the first that they did not
    together: tuple[Checked, ...] = ()
    where: tuple[Place, ...] = ()
    fit: Fit | None = None
    what_this_log_can_show: dict[str, float | None] = field(default_factory=dict)
    products: tuple[Product, ...] = ()
    range: Range | None = None
    range_change_m: float | None = None
    file: CorrectedFile | None = None
    gauge: Gauge | None = None  # None without a state of charge that falls
    next_experiment: str | None = None
    made_by: MadeBy | None = None  # None in a file of before it was written
    schema: int = SCHEMA

    def to_json(self) -> str:
        """Text of diagnosis.json: valid JSON, with null for what the channels do not determine."""
        data = dataclasses.asdict(self)
        # Python writes NaN and infinity, which are no JSON.
        text = json.dumps({"schema": data.pop("schema"), **data})
        return json.dumps(json.loads(text, parse_constant=lambda nan: None), indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Diagnosis:
        """Read what `to_json` wrote.

        Raises:
            ValueError: The text is not a diagnosis of this schema.
        """
        try:
            data = json.loads(text)
            if data["schema"] not in READ or data["verdict"] not in VERDICTS:
                raise ValueError(
                    f"not a diagnosis of schema {SCHEMA}: {data['schema']!r}, {data['verdict']!r}"
                )
            diagnosis: Diagnosis = _read(cls, data)
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"not a diagnosis of schema {SCHEMA}: {error!r}") from error
        return diagnosis


def _read(kind: Any, data: Any) -> Any:
    """Data from JSON as the type that an annotation names: records, and tuples, mappings or options
    of them."""
    if dataclasses.is_dataclass(kind):
        kinds = get_type_hints(kind)
        fields = {name: _read(kinds[name], value) for name, value in data.items()}
        return kind(**fields)  # type: ignore[operator]
    container = get_origin(kind)
    arguments = get_args(kind)
    if container is UnionType:  # of a type and None
        return None if data is None else _read(arguments[0], data)
    if container is tuple:
        return tuple(_read(arguments[0], element) for element in data)
    if container is dict:
        return {name: _read(arguments[1], value) for name, value in data.items()}
    return data
