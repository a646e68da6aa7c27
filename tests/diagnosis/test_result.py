"""The verdict survives a trip through JSON, and JSON never holds what JSON does not know."""

import dataclasses
import json
import math
from typing import Any

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward.diagnosis import Diagnosis, RecordingError, diagnose
from homeward.diagnosis.result import (
    VERDICTS,
    Arm,
    Combination,
    CorrectedFile,
    FileNumber,
    Fit,
    FittedGroup,
    MadeBy,
    MissingPhysics,
    Place,
    Product,
    Proof,
    Range,
    RecordingInfo,
    Value,
)

number = st.floats(-1e9, 1e9)
text = st.text(max_size=20)
pair = st.tuples(number, number)
optional = st.none() | number
place = st.builds(Place, text, number, number, text, st.floats(0, 1))
missing = st.builds(
    MissingPhysics, text, text, text, text, text,
    parameters=st.dictionaries(text, st.builds(Value, number, pair, text), max_size=2),
    where=st.lists(place, max_size=2).map(tuple),
    evidence=st.builds(Proof, optional, optional, optional),
    confused_with=st.lists(text, max_size=2).map(tuple),
    to_tell_apart=text,
)  # fmt: skip
fit = st.builds(
    Fit, st.sampled_from(["W", "A"]), st.sampled_from(["run", "block"]), st.integers(1, 10),
    st.dictionaries(st.sampled_from(["nominal", "refit"]), st.builds(Arm, number, optional, optional, pair)),
)  # fmt: skip
diagnosis = st.builds(
    Diagnosis,
    robot=text,
    recordings=st.lists(
        st.builds(RecordingInfo, text, text, number, st.integers(0, 9)), max_size=2
    ).map(tuple),
    verdict=st.sampled_from(VERDICTS),
    summary=text,
    parameters=st.lists(st.builds(FittedGroup, text, optional, number, pair, text), max_size=2).map(
        tuple
    ),
    parameters_off=st.lists(
        st.builds(FittedGroup, text, number, number, pair, text), max_size=2
    ).map(tuple),
    missing_physics=st.lists(missing, max_size=2).map(tuple),
    where=st.lists(place, max_size=2).map(tuple),
    fit=st.none() | fit,
    what_this_log_can_show=st.dictionaries(text, st.none() | st.floats(0, 1), max_size=2),
    products=st.lists(
        st.builds(
            Product,
            st.lists(text, max_size=2).map(tuple),
            st.builds(Value, number, pair, text),
            st.just("ratio"),
        ),
        max_size=2,
    ).map(tuple),
    range=st.none() | st.builds(Range, number, pair, number, number, number, number),
    range_change_m=optional,
    file=st.none()
    | st.builds(
        CorrectedFile,
        st.sampled_from(["corrected", "refit", "predictive", "nominal"]),
        text,
        st.lists(st.builds(FileNumber, text, number, pair, text, st.booleans()), max_size=2).map(
            tuple
        ),
    ),
    next_experiment=st.none() | text,
    made_by=st.none()
    | st.builds(MadeBy, text, st.integers(), st.dictionaries(text, number | st.lists(number))),
    schema=st.sampled_from([2, 3]),
)


@given(diagnosis)
def test_round_trip(one: Diagnosis) -> None:
    assert Diagnosis.from_json(one.to_json()) == one


def test_keys_are_those_of_the_format() -> None:
    keys = set(json.loads(Diagnosis("husky", (), "not_testable", "no").to_json()))
    assert keys == {
        "schema", "robot", "recordings", "verdict", "summary", "parameters", "parameters_off", "missing_physics",
        "not_named", "together", "where", "fit", "what_this_log_can_show", "products", "range", "range_change_m",
        "file", "gauge", "next_experiment", "made_by",
    }  # fmt: skip


def test_a_file_of_before_what_made_it_was_written_is_read() -> None:
    data = json.loads(Diagnosis("husky", (), "no_mismatch", "").to_json())
    del data["made_by"]
    assert Diagnosis.from_json(json.dumps(data)) == Diagnosis("husky", (), "no_mismatch", "")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_becomes_null(value: float) -> None:
    one = Diagnosis("husky", (), "no_mismatch", "", range_change_m=value)
    assert json.loads(one.to_json())["range_change_m"] is None
    assert Diagnosis.from_json(one.to_json()) == dataclasses.replace(one, range_change_m=None)


@pytest.mark.parametrize(
    "spoiled", ["", "[]", "{}", '{"schema": 1, "verdict": "no_mismatch"}', "null"]
)
def test_foreign_json_is_refused(spoiled: str) -> None:
    with pytest.raises(ValueError):
        Diagnosis.from_json(spoiled)


def test_a_table_is_no_recording() -> None:
    table: Any = pd.DataFrame({"time_s": [0.0]})
    with pytest.raises(
        RecordingError,
        match="a recording is a path or what read_recording returns, not a DataFrame",
    ):
        diagnose(table, "husky")


@pytest.mark.parametrize(
    ("together", "name"),
    [("product", "a x b"), ("ratio", "a over b"), ("mean power", "mean power of a and b")],
)
def test_what_is_identifiable_together_says_how(together: Combination, name: str) -> None:
    assert Product(("a", "b"), Value(1.0, (0.5, 1.5), "W"), together).name == name
