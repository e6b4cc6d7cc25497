"""Models from their files."""

import json
from collections.abc import Mapping
from pathlib import Path

from persid.errors import ModelError
from persid.models import outputs
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid_check.model import ALGEBRAIC


def load_model(path: str | Path) -> PersidskiiModel | outputs.OutputModel | DescriptorModel:
    """Read a model from `model.json`: a PersidskiiModel, or an OutputModel or a DescriptorModel where it holds one.

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
        return _kind(data).from_dict(data, Path(path).parent)
    except (ModelError, json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ModelError(f"{path}: {error}") from None


def _kind(data: object) -> type[PersidskiiModel] | type[outputs.OutputModel] | type[DescriptorModel]:
    """Return what an object holds."""
    if isinstance(data, Mapping) and data.get("format") == outputs.FORMAT:
        return outputs.OutputModel
    return DescriptorModel if isinstance(data, Mapping) and ALGEBRAIC in data else PersidskiiModel


def _refuse_constant(text: str) -> float:
    raise ModelError(f"{text} is not a number a model may hold")
