"""Models of PySINDy as Persidskii models, where every term is a function of one state or a product of two."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement
from typing import Any

import numpy as np
from numpy import ndarray

from persid._libraries import library
from persid.errors import ModelError
from persid.models.model import PersidskiiModel
from persid.models.products import products

TOLERANCE = 1e-9  # relative; the same formula in another order of operations stays far below


@dataclass(frozen=True)
class _Feature:
    """One column of a library: an expression of one variable, a product of two, the constant, or (all None) neither."""

    expression: str | None = None
    variable: int | None = None
    constant: bool = False
    pair: tuple[int, int] | None = None


def from_pysindy(model: object, functions: Sequence[str] = ()) -> PersidskiiModel:
    """Return a fitted continuous-time `pysindy.SINDy` model as a PersidskiiModel with the same right side.

    Its library may be made of PolynomialLibrary, FourierLibrary, CustomLibrary, ConcatLibrary and GeneralizedLibrary.
    `functions` are the expressions of the custom functions, such as ["sinh(x)", "tanh(x)"], one each in their order:
    code cannot be read. Only terms with a nonzero coefficient count; each must be a constant, a function of one state,
    a product of two states, or an input itself. What is returned has been compared with `model.predict` on random
    states.

    Raises:
        ModelError: a term is none of these (it is named), or an expression is not the function in the library.
        ImportError: PySINDy is not installed.
    """
    pysindy = library("pysindy", "bench")
    if not isinstance(model, pysindy.SINDy):
        raise ModelError(f"a pysindy.SINDy model of continuous time is needed, not {type(model).__name__}")
    n = model.n_features_in_ - model.n_control_features_
    texts = iter(functions)
    features = list(_features(model.feature_library, list(range(model.n_features_in_)), texts))
    if (unused := len(list(texts))) > 0:
        raise ModelError(f"{unused} of {len(functions)} expressions belong to no custom function of the library")
    result = _assembled(model, features, n)
    _compare(model, result)
    return result


def _features(part: Any, variables: list[int], texts: Iterator[str]) -> Iterator[_Feature]:
    """Yield the columns of a library in their order; `variables` are the states and inputs that it sees."""
    lib = library("pysindy", "bench").feature_library
    if isinstance(part, lib.PolynomialLibrary):
        yield from (_monomial(powers, variables) for powers in part.powers_)
    elif isinstance(part, lib.FourierLibrary):
        names = [name for name, wanted in (("sin", part.include_sin), ("cos", part.include_cos)) if wanted]
        waves = [(k, j, name) for k in range(1, part.n_frequencies + 1) for j in variables for name in names]
        yield from (_Feature(f"{name}({k}*x)" if k > 1 else f"{name}(x)", j) for k, j, name in waves)
    elif isinstance(part, lib.CustomLibrary):
        yield from _custom(part, variables, texts)
    elif isinstance(part, lib.ConcatLibrary):
        for inner in part.libraries:
            yield from _features(inner, variables, texts)
    elif isinstance(part, lib.GeneralizedLibrary):
        for i, inner in enumerate(part.libraries_full_):
            whole = i >= len(part.inputs_per_library)
            seen = variables if whole else [variables[j] for j in dict.fromkeys(part.inputs_per_library[i])]
            yield from () if i in part.exclude_libraries else _features(inner, seen, texts)
    else:  # refused below where such a term is used
        yield from (_Feature() for _ in range(part.n_output_features_))


def _monomial(powers: ndarray, variables: list[int]) -> _Feature:
    used = np.flatnonzero(powers)
    if len(used) == 2 and powers.sum() == 2:
        return _Feature(pair=(variables[used[0]], variables[used[1]]))
    if len(used) != 1:
        return _Feature(constant=len(used) == 0)
    power = int(powers[used[0]])
    return _Feature("x" if power == 1 else f"x**{power}", variables[used[0]])


def _custom(part: Any, variables: list[int], texts: Iterator[str]) -> Iterator[_Feature]:
    if part.include_bias:
        yield _Feature(constant=True)
    choose = combinations if part.interaction_only else combinations_with_replacement
    for i, f in enumerate(part.functions):
        if f.__code__.co_argcount > 1:
            yield from (_Feature() for _ in choose(variables, f.__code__.co_argcount))
            continue
        text = next(texts, None)
        if text is None:
            name = part.function_names[i]("x")
            raise ModelError(f"the custom function {name} has no expression; give one for each with functions=[...]")
        yield from (_Feature(text, j) for j in variables)


def _assembled(model: Any, features: list[_Feature], n: int) -> PersidskiiModel:
    """Sort the columns of the coefficients into A0, the terms, B and b."""
    coefficients, names = np.array(model.coefficients(), float), model.get_feature_names()
    m = model.n_control_features_
    A: dict[str, ndarray] = {}
    pairs: dict[tuple[int, int], ndarray] = {}
    B, b = np.zeros((n, m)), np.zeros(n)
    for column, feature, name in zip(coefficients.T, features, names, strict=True):
        if not column.any():
            continue
        if feature.constant:
            b += column
        elif feature.pair is not None and max(feature.pair) < n:
            pairs[feature.pair] = pairs.get(feature.pair, np.zeros(n)) + column
        elif feature.variable is None or feature.expression is None:
            raise ModelError(
                f"the term {name!r} is no function of a single state, nor a product of two states; leave it out of "
                "PySINDy's library"
            )
        elif feature.variable < n:
            A.setdefault(feature.expression, np.zeros((n, n)))[:, feature.variable] += column
        elif feature.expression == "x":
            B[:, feature.variable - n] += column
        else:
            raise ModelError(f"the term {name!r} is not linear in the input; leave it out of PySINDy's library")
    A0 = A.pop("x", np.zeros((n, n)))
    states, inputs = model.feature_names[:n], model.feature_names[n:]
    terms = [*((f, None, M) for f, M in A.items()), *([products(pairs)] if pairs else [])]
    return PersidskiiModel(A0, terms, B, b, states=states, inputs=inputs)


def _compare(model: Any, result: PersidskiiModel) -> None:
    """Compare both right sides at random points within 1 of the origin, where both are finite."""
    rng = np.random.default_rng(0)
    x, u = rng.uniform(-1, 1, (64, result.n)), rng.uniform(-1, 1, (64, result.m))
    with np.errstate(all="ignore"):
        given = np.asarray(model.predict(x, u if result.m else None))
        found = result.rhs(x, u)
    error = np.abs(given - found)
    if (error > TOLERANCE * (1 + np.abs(given))).any() or (np.isnan(given) != np.isnan(found)).any():
        worst = float(np.nanmax(error))
        raise ModelError(
            f"the right sides differ by up to {worst:.3g} near the origin: are the expressions in `functions` "
            "the custom functions of the library, in their order?"
        )
