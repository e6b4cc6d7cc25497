"""Output models on the command line: certify, check, simulate."""

import json
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from persid.commands.cli import main
from persid.commands.options import OUTPUT_OPTIONS, output_options
from stable_fits import random_fit

T = np.arange(40) * 0.1


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ps.OutputModel:
    """An output model in an empty folder, with an input and the outputs that it gives."""
    monkeypatch.chdir(tmp_path)
    model = ps.OutputModel.from_fit(random_fit(3, n=2, q=2, outputs=2))
    model.save("model.json")
    u = np.sin(T)[:, None]
    y = model.simulate(T, u, x0=[1.0, -1.0])[0].x
    np.savetxt("in.csv", np.column_stack([T, u]), delimiter=",", header="t,u1", comments="")
    np.savetxt("y.csv", np.column_stack([T, y])[:10], delimiter=",", header="t,y1,y2", comments="")
    return model


def test_an_output_model_is_certified_and_checked(found: ps.OutputModel, capsys: pytest.CaptureFixture[str]) -> None:
    """The gain of every output is printed, the latent one is not; the file belongs to its model."""
    assert main(["certify", "model.json", "-o", "c.json", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["gain"] is None
    assert set(told["output_gains"]) == {"y1", "y2"}
    assert main(["check", "c.json", "--model", "model.json"]) == 0
    assert "|'y1' - y*| <=" in capsys.readouterr().out
    assert main(["certify", "model.json", "-o", "c.json"]) == 0
    assert "gain of y1 " in capsys.readouterr().out
    ps.OutputModel(found.dynamics, 2 * found.C, found.D, found.d).save("other.json")
    assert main(["check", "c.json", "--model", "other.json"]) == 5
    assert "other outputs" in capsys.readouterr().out


def test_an_output_model_is_simulated(found: ps.OutputModel) -> None:
    """A run starts from a latent state, or from the first measured outputs."""
    words = ["simulate", "model.json", "--inputs-csv", "in.csv"]
    assert main([*words, "--x0", "1,-1", "-o", "a.csv"]) == 0
    assert main([*words, "--y-init", "y.csv", "-o", "b.csv"]) == 0
    a, b = (np.loadtxt(name, delimiter=",", skiprows=1) for name in ("a.csv", "b.csv"))
    assert Path("a.csv").read_text().startswith("t,y1,y2,u1\n")
    assert np.allclose(a, b, atol=1e-3)
    assert np.allclose(a[:10, 1:3], np.loadtxt("y.csv", delimiter=",", skiprows=1)[:, 1:], atol=1e-5)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "--y-init, a file with the first measured outputs"),
        (["--x0", "1,1", "--y-init", "y.csv"], "not both"),
        (["--y-init", "in.csv"], "y1"),
        (["--x0", "1"], "x0 has shape (1,)"),
    ],
)
def test_wrong_starts_are_named(
    found: ps.OutputModel, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither, both, or the wrong start is a mistake of the caller, and nothing is written."""
    assert main(["simulate", "model.json", "--inputs-csv", "in.csv", *words, "-o", "r.csv"]) == 2
    assert message in capsys.readouterr().err
    assert not Path("r.csv").exists()


def test_a_batch_takes_output_models(found: ps.OutputModel) -> None:
    """certify_many decides output models and files of them."""
    verdicts = ps.certify_many([found, "model.json"], engine=None)
    assert all(verdict.is_certified for verdict in verdicts)


def records(folder: Path) -> None:
    """Two records of a damped oscillator with a soft spring, position measured: one to fit, one to foretell."""
    A0, force = [[0.0, 1.0], [-1.0, -0.6]], [[0.0], [-1.0]]
    plant = ps.PersidskiiModel(A0, [("tanh(x)", [[1.0, 0.0]], force)], [[0.0], [2.0]])
    rng, t = np.random.default_rng(0), np.arange(500) * 0.1
    for name in ("fit.csv", "test.csv"):
        u = np.repeat(rng.uniform(-1, 1, 50), 10)[:, None]
        y = plant.simulate([0.0, 0.0], t, u)[0].x[:, :1] + 0.003 * rng.normal(size=(500, 1))
        np.savetxt(folder / name, np.column_stack([t, u, y]), delimiter=",", header="t,u,y", comments="")


@pytest.mark.long
def test_run_goes_from_outputs_to_a_certificate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """persid run --outputs fits, certifies, foretells a file that was kept from the fit, and reports."""
    monkeypatch.chdir(tmp_path)
    records(tmp_path)
    words = [
        "run",
        "fit.csv",
        "--outputs",
        "y",
        "--inputs",
        "u",
        "--order",
        "2",
        "--neurons",
        "2",
        "--test",
        "test.csv",
    ]
    assert main([*words, "-o", "out", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == "certified"
    assert set(told["output_gains"]) == {"y"}
    assert told["held_out"]["unseen"]["y"]["r2"] > 0.95
    assert isinstance(ps.load_model("out/model.json"), ps.OutputModel)
    assert main(["check", "out/certificate.json", "--model", "out/model.json"]) == 0
    page = Path("out/report.html").read_text()
    assert "kept from the fit" in page
    assert main(["report", "out", "--quiet"]) == 0


def test_a_run_keeps_a_known_coefficient(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A force does not act on a position at once, and the delivered model says so exactly."""
    monkeypatch.chdir(tmp_path)
    records(tmp_path)
    words = ["run", "fit.csv", "--outputs", "y", "--inputs", "u", "--order", "2", "--neurons", "0", "--measured", "y"]
    assert main([*words, "--fixed", "y,u=0", "-o", "out", "--quiet"]) == 0
    model = ps.load_model("out/model.json")
    assert isinstance(model, ps.OutputModel)
    assert model.dynamics.B[0].tolist() == [0.0]
    assert model.dynamics.B[1].item() != 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--inputs", "u"], "give --states, or --outputs"),
        (["--outputs", "y", "--states", "y"], "give --states, or --outputs"),
        (["--states", "y", "--order", "3"], "--order goes with --outputs"),
        (["--outputs", "y", "--order", "many"], "neither"),
        (["--outputs", "q", "--inputs", "u"], "q"),
        (["--outputs", "still", "--inputs", "u"], "output still is constant"),
        (["--outputs", "y", "--inputs", "u", "--max-output-gain", "1,2"], "--max-output-gain is [1.0, 2.0]"),
        (["--outputs", "y", "--inputs", "u", "--measured", "q"], "--measured names 'q', which is none of the outputs"),
        (["--outputs", "y", "--inputs", "u", "--measured", "y", "--fixed", "y,q=0"], "--fixed names ('y', 'q')"),
        (["--outputs", "y", "--inputs", "u", "--measured", "y", "--fixed", "y=0"], "write state,column=number"),
        (["--states", "y", "--fixed", "y,u=0"], "--fixed goes with --outputs"),
        (["--states", "y", "--max-output-gain", "1"], "--max-output-gain goes with --outputs"),
        (["--outputs", "y", "--inputs", "u", "--order", "9"], "smaller order"),
        (["--outputs", "y", "--inputs", "u", "--neurons", "60"], "fewer neurons"),
        (["--outputs", "y", "--inputs", "u", "--min-rate", "-1"], "--min-rate -1 is not positive"),
    ],
)
def test_bad_input_of_a_run_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Contradictions, unknown columns, constant outputs and too large models are named, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(60) * 0.1
    table = np.column_stack([t, np.sin(t), np.cos(t), np.ones(60)])
    np.savetxt("d.csv", table, delimiter=",", header="t,u,y,still", comments="")
    assert main(["run", "d.csv", *words, "-o", "out"]) == 2
    assert message in capsys.readouterr().err
    assert not Path("out").exists()


def test_an_output_model_is_scored_on_other_files(found: ps.OutputModel, capsys: pytest.CaptureFixture[str]) -> None:
    """persid score runs an output model freely over files, from their first samples, and says how it follows each."""
    u = np.cos(2 * T)[:, None]
    y = found.simulate(T, u, x0=[-1.0, 0.5])[0].x
    y[:, 1] += 0.1 * np.random.default_rng(0).normal(size=len(T))
    np.savetxt("other.csv", np.column_stack([T, u, y]), delimiter=",", header="t,u1,y1,y2", comments="")
    assert main(["score", "model.json", "other.csv", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["scores"]["outputs"]
    assert told["y1"]["rmse"] < 0.2 * told["y2"]["rmse"]
    assert main(["score", "model.json", "other.csv"]) == 0
    assert "y2         R2 " in capsys.readouterr().out
    assert main(["score", "model.json", "y.csv"]) == 2
    assert "u1" in capsys.readouterr().err


def test_zero_neurons_are_asked_for() -> None:
    """--neurons 0 reaches the fit, as an option that was not given does not."""
    how = dict.fromkeys(OUTPUT_OPTIONS) | {"foh": False, "neurons": 0}
    assert output_options(how) == {"neurons": 0}
