"""What is installed where."""

from pathlib import Path

from benchmarks.robustness.wheels import cases


def test_wheel_and_sdist_are_tried_with_each_python() -> None:
    tried = cases([Path("3.11"), Path("3.12")], Path("a.whl"), Path("a.tar.gz"))
    assert {(str(python), kind, package.suffix) for python, kind, package in tried} == {
        (python, kind, suffix) for python in ("3.11", "3.12") for kind, suffix in (("wheel", ".whl"), ("sdist", ".gz"))
    }
