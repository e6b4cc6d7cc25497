"""The folder of a run: all its files are written, or none."""

from pathlib import Path
from typing import TYPE_CHECKING

from persid.reports import layout
from persid.reports.delivery import delivery
from persid.reports.page import write_report
from persid.reports.results import Results
from persid.reports.verdict_files import write_verdict

if TYPE_CHECKING:
    from persid.certified_fits.delivery import Alternative


def write_folder(output: Path, results: Results, beside: "Alternative | None" = None) -> str:
    """Write all files of a run, or none; return the name of the file that carries the verdict.

    The certified model that was not delivered goes into a folder of its own.
    """
    proofs = [layout.CERTIFICATE, layout.FASTEST, layout.PLANTS, layout.MARGIN, layout.MODELS]
    proofs += [layout.WITNESS, layout.OBSTRUCTION, layout.INFEASIBLE]
    with delivery(output, [*proofs, f"{layout.FIGURES}/*.png", f"{layout.ALTERNATIVE}/*.json"]) as stage:
        results.model.save(stage / layout.MODEL)
        proof = write_verdict(stage, results.verdict, results.model)
        if results.record is not None:
            results.record.save(stage)
        if results.plant is not None and results.plant.models is not None:
            results.plant.models.certificate.save(stage / layout.MODELS)
        write_report(results, stage)
        if beside is not None:
            (stage / layout.ALTERNATIVE).mkdir()
            beside.model.save(stage / layout.ALTERNATIVE / layout.MODEL)
            write_verdict(stage / layout.ALTERNATIVE, beside.verdict, beside.model)
    return proof
