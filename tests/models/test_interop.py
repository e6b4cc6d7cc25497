"""The neighbours' tools: each gets a model that means the same, and SINDy models come in where they can."""

import sys
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

import persid as ps
from persid.errors import DataError, ModelError

WORDS = (
    "sqrt(1 + x**2) - 1", "abs(x)", "exp(x) - 1", "log1p(x**2)", "expm1(x)", "sin(x)", "cos(2*x)", "tan(x/4)",
    "sinh(x)", "cosh(x)", "tanh(x)", "arcsinh(x)", "arctan(x)", "erf(x)", "softsign(x)", "softplus(x)", "relu(x)",
    "deadzone(2*x)", "sat(2*x)", "-x**3/(1 + x**2)", "x + (1 + x**2)**-1.5", "x**6 - 0.1",
    "pwl(x; -0.9: -1, -0.3: 0.25, 0.7: 0.5, 1.1: -2)",
)  # fmt: skip
X, U = np.array([0.3, -1.2, 0.7]), np.array([1.0, 2.0])


@pytest.fixture(scope="module")
def everything() -> ps.PersidskiiModel:
    """A model with every word of the grammar, rows, mixed terms, a linear term and references."""
    rng = np.random.default_rng(0)
    rows = [(f, rng.normal(size=(2, 3)), rng.normal(size=(3, 2))) for f in WORDS]
    mixed = (["x**3", "tanh(x)", "x"], None, rng.normal(size=(3, 3)))
    B = rng.normal(size=(3, 2))
    return ps.PersidskiiModel(
        rng.normal(size=(3, 3)), [*rows, mixed], B, [0.1, 0.2, 0.3], [0.5, 0, 1], [0.1, 0.2], states=["p", "q", "r"]
    )


@pytest.fixture(scope="module")
def duffing() -> ps.PersidskiiModel:
    """A damped, forced Duffing oscillator."""
    return ps.PersidskiiModel([[0, 1], [-1, -0.4]], [("x**3", None, [[0, 0], [-0.5, 0]])], [[0], [1]], inputs=["force"])


def test_callables_are_the_right_side(everything):
    """The prepared function gives x' with an input and with none."""
    rhs = everything.to_callable()
    assert np.allclose(rhs(0.0, X, U), everything.rhs(X, U), rtol=1e-13)
    assert np.allclose(rhs(0.0, X), everything.rhs(X), rtol=1e-13)


@pytest.mark.long
def test_compiled_callables_are_the_right_side(everything):
    """Numba's function gives x' with an input and with none, with every word of the grammar."""
    pytest.importorskip("numba")
    rhs = everything.to_callable(jit=True)
    assert np.allclose(rhs(0.0, X, U), everything.rhs(X, U), rtol=1e-13)
    assert np.allclose(rhs(0.0, X), everything.rhs(X), rtol=1e-13)


def test_compiled_callables_divide_as_numpy_does():
    """1/0 is infinite in compiled code too, and no exception in the middle of an integration."""
    pytest.importorskip("numba")
    model = ps.PersidskiiModel([[0.0]], [("x/abs(x - 1)", None, [[1.0]])])
    assert model.to_callable(jit=True)(0.0, np.ones(1)) == np.inf


def test_callables_serve_scipy(duffing):
    """SciPy's solver with the compiled function follows our own simulation."""
    pytest.importorskip("numba")
    from scipy.integrate import solve_ivp

    t = np.linspace(0, 5, 11)
    ours = duffing.simulate([1.0, 0.0], t, np.ones(11))[0].x
    for jit in (False, True):
        rhs = duffing.to_callable(jit=jit)
        found = solve_ivp(rhs, (0, 5), [1.0, 0.0], t_eval=t, args=(np.ones(1),), rtol=1e-9, atol=1e-11)
        assert np.allclose(found.y.T, ours, atol=1e-6)


def test_python_control_simulates_the_same(duffing):
    """python-control's response equals our simulation, and knows the names."""
    control = pytest.importorskip("control")
    system = duffing.to_control("duffing")
    assert (system.name, system.state_labels, system.input_labels) == ("duffing", ["x1", "x2"], ["force"])
    assert system.output_labels == ["x1", "x2"]
    t = np.linspace(0, 8, 81)
    response = control.input_output_response(
        system, t, np.sin(t), [1.0, 0.0], solve_ivp_kwargs={"rtol": 1e-9, "atol": 1e-11}
    )
    # python-control joins samples of the input by lines: so is the function that we simulate with
    ours = duffing.simulate([1.0, 0.0], t, lambda s: [np.interp(s, t, np.sin(t))])
    assert np.allclose(response.states.T, ours[0].x, atol=1e-6)


