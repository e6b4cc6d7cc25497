"""Models from their files."""

import json
from collections.abc import Mapping
from pathlib import Path

from persid.errors import ModelError
from persid.models import outputs
from persid.models.model import PersidskiiModel


def load_model(path: str | Path) -> PersidskiiModel | outputs.OutputModel:
    """Read a model from `model.json`: a PersidskiiModel, or an OutputModel where the file holds one.

    Raises:
        ModelError: the file is not JSON, or not a model.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
        >>> model.save("saved.json")
        >>> ps.load_model("saved.json") == model
        True
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse_constant)
        of_outputs = isinstance(data, Mapping) and data.get("format") == outputs.FORMAT
        return (outputs.OutputModel if of_outputs else PersidskiiModel).from_dict(data, Path(path).parent)
    except (ModelError, json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ModelError(f"{path}: {error}") from None


def _refuse_constant(text: str) -> float:
    raise ModelError(f"{text} is not a number a model may hold")
