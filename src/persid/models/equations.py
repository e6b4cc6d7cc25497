"""The equations of a model, to read: as text, LaTeX or SymPy."""

from typing import Any

from persid.errors import DataError
from persid.models.descriptor import DescriptorModel
from persid.models.exports.libraries import to_equations
from persid.models.formulas import lines
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel


def equations(model: PersidskiiModel | OutputModel | DescriptorModel, form: str = "text", digits: int = 4) -> Any:
    """Return one equation a state, and one an output: "text" and "latex" as strings with rounded numbers.

    With "sympy" it is a list of exact sympy.Eq. A model with algebraic variables has text alone.

    Raises:
        DataError: an unknown form.
        ModelError: a sparse model is too large to be written out.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
        >>> print(ps.equations(model))
        d(x1)/dt = -1 x1 - 1 x1**3 + 1 u1
        >>> print(ps.equations(ps.PersidskiiModel(A0=[[0.5]], B=[[1.0]], time="discrete", dt=0.1)))
        x1[k+1] = 0.5 x1 + 1 u1
    """
    if isinstance(model, DescriptorModel):
        return _of_descriptor(model, form, digits)
    field = (model.dynamics if isinstance(model, OutputModel) else model).field
    seen = model.equation if isinstance(model, OutputModel) else None
    if form == "sympy":
        return to_equations(field, seen)
    if form not in ("text", "latex"):
        raise DataError(f'form={form!r}; choose "text", "latex" or "sympy"')
    return "\n".join(lines(field, seen, form, digits))


def _of_descriptor(model: DescriptorModel, form: str, digits: int) -> str:
    if form != "text":
        raise DataError(f'form={form!r}; of a model with algebraic variables choose "text"')
    rows = list(lines(model.rows.field, None, form, digits))
    return "\n".join([*rows[: model.n], *(f"0 = {row.partition(' = ')[2]}" for row in rows[model.n :])])