def test_python_control_linearises_to_the_jacobian(duffing):
    """The linearisation at a state has our Jacobian and B."""
    pytest.importorskip("control")
    linear = duffing.to_control().linearize([0.5, 0.1], [0.0])
    assert np.allclose(linear.A, duffing.jacobian(np.array([0.5, 0.1])), atol=1e-5)
    assert np.allclose(linear.B, duffing.B, atol=1e-5)


def test_python_control_takes_models_without_inputs():
    """A model without inputs has none in python-control either."""
    pytest.importorskip("control")
    system = ps.PersidskiiModel([[-1.0]]).to_control()
    assert (system.ninputs, system.nstates) == (0, 1)


@pytest.mark.parametrize("exact", [False, True])
def test_sympy_has_the_same_values(everything, exact):
    """SymPy's right side agrees at a point, with floats and with exact rationals."""
    sympy = pytest.importorskip("sympy")
    point = dict(zip(map(sympy.Symbol, [*everything.states, *everything.inputs]), [*X, *U], strict=True))
    found = everything.to_sympy(exact).subs(point)
    assert found.shape == (3, 1)
    assert np.allclose(np.array(found, dtype=float).ravel(), everything.rhs(X, U), rtol=1e-12)


def test_sympy_can_be_exact():
    """With exact=True a coefficient is the rational number that its binary64 is."""
    sympy = pytest.importorskip("sympy")
    model = ps.PersidskiiModel([[-0.1]], [("x**3", None, [[-0.5]])])
    x = sympy.Symbol("x1")
    assert model.to_sympy(exact=True)[0] == -sympy.Rational(*(0.1).as_integer_ratio()) * x - x**3 / 2
    assert float(model.to_sympy()[0].coeff(x)) == -0.1


def test_latex_is_one_aligned_block(duffing):
    """Every state has its line with a mark for alignment."""
    lines = duffing.to_latex(digits=3).splitlines()
    assert (lines[0], lines[-1]) == (r"\begin{aligned}", r"\end{aligned}")
    assert [line.count("&=") for line in lines[1:-1]] == [1, 1]
    assert "0.5" in lines[2]


def test_casadi_has_the_same_values_and_derivatives(everything):
    """CasADi's function and its Jacobian agree with ours, with every word of the grammar."""
    casadi = pytest.importorskip("casadi")
    rhs = everything.to_casadi("f")
    assert (rhs.name(), rhs.name_in(), rhs.name_out()) == ("f", ["x", "u"], ["x_dot"])
    assert np.allclose(np.array(rhs(X, U)).ravel(), everything.rhs(X, U), rtol=1e-12)
    x, u = casadi.SX.sym("x", 3), casadi.SX.sym("u", 2)
    jacobian = casadi.Function("J", [x, u], [casadi.jacobian(rhs(x, u), x)])
    assert np.allclose(np.array(jacobian(X, U)), everything.jacobian(X), rtol=1e-10)


def test_casadi_takes_models_without_inputs():
    """A model without inputs and terms is a function of x with an empty u."""
    pytest.importorskip("casadi")
    assert float(ps.PersidskiiModel([[-2.0]]).to_casadi()(3.0, [])) == -6.0


EXTRAS = {"control": "to_control", "sympy": "to_sympy", "casadi": "to_casadi", "numba": "to_callable"}


@pytest.mark.parametrize("name", EXTRAS)
def test_an_absent_library_names_its_extra(duffing, monkeypatch, name):
    """Without a library the error says what to install."""
    monkeypatch.setitem(sys.modules, name, None)
    arguments = {"jit": True} if name == "numba" else {}
    with pytest.raises(ImportError, match=rf'{name} is not installed; try: pip install "persid\[interop\]"'):
        getattr(duffing, EXTRAS[name])(**arguments)


def runs(*, inputs: int = 0) -> tuple[list, list, list]:
    """Return states, derivatives and inputs of noise-free samples of a system of single-state terms."""
    rng = np.random.default_rng(3)
    x, u = rng.uniform(-1, 1, (400, 2)), rng.uniform(-1, 1, (400, inputs))
    dot = np.stack([0.5 - x[:, 0] + 2 * x[:, 1], -np.sin(x[:, 0]) - 3 * x[:, 1] ** 3], axis=1)
    return x, dot + u @ np.ones((inputs, 2)), u


