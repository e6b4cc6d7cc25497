"""Every test runs with the shapes in persid's signatures checked: jaxtyping's hook with beartype."""

from pathlib import Path

import pytest
from jaxtyping import install_import_hook

install_import_hook(["persid"], "beartype.beartype")

_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def measurements() -> Path:
    """The folder of real measurements beside the project; tests that need it skip where it is absent."""
    if not _DATA.is_dir():
        pytest.skip("the real measurements (../shared/data) are not on this machine")
    return _DATA
