"""One file, one answer: read strictly, prove every hypothesis, state what was proved."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from flint import ctx

from persid_check import json_text, ledger
from persid_check.enclosure import PRECISION
from persid_check.identity import Meant
from persid_check.ledger.check import check_ledger
from persid_check.results import Accepted, FormatError, Malformed, NotProvedError, Rejected, Result

Source = bytes | str | Path


def check(source: Source, model: Source | None = None, explain: bool = True, *, arrays: bytes | None = None) -> Result:
    """Check a certificate: bytes, or the path of a file; with `model`, it must be the certificate's model.

    Never raises for what a file holds. `explain` fills in the steps of an accepted proof. The companion of a large
    network is looked for in the folder of the file, unless its bytes are given as `arrays`.

    Raises:
        OSError: a file cannot be read.

    Examples:
        >>> type(persid_check.check(b"{}")).__name__
        'Malformed'
    """
    data = _bytes(source)
    other = None if model is None else _bytes(model)
    try:
        with ctx.workprec(PRECISION):
            content = json_text.read(data, floats=False, longest=_longest(data))
            wanted = None if other is None else _meant(json_text.read(other, floats=True), _folder(model))
            answer = _proved(content, len(data), wanted, _folder(source), arrays)
    except FormatError as error:
        return Malformed(error.where, error.why)
    except NotProvedError as error:
        return Rejected(error.where, error.why)
    except ArithmeticError as error:
        return Rejected("arithmetic", str(error))
    return answer if explain else replace(answer, steps=())


def _bytes(source: Source) -> bytes:
    if isinstance(source, bytes):
        return source
    with Path(source).open("rb") as file:
        return file.read(json_text.MAX_BYTES + 1)


def _meant(model: object, folder: Path | None) -> Meant:
    from persid_check.canonical import meant

    return meant(model, folder)


def _folder(source: Source | None) -> Path | None:
    return None if source is None or isinstance(source, bytes) else Path(source).parent


def _longest(data: bytes) -> int:
    """The bytes that a file of its format may have, as far as its beginning tells."""
    return ledger.MAX_BYTES if f'"{ledger.FORMAT}"'.encode() in data[:HEAD] else json_text.MAX_BYTES


HEAD = 200  # bytes in which a file of format 2 names its format, if its length is to be refused before it is parsed


def _proved(content: object, size: int, wanted: Meant | None, folder: Path | None, arrays: bytes | None) -> Accepted:
    """Each kind of file by its own road. The ledger needs no other room, so none is read before it is asked for."""
    stated: Mapping[str, object] = content if isinstance(content, dict) else {}
    claim = stated.get("claim")
    if stated.get("format") == ledger.FORMAT:
        return check_ledger(stated, size, wanted, folder, arrays)
    if claim in ("L1", "L1-infeasible"):
        from persid_check.networks.check import check_network

        return check_network(stated, size, wanted, folder, arrays)
    if claim in ("infeasible", "refuted"):
        from persid_check.refutations.check import check_refutation

        return check_refutation(stated, size, wanted)
    if claim in ("G", "M", "E", "R"):
        from persid_check.version_1.check import check_version_1

        return check_version_1(stated, size, wanted)
    raise FormatError("format", f"{ledger.FORMAT}, or a known claim of an earlier format, is needed")