def fitted(feature_library, x, dot, u=None):
    pysindy = pytest.importorskip("pysindy")
    sindy = pysindy.SINDy(feature_library=feature_library, optimizer=pysindy.STLSQ(threshold=0.1, alpha=1e-12))
    return sindy.fit(x, t=0.1, x_dot=dot, u=u if u is not None and u.size else None)


def libraries():
    """Libraries of PySINDy that hold the system of `runs`, with our expressions for their custom functions."""
    lib = pytest.importorskip("pysindy").feature_library
    powers, waves = lib.PolynomialLibrary(degree=3), lib.FourierLibrary(n_frequencies=2)
    custom = lib.CustomLibrary(
        [lambda x: x, lambda x: x**3, lambda x, y: x * y, lambda x: np.sin(x)], include_bias=True
    )
    return {
        "concatenated": (lib.ConcatLibrary([powers, waves]), ()),
        "custom": (custom, ("x", "x**3", "sin(x)")),
        "general": (lib.GeneralizedLibrary([powers, waves], inputs_per_library=[[1, 0], [0]]), ()),
    }


@pytest.mark.parametrize("kind", ["concatenated", "custom", "general"])
@pytest.mark.parametrize("inputs", [0, 1])
@pytest.mark.filterwarnings("ignore")
def test_sindy_models_come_in(kind, inputs):
    """A SINDy model of single-state terms becomes a model with the same right side and the true coefficients."""
    feature_library, functions = libraries()[kind]
    if kind == "general" and inputs:
        feature_library.inputs_per_library = [[2, 1, 0], [0]]
    x, dot, u = runs(inputs=inputs)
    sindy = fitted(feature_library, x, dot, u)
    model = ps.from_pysindy(sindy, functions)
    assert np.allclose(model.rhs(x, u if inputs else None), sindy.predict(x, u if inputs else None), atol=1e-12)
    assert np.allclose(model.rhs(x, u if inputs else None), dot, atol=1e-6)
    assert np.allclose(model.A0[0], [-1, 2], atol=1e-6)
    assert np.allclose(model.b, [0.5, 0], atol=1e-6)
    assert (model.states, model.inputs) == (("x0", "x1"), ("u0",) * inputs)


@pytest.mark.filterwarnings("ignore")
def test_products_of_states_of_sindy_come_in():
    """A product of two states is written by squares of their sum and difference; the right side is the same."""
    lib = pytest.importorskip("pysindy").feature_library
    x, _, _ = runs()
    dot = np.stack([-x[:, 0] + 2 * x[:, 0] * x[:, 1], -x[:, 1] - 2 * x[:, 0] ** 2], axis=1)
    sindy = fitted(lib.PolynomialLibrary(degree=2), x, dot)
    model = ps.from_pysindy(sindy)
    assert np.allclose(model.rhs(x), sindy.predict(x), atol=1e-12)
    assert np.allclose(model.rhs(x), dot, atol=1e-6)


@pytest.mark.filterwarnings("ignore")
def test_other_cross_terms_of_sindy_are_refused_by_name():
    """A term of two states that is no product of them, or of a state and an input, is named."""
    lib = pytest.importorskip("pysindy").feature_library
    x, _, u = runs(inputs=1)
    for beside, name in ((x[:, 0] ** 2 * x[:, 1], r"x0\^2 x1"), (x[:, 0] * u[:, 0], "x0 u0")):
        dot = np.stack([-x[:, 0] + 2 * beside, -x[:, 1]], axis=1)
        with pytest.raises(ModelError, match=f"'{name}' is no function of a single state"):
            ps.from_pysindy(fitted(lib.PolynomialLibrary(degree=3), x, dot, u))


