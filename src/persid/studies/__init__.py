"""The paper's three experiments, reproduced, and a study of a power grid: `run_study("traffic", folder)`.

Each study is one module with a function `run(parts, quick, seeds)` that uses the public interface of persid only.
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from persid.studies.tables import Study

STUDIES = ("traffic", "bases", "wave", "power")


def run_study(
    name: str,
    folder: str | Path,
    *,
    quick: bool = False,
    seeds: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> "Study":
    """Run a study and write its tables, figures, proofs and page into a folder; return what it found.

    Finished parts lie in the folder as JSON: an interrupted study goes on where it stopped, and a part is computed anew
    only when its parameters, the revision of the study or the versions of the packages have changed.

    Args:
        name: one of STUDIES.
        folder: for the results; created where it is missing.
        quick: smaller sizes, under two minutes for all studies together.
        seeds: repetitions with other random data (wave only); None for the study's own number.
        progress: is called with a line of text at each step.

    Raises:
        KeyError: no study of that name.
    """
    from persid.studies.page import write_study
    from persid.studies.parts import Parts

    if name not in STUDIES:
        raise KeyError(f"{name!r} is no study; choose one of {', '.join(STUDIES)}")
    module = import_module(f"persid.studies.{name}")
    parts = Parts.below(Path(folder), module, progress or (lambda line: None))
    study: Study = module.run(parts, quick, seeds)
    write_study(study, parts.folder)
    return study
