"""Measurements larger than memory: the same sums wherever they lie, bounded memory, workers that may be lost."""

import os
import signal
import threading
import tracemalloc
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import persid as ps
from persid.measurements import opening as surveys
from persid.measurements.engines import Threads, make_engine, summed
from persid.measurements.opening import files_of
from persid.measurements.recordings import Part

NAMES = {"states": ["a", "b"], "inputs": ["u"]}


def frame(samples: int, seed: int = 0, jitter: float = 0.0) -> pd.DataFrame:
    """A run of a damped oscillator with a held random input, at steps that may vary."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(0.01 * (1 + jitter * rng.random(samples)))
    u = np.repeat(rng.normal(size=samples // 10 + 1), 10)[:samples]
    x = np.column_stack([np.sin(1.3 * t) + 0.3 * np.cos(3 * t), np.cos(t) + 0.1 * np.sin(5 * t)])
    return pd.DataFrame({"t": t, "a": x[:, 0], "b": x[:, 1], "u": u})


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read small row groups in chunks of about 1000 rows."""
    monkeypatch.setattr(surveys, "CHUNK", 1000)


def gaps(table: pd.DataFrame) -> pd.DataFrame:
    """Put two gaps into the time of a table, one of them at the border of two row groups."""
    table = table.copy()
    table.loc[2100:, "t"] += 5
    table.loc[3333:, "t"] += 3
    return table


def without(table: pd.DataFrame, rows: list[int]) -> pd.DataFrame:
    """Empty the cells of some rows."""
    table.loc[rows, ["a", "b"]] = np.nan
    return table


def same(one: Any, other: Any) -> None:
    """Compare two Gram matrices with all that belongs to them, to 1e-12."""
    for name in ("G", "H", "yy"):
        a, b = getattr(one, name), getattr(other, name)
        assert np.abs(a - b).max() <= 1e-12 * np.abs(a).max()
    assert one.rows == other.rows


def labelled(table: pd.DataFrame) -> pd.DataFrame:
    """Tell three runs apart by a column, each with a clock of its own."""
    return table.assign(run=np.repeat(["a", "b", "c"], [1500, 700, len(table) - 2200]), t=table["t"] % 20)


def coded(table: pd.DataFrame) -> pd.DataFrame:
    """Write -9999 where a value is missing."""
    table.loc[[10, 900, 2500], "a"] = -9999
    return table


DATES = pd.date_range("2024-03-31", periods=5000, freq="50ms", tz="Europe/Berlin")

CASES = {
    "dates": ([frame(5000).assign(t=DATES)], {}),
    "times since 1970": ([frame(5000).assign(t=1_711_839_600_000 + 50 * np.arange(5000))], {}),
    "a clock that starts again": ([frame(5000).assign(t=frame(5000)["t"] % 20)], {}),
    "a column of runs": ([labelled(frame(5000))], {"run": "run", "gap": 1.0}),
    "missing-value codes": ([coded(frame(5000))], {"na": [-9999], "missing": "split"}),
    "rows that are dropped": ([without(frame(5000), list(range(0, 5000, 3)))], {"missing": "drop"}),
    "one run in row groups": ([frame(5000)], {}),
    "steps that vary, gaps": ([gaps(frame(5000, jitter=0.3))], {}),
    "several files": ([frame(900, k, jitter=0.2) for k in range(7)], {}),
    "incomplete rows": ([without(frame(5000), [10, 699, 700, 2500])], {"missing": "split"}),
}


@pytest.mark.long
@pytest.mark.parametrize("window", ["auto", 64])
@pytest.mark.parametrize("case", CASES)
def test_the_same_gram_matrices_as_in_memory(tmp_path: Path, case: str, window: Any) -> None:
    """Chunk by chunk, a fit has the Gram matrices, ridge, scales and model of a fit in memory."""
    tables, options = CASES[case]
    for k, table in enumerate(tables):
        table.to_parquet(tmp_path / f"{k}.parquet", row_group_size=350)
    here = ps.read_parquet(files_of(tmp_path), **NAMES, **options)
    there = ps.open_recordings(tmp_path, **NAMES, **options)
    assert there.lengths == [len(run) for run in here]
    one = ps.PersidskiiIdentifier(window=window).fit(here)
    other = ps.PersidskiiIdentifier(window=window).fit(there)
    same(one.gram_, other.gram_)
    assert (one.ridge_, one.window_, len(one.blocks_)) == (other.ridge_, other.window_, len(other.blocks_))
    assert (one.basis_.scale == other.basis_.scale).all()
    assert np.allclose(one.coef_, other.coef_, rtol=1e-6, atol=1e-9)
    assert other.report_.free_run.rmse == pytest.approx(one.report_.free_run.rmse, rel=1e-6)
    assert any("chunk by chunk" in note for note in other.report_.notes)