@pytest.mark.filterwarnings("ignore")
def test_sindy_models_that_are_not_affine_in_the_input_are_refused():
    """A square of the input is named."""
    lib = pytest.importorskip("pysindy").feature_library
    x, dot, u = runs(inputs=1)
    with pytest.raises(ModelError, match=r"'u0\^2' is not linear in the input"):
        ps.from_pysindy(fitted(lib.PolynomialLibrary(degree=2), x, dot + u**2, u))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("functions", "words"),
    [
        ((), "has no expression"),
        (("x", "x**3", "sinh(x)"), "the right sides differ"),
        (("x", "x**3", "sin(x)", "tanh(x)"), "belong to no custom function"),
    ],
)
def test_wrong_expressions_for_custom_functions_are_found(functions, words):
    """Expressions that are missing, wrong or too many are errors."""
    feature_library, _ = libraries()["custom"]
    with pytest.raises(ModelError, match=words):
        ps.from_pysindy(fitted(feature_library, *runs()[:2]), functions)


def test_other_models_are_no_sindy_models(duffing):
    """What is no model of continuous time by PySINDy is refused."""
    pytest.importorskip("pysindy")
    with pytest.raises(ModelError, match="not PersidskiiModel"):
        ps.from_pysindy(duffing)


def two_runs() -> ps.Trajectories:
    rng = np.random.default_rng(1)
    t = [np.arange(5) * 0.1, np.array([0.0, 0.05, 1.0])]
    x, u = [rng.normal(size=(len(s), 2)) for s in t], [rng.normal(size=len(s)) for s in t]
    return ps.Trajectories.from_arrays(x, u, t=t, states=["speed", "angle"], inputs=["force"])


def same(a: ps.Trajectories, b: ps.Trajectories) -> bool:
    pairs = zip(a, b, strict=True)
    equal = all(np.array_equal(getattr(r, k), getattr(s, k)) for r, s in pairs for k in ("t", "x", "u"))
    return equal and (a.states, a.inputs) == (b.states, b.inputs)


def test_dataframes_come_back():
    """Trajectories -> DataFrame -> Trajectories changes no bit."""
    data = two_runs()
    frame = data.to_dataframe()
    assert list(frame.loc[1].index) == [0.0, 0.05, 1.0]
    assert same(ps.Trajectories.from_dataframe(frame, inputs=["force"]), data)


def test_datasets_come_back_and_fillings_are_noted():
    """Trajectories -> Dataset -> Trajectories changes no bit, though the runs have different times."""
    pytest.importorskip("xarray")
    data = two_runs()
    dataset = data.to_xarray()
    assert dict(dataset.sizes) == {"run": 2, "t": 7}
    back = ps.Trajectories.from_xarray(dataset, inputs=["force"])
    assert same(back, data)
    assert back.notes == tuple(f"table {k}: {n} times without any number were left out" for k, n in pairwise([1, 2, 4]))


def test_datasets_of_one_run_need_no_dimension_of_runs():
    """A Dataset over its time alone is one run; other names of dimensions are told by arguments."""
    xarray = pytest.importorskip("xarray")
    clock = {"clock": [0.0, 0.5, 2.0]}
    dataset = xarray.Dataset({"y": ("clock", [1.0, 2.0, 3.0])}, coords=clock)
    data = ps.Trajectories.from_xarray(dataset, time="clock")
    assert (len(data), data[0].t.tolist(), data[0].x.ravel().tolist()) == (1, [0.0, 0.5, 2.0], [1.0, 2.0, 3.0])


def broken_datasets():
    import xarray

    t = {"t": [0.0, 1.0]}
    return {
        "no dimension": (xarray.Dataset({"y": ("k", [1.0, 2.0])}), {}, "named t or time"),
        "a gap": (xarray.Dataset({"y": ("t", [1.0, np.nan])}, coords=t), {}, "row 1.0, column 'y'"),
        "no variable": (xarray.Dataset({"y": ("t", [1.0, 2.0])}, coords=t), {"states": ["z"]}, "no variable 'z'"),
        "cube": (xarray.Dataset({"y": (("a", "b", "t"), np.ones((2, 2, 2)))}, coords=t), {}, "at most one"),
        "other": (pd.DataFrame({"y": [1.0]}), {}, r"xarray\.Dataset is needed"),
    }


@pytest.mark.parametrize("case", ["no dimension", "a gap", "no variable", "cube", "other"])
def test_datasets_that_do_not_fit_are_refused(case):
    """The message says what was given and what is needed."""
    pytest.importorskip("xarray")
    dataset, options, words = broken_datasets()[case]
    with pytest.raises(DataError, match=words):
        ps.Trajectories.from_xarray(dataset, **options)


def test_an_absent_xarray_names_its_extra(monkeypatch):
    """Without xarray the error says what to install."""
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match=r"persid\[interop\]"):
        two_runs().to_xarray()
