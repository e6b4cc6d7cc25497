"""The examples in the docstrings of public names run, and there is one for every name but the plainest values."""

import doctest
import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import persid as ps
import persid_check
from places import ROOT

PLAIN = {"Bootstrap", "Obstruction", "NetworkCertificate", "from_pysindy"}  # what makes them is shown in a page
PUBLIC: dict[str, Any] = {
    f"{package.__name__}.{name}": getattr(package, name)
    for package in (ps, persid_check)
    for name in package.__all__
    if name not in PLAIN and (inspect.isclass(value := getattr(package, name)) or inspect.isfunction(value))
    if not (inspect.isclass(value) and issubclass(value, Exception))
}
INNER = {"canonical_model", "is_positive_definite"}  # for makers of certificates


@pytest.mark.parametrize("name", PUBLIC)
def test_examples_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example of a public name prints what it says, where `ps` and `np` are known and the examples are at hand."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names = {"ps": ps, "np": np, "persid_check": persid_check}
    text = inspect.getdoc(PUBLIC[name]) or ""
    test = doctest.DocTestParser().get_doctest(text, names, name, None, None)
    assert test.examples or name.split(".")[1] in INNER, f"{name} has no example"
    said: list[str] = []
    assert doctest.DocTestRunner().run(test, out=said.append).failed == 0, "".join(said)
