"""What type checkers know of the public names: mypy reads this file, nobody runs it."""

from pathlib import Path
from typing import assert_type

import numpy as np

import persid as ps
import persid_check

data = ps.read_csv("run.csv", states=["x"], inputs=["u"])
assert_type(data, ps.Trajectories)
assert_type(data[0], ps.Trajectory)
assert_type(ps.read_parquet(Path("run.parquet"), states=["x"]), ps.Trajectories)
assert_type(ps.open_recordings("runs", states=["x"]), ps.Recordings)

fit = ps.PersidskiiIdentifier(functions=["x", "x**3"]).fit(data)
assert_type(fit, ps.PersidskiiIdentifier)
assert_type(fit.model_, ps.PersidskiiModel)
assert_type(ps.CertifiedIdentifier(fit).fit(data), ps.CertifiedIdentifier)
assert_type(ps.bootstrap(fit, 10), ps.Bootstrap)

model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
assert_type(model.simulate([1.0], np.zeros(10)), ps.Trajectories)
assert_type(ps.find_operating_point(model), tuple[ps.OperatingPoint, ...])

verdict = ps.certify(model, operating_point="auto", time_limit=10)
assert_type(verdict, ps.Certified | ps.Refuted | ps.Undecided)
match verdict:
    case ps.Certified(certificate):
        assert_type(certificate, ps.Certificate | ps.NetworkCertificate)
    case ps.Refuted(witness):
        assert_type(witness, ps.Witness)
    case ps.Undecided():
        assert_type(verdict.is_certified, bool)
answers = ps.certify_many([model, "model.json"], engine=None)
assert_type(answers[0], ps.Certified | ps.Refuted | ps.Undecided | ps.Failed)

assert_type(ps.load_certificate("certificate.json"), ps.Certificate | ps.NetworkCertificate)
assert_type(ps.check("certificate.json", model), ps.Accepted | ps.Rejected | ps.Malformed)
assert_type(persid_check.check(b"{}"), persid_check.Accepted | persid_check.Rejected | persid_check.Malformed)
