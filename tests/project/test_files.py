"""Files that are written: what stands there is replaced whole or not at all, and only where it is a regular file."""

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from command_line import raising
from persid._files import move, write_atomically
from persid.commands import cli
from places import ROOT


def test_a_file_keeps_its_permissions_and_a_new_one_can_be_read(tmp_path: Path) -> None:
    """Replacing a file changes its content alone."""
    path = tmp_path / "a.json"
    write_atomically(path, "new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    path.chmod(0o600)
    write_atomically(path, "newer")
    assert (path.read_text(), stat.S_IMODE(path.stat().st_mode)) == ("newer", 0o600)


@pytest.mark.parametrize("exists", [True, False])
def test_links_are_written_through(tmp_path: Path, exists: bool) -> None:
    """A link stays a link, and what it names is written, whether it was there or not."""
    target, link = tmp_path / "target.json", tmp_path / "link.json"
    link.symlink_to(target)
    if exists:
        target.write_text("old")
    write_atomically(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    (tmp_path / "staged").write_text("staged")
    move(tmp_path / "staged", link)
    assert link.is_symlink()
    assert target.read_text() == "staged"
    assert not (tmp_path / "staged").exists()


def test_pipes_are_written_in_place(tmp_path: Path) -> None:
    """A named pipe stays one, and its reader gets the bytes."""
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_atomically(pipe, b"bytes")
    reader.join(5)
    assert got == [b"bytes"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_devices_are_written_in_place() -> None:
    """A device stays one; a full one is named."""
    write_atomically("/dev/null", "gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    if Path("/dev/full").exists():
        with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
            write_atomically("/dev/full", "x")
        assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


def test_a_full_disk_names_the_file_and_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What cannot be written is named, the old content stays, and nothing is left beside it."""
    path = tmp_path / "a.json"
    write_atomically(path, "old")
    monkeypatch.setattr("os.fsync", raising(OSError(28, "No space left on device")))
    with pytest.raises(OSError, match=r"No space left on device: '.*a\.json'"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize("how", ["pipe", "file"])
@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_results_go_to_standard_output(here: Path, how: str, name: str) -> None:
    """A run for an output that is open goes there, into a pipe or a file, and the device stays what it is."""
    command = [
        sys.executable,
        "-m",
        "persid",
        "simulate",
        "model.json",
        "--x0",
        "1,1",
        "--t-end",
        "1",
        "-q",
        "-o",
        name,
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    with open("out.csv", "w") as file:
        file.write("before\n")
        file.flush()
        to = subprocess.PIPE if how == "pipe" else file
        done = subprocess.run(command, stdout=to, stderr=subprocess.PIPE, text=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    text = done.stdout if how == "pipe" else Path("out.csv").read_text().removeprefix("before\n")
    assert text.startswith("t,x1,x2,u\n0.0,1.0,1.0,0.0\n")
    assert len(text.splitlines()) == 1002


def test_a_command_writes_through_a_link(here: Path) -> None:
    """persid certify -o of a link writes what the link names."""
    (here / "store").mkdir()
    (here / "c.json").symlink_to(here / "store" / "c.json")
    assert cli.main(["certify", "model.json", "-o", "c.json"]) == 0
    assert (here / "c.json").is_symlink()
    assert cli.main(["check", "store/c.json"]) == 0
