"""The parts of a model as a caller or a file gives them: read into arrays, names and terms, or refused."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy import ndarray

from persid._files import Json
from persid.errors import ModelError
from persid.models.channels import Term
from persid.models.functions import ScalarFunction, scalar_function
from persid.models.sparse import compressed, is_sparse, refuse_shape
from persid_check.plain import numbers


def dimension(A0: object, terms: Sequence[object], B: object) -> int:
    """Return the number of states, from the first matrix that tells it."""
    for candidate in (A0, B, *(t.A if isinstance(t, Term) else _part(t, "A", 2) for t in terms)):
        if candidate is not None and len(shape := _shape(candidate)) == 2:
            return shape[0]
    raise ModelError("the number of states is unknown: give A0, B or a term")


def _shape(candidate: Any) -> tuple[int, ...]:
    try:
        return tuple(int(k) for k in np.shape(candidate))
    except ValueError:  # rows of different lengths: `finite_array` names the matrix
        return ()


def matrices_of(term: object) -> tuple[object, object]:
    """Return A and R of a term in any form."""
    return (term.A, term.R) if isinstance(term, Term) else (_part(term, "A", 2), _part(term, "R", 1))


def _part(term: Any, key: str, place: int) -> Any:
    return term.get(key) if isinstance(term, Mapping) else term[place]


def term_of(index: int, term: object, n: int) -> Term:
    """Return a term given as one, as (f, R, A) or as an object with these fields."""
    if isinstance(term, Term):
        term = (list(term.f), term.R, term.A)
    if isinstance(term, Mapping) and set(term) - {"f", "R", "A"}:
        raise ModelError(f"terms[{index}] has an unknown field; known: f, R, A")
    f, R, A = (_part(term, key, place) for place, key in enumerate("fRA"))
    R = None if R is None else matrix_of(f"terms[{index}].R", R, (None, n))
    k = n if R is None else R.shape[0]
    names = [f] * k if isinstance(f, str | ScalarFunction) else list(f)
    known = {name: name if isinstance(name, ScalarFunction) else scalar_function(name) for name in dict.fromkeys(names)}
    if len(names) != k:
        raise ModelError(f"terms[{index}].f has {len(names)} functions; needed is one, or one per row of R ({k})")
    return Term(tuple(known[name] for name in names), R, matrix_of(f"terms[{index}].A", A, (n, k)))


def matrix_of(name: str, value: object, shape: tuple[int | None, ...]) -> Any:
    """Return a matrix of a shape (None: any size), sparse as it was given, or say what is needed."""
    return compressed(name, value, shape) if is_sparse(value) else finite_array(name, value, shape)


def finite_array(name: str, value: object, shape: tuple[int | None, ...]) -> ndarray:
    """Return finite numbers of a shape (None: any size), read only, or say what is needed."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ModelError(f"{name} is not an array of numbers") from None
    refuse_shape(name, array.shape, shape)
    if not np.isfinite(array).all():
        raise ModelError(f"{name} holds a number that is not finite")
    array.setflags(write=False)
    return array


def sampled_input(t: ndarray, u: object, m: int) -> Callable[[float], object] | ndarray | None:
    """Return the input of a simulation at the times t (s): (N, m) samples, a function, or None; or say what is wrong.

    Raises:
        ModelError: the times do not increase, or samples have another shape.
    """
    if t.ndim != 1 or len(t) < 2 or not (np.diff(t) > 0).all():
        raise ModelError("t needs at least two strictly increasing times in s")
    if u is None or callable(u):
        return u
    samples = np.asarray(u, float)
    return finite_array("u", samples[:, None] if samples.ndim == 1 and m == 1 else samples, (len(t), m))


def clock(time: object, dt: object, sparse: bool) -> float | None:
    """Return the step in s of a model in discrete time, None in continuous time, or say what is needed."""
    if time not in ("continuous", "discrete"):
        raise ModelError(f'time is {time!r}; choose "continuous" or "discrete"')
    if time == "continuous":
        if dt is not None:
            raise ModelError(f'dt = {dt!r} is the step of a model in discrete time; give time="discrete", or no dt')
        return None
    if sparse:
        raise ModelError("a model in discrete time has no sparse matrices; give them filled in")
    if isinstance(dt, bool) or not isinstance(dt, int | float) or not 0 < dt < np.inf:
        raise ModelError(f"dt is {dt!r}; a model in discrete time needs the length of its step in s, above 0")
    return float(dt)


def distinct_names(what: str, given: Sequence[str], count: int) -> tuple[str, ...]:
    """Return so many different names, or say what is needed."""
    if len(given) != count or len(set(given)) != count or not all(isinstance(name, str) for name in given):
        raise ModelError(f"{what} needs {count} different names, not {list(given)}")
    return tuple(given)


def unknown_fields(data: Mapping[str, object], known: Sequence[str], needed: set[str]) -> None:
    """Refuse an object with a field that is not known, or without one that is needed."""
    unknown, missing = set(data) - set(known), needed - set(data)
    if unknown:
        raise ModelError(f"unknown field {sorted(unknown)[0]!r}; known: {', '.join(known)}")
    if missing:
        raise ModelError(f"the field {sorted(missing)[0]!r} is missing")


def check_kinds(data: Mapping[str, object]) -> None:
    """Refuse names that are no list of texts, terms that are no objects, and functions that are no texts."""
    for name in ("states", "inputs"):
        given = data.get(name)
        if not (_are_texts(given) or (given is None and name == "inputs")):
            raise ModelError(f"{name} is {str(data.get(name))[:60]}; needed is a list of names")
    if not isinstance(data["terms"], list | tuple):
        raise ModelError("terms is no list of objects with f, R and A")
    for i, term in enumerate(data["terms"]):
        if not isinstance(term, Mapping) or {"f", "A"} - set(term):
            raise ModelError(f"terms[{i}] is no object with f, R and A")
        if not (isinstance(term["f"], str) or _are_texts(term["f"])):
            raise ModelError(f"terms[{i}].f is no expression, and no list of them")
    if not isinstance(data.get("provenance"), Mapping | None):
        raise ModelError("provenance is no object")


def _are_texts(value: object) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(entry, str) for entry in value)


def plain_model(form: Json) -> Json:
    """Return the object of `model.json` from the canonical form: hexadecimal floats become numbers again."""
    data = dict(form)
    for name in ("x_ref", "u_ref", "A0", "B", "b", "domain"):
        data[name] = _numbers(data[name])
    data["terms"] = [{"f": t["f"], "R": _numbers(t["R"]), "A": _numbers(t["A"])} for t in data["terms"]]
    if "dt" in data:
        data["dt"] = _numbers(data["dt"])
    return data


def _numbers(entry: object) -> object:
    if isinstance(entry, list):
        return numbers(entry) if set(map(type, entry)) == {str} else [_numbers(part) for part in entry]
    return float.fromhex(entry) if isinstance(entry, str) else entry