def test_edmd_chunk_by_chunk(tmp_path: Path) -> None:
    """EDMD pairs the same snapshots as in memory, across chunks too."""
    model = ps.PersidskiiModel([[-1.0, 0.5], [-0.5, -2.0]], B=[[1.0], [0.5]], states=["a", "b"], inputs=["u"])
    u = np.random.default_rng(0).normal(size=(3000, 1))
    run = model.simulate([1.0, -1.0], np.arange(3000) * 0.05, u)[0]
    table = pd.DataFrame(np.column_stack([run.t, run.x, run.u]), columns=["t", "a", "b", "u"])
    table.to_parquet(tmp_path / "run.parquet", row_group_size=350)
    fits = [
        ps.PersidskiiIdentifier(["x"], method="edmd").fit(data)
        for data in (ps.read_parquet(tmp_path / "run.parquet", **NAMES), ps.open_recordings(tmp_path, **NAMES))
    ]
    same(fits[0].gram_, fits[1].gram_)
    assert np.allclose(fits[1].model_.A0, [[-1.0, 0.5], [-0.5, -2.0]], atol=1e-6)


@pytest.mark.parametrize("engine", [None, "dask"])
@pytest.mark.long
def test_dask_dataframes(engine: Any) -> None:
    """A Dask DataFrame in partitions is one long run, or several by a column of runs."""
    dd = pytest.importorskip("dask.dataframe")
    table = gaps(frame(5000, jitter=0.3))
    cut = [table[:2100], table[2100:3333], table[3333:]]
    here = ps.PersidskiiIdentifier().fit(ps.Trajectories.from_dataframe(cut, **NAMES))
    whole = ps.open_recordings(dd.from_pandas(table, npartitions=7), **NAMES, engine=engine)
    same(here.gram_, ps.PersidskiiIdentifier().fit(whole).gram_)
    table["t"] = np.arange(5000) * 0.01
    table["who"] = np.repeat(["p", "q"], [2100, 2900])
    parts = [table[:2100], table[2100:]]
    by_run = ps.open_recordings(dd.from_pandas(table, npartitions=7), **NAMES, run="who", engine=engine)
    assert by_run.lengths == [2100, 2900]
    here = ps.PersidskiiIdentifier().fit(ps.Trajectories.from_dataframe(parts, **NAMES))
    same(here.gram_, ps.PersidskiiIdentifier().fit(by_run).gram_)


@pytest.mark.long
def test_dask_arrays() -> None:
    """Dask arrays of states, inputs and times go to fit like arrays."""
    da = pytest.importorskip("dask.array")
    table = frame(3000)
    x, u, t = table[["a", "b"]].to_numpy(), table[["u"]].to_numpy(), table["t"].to_numpy()
    here = ps.PersidskiiIdentifier().fit(x, u=u, t=t)
    cut = [da.from_array(part, chunks=size) for part, size in ((x, (700, 1)), (u, 512), (t, 999))]
    same(here.gram_, ps.PersidskiiIdentifier().fit(cut[0], u=cut[1], t=cut[2]).gram_)


