"""What is filled into pages."""

import pytest
from jinja2 import DictLoader, UndefinedError
from markupsafe import Markup

from homeward.layout.notation import page, templates


def test_control_characters_of_names_stay_out_of_a_page() -> None:
    environment = templates("homeward.layout")
    environment.loader = DictLoader(
        {"a.html": "<title>{{ name }}</title>{{ lines | typeset }}{{ script }}"}
    )
    shown = page(
        environment,
        "a.html",
        name="<b>x\x1b[31m\udcff",
        lines="c^2\nd\r",
        script=Markup("<p>\t</p>"),
    )
    assert shown == "<title>&lt;b&gt;x?[31m?</title>c²\nd?<p>\t</p>"


def test_an_undefined_name_is_not_taken_for_a_value() -> None:
    template = templates("homeward.layout").from_string("{{ evidence.mean is none }}")
    assert template.render(evidence={"mean": None}) == "True"
    with pytest.raises(UndefinedError):
        template.render(evidence={})
