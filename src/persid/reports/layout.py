"""The names of the files in the folder of a run."""

MODEL, RECORD, REPORT, FIGURES = "model.json", "run.json", "report.html", "figures"
CERTIFICATE, WITNESS, OBSTRUCTION = "certificate.json", "witness.json", "obstruction.json"
FASTEST = "fastest.json"  # the certificate of the best proved rate, where the other one has a smaller rate and gain
PLANTS, MARGIN = "plants.json", "margin.json"  # the certificate of every plant near the model, and figures beside it
MODELS = "models.json"  # the certificate of every model that the data allow, or of a part of them
INFEASIBLE = "infeasible.json"  # the proof of an obstruction, where there is one
ALTERNATIVE = "alternative"  # the certified model that was not delivered
