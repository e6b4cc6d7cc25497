"""The equations of a model, to read: as text, LaTeX or SymPy."""

from typing import Any

from persid.errors import DataError
from persid.models.exports.libraries import to_equations
from persid.models.formulas import lines
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel


def equations(model: PersidskiiModel | OutputModel, form: str = "text", digits: int = 4) -> Any:
    """Return one equation a state, and one an output: "text" and "latex" as strings with rounded numbers.

    With "sympy" it is a list of exact sympy.Eq.

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
    field = (model.dynamics if isinstance(model, OutputModel) else model).field
    seen = model.equation if isinstance(model, OutputModel) else None
    if form == "sympy":
        return to_equations(field, seen)
    if form not in ("text", "latex"):
        raise DataError(f'form={form!r}; choose "text", "latex" or "sympy"')
    return "\n".join(lines(field, seen, form, digits))