def test_csv_files_and_patterns(tmp_path: Path) -> None:
    """Lists and patterns of CSV files are runs of their own, in order."""
    for k in range(3):
        frame(400 + k, k).to_csv(tmp_path / f"{k}.csv", index=False)
    found = ps.open_recordings(str(tmp_path / "*.csv"), **NAMES)
    assert found.lengths == [400, 401, 402]
    same(
        ps.PersidskiiIdentifier().fit(found).gram_,
        ps.PersidskiiIdentifier().fit(ps.read_csv(files_of(tmp_path), **NAMES)).gram_,
    )
    run = found.segments([Part(1, 5, 9, 0)])[0]
    assert np.array_equal(run.x, frame(401, 1)[["a", "b"]].to_numpy()[5:9])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.assign(a=t["a"].where(t.index != 1500)), "row 1501, column 'a': the cell is empty"),
        (
            lambda t: t.assign(t=t["t"].where(t.index != 1410, t["t"][1405])),
            "row 1411, column 't': time .* comes after",
        ),
        (
            lambda t: t.assign(t=t["t"].where(t.index != 1410, t["t"][1409])),
            "row 1411, column 't': time .* is repeated",
        ),
        (lambda t: t.drop(columns="b"), "no column 'b'"),
        (lambda t: t.assign(t=np.where(t.index < 1000, t["t"], t["t"] / 50 + 10)), "give the step in s"),
        (lambda t: t.assign(t=np.where(t.index < 1400, t["t"], t["t"][1399])), "is repeated"),
    ],
)
def test_faults_are_named(tmp_path: Path, change: Any, message: str) -> None:
    """A fault in a chunk is named by its file and row, as in memory."""
    change(frame(2000)).to_parquet(tmp_path / "run.parquet", row_group_size=350)
    with pytest.raises(ps.DataError, match=message):
        ps.open_recordings(tmp_path, **NAMES)


def test_what_needs_memory_is_refused(tmp_path: Path) -> None:
    """Options that need all samples at once are refused, and so are predictions."""
    frame(2000).to_parquet(tmp_path / "run.parquet")
    found = ps.open_recordings(tmp_path, **NAMES)
    for options in ({"derivatives": 1}, {"refine": True}, {"method": "derivative"}):
        with pytest.raises(ps.DataError, match="in memory"):
            ps.PersidskiiIdentifier(**options).fit(found)
    with pytest.raises(ps.DataError, match="in memory"):
        ps.PersidskiiIdentifier().fit(found).score(found)
    with pytest.raises(ps.DataError, match="no such file"):
        ps.open_recordings(tmp_path / "absent", **NAMES)
    with pytest.raises(ps.DataError, match="choose None"):
        make_engine("spark")


def test_progress_and_sums_of_threads() -> None:
    """Threads add in a tree and tell how many chunks are done."""
    lines: list[str] = []
    total = Threads(lines.append).total(lambda k: {k % 3: k}, [(k,) for k in range(50)], "adding")
    assert total == summed({k % 3: k} for k in range(50))
    assert "adding: 50 of 50 chunks" in lines


def peak(folder: Path) -> int:
    """Return the peak of memory in bytes of looking through recordings and fitting."""
    tracemalloc.start()
    ps.PersidskiiIdentifier(ridge=0.01, holdout=0.0).fit(ps.open_recordings(folder, **NAMES))
    found = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return found


def test_memory_does_not_depend_on_the_number_of_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five times as many rows take less than a fifth more memory."""
    monkeypatch.setattr(surveys, "CHUNK", 8_000)
    for samples in (24_000, 120_000):
        (tmp_path / str(samples)).mkdir()
        frame(samples).to_parquet(tmp_path / str(samples) / "run.parquet", row_group_size=8_000)
    peak(tmp_path / "24000")  # what is loaded once is not counted
    assert peak(tmp_path / "120000") < 1.2 * peak(tmp_path / "24000")


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A Dask cluster of two processes, and its client."""
    distributed = pytest.importorskip("distributed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of Dask itself, when it starts and when a worker dies
        with (
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
            ) as local,
            distributed.Client(local) as client,
        ):
            yield client


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_lost_worker_is_survived(tmp_path: Path, cluster: Any) -> None:
    """With a worker killed in the middle of a pass, the fit has the Gram matrices of a fit in memory."""
    for k in range(60):
        frame(500, k).to_csv(tmp_path / f"{k:02}.csv", index=False)
    victim = next(iter(cluster.run(os.getpid).values()))
    seen: list[str] = []

    def tell(line: str) -> None:
        seen.append(line)
        if line.startswith("summing: 0 of"):
            threading.Timer(0.05, os.kill, (victim, signal.SIGKILL)).start()

    there = ps.open_recordings(tmp_path, **NAMES, engine=cluster, progress=tell)
    fit = ps.PersidskiiIdentifier().fit(there)
    assert victim not in cluster.run(os.getpid).values()
    assert "summing: 60 of 60 chunks" in seen
    same(ps.PersidskiiIdentifier().fit(ps.read_csv(files_of(tmp_path), **NAMES)).gram_, fit.gram_)
