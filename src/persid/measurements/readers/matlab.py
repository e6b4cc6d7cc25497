"""MATLAB files: versions 5 to 7 by SciPy, 7.3 by mat73. Vectors of one length are columns, a matrix is several."""

from collections import Counter

import numpy as np
import pandas as pd

from persid._libraries import library
from persid.errors import DataError
from persid.measurements.readers.sources import Content, Source, stream
from persid.measurements.tables import Columns, Table


def matlab_table(source: Source, columns: Columns) -> Table:
    """Read the numeric arrays of a MATLAB file; of a matrix M the columns are M1, M2, ...; a scalar is a step.

    Raises:
        DataError: it cannot be read, or holds no arrays.
        ImportError: the file is of version 7.3 and mat73 is not installed.
    """
    arrays = {name: np.asarray(value) for name, value in _variables(source).items() if not name.startswith("__")}
    found = {name: value for name, value in arrays.items() if value.dtype.kind in "fiub" and value.ndim <= 2}
    lengths = Counter(max(value.shape, default=1) for value in found.values() if value.size > 1)
    if not lengths:
        raise DataError(f"{source}: it holds no arrays of numbers; its variables are {', '.join(arrays) or 'none'}")
    wanted = [max(v.shape) for name, v in found.items() if name in columns.asked and v.size > 1]
    rows = wanted[0] if wanted else lengths.most_common(1)[0][0]
    parts: dict[str, object] = {}
    for name, value in found.items():
        if value.size == 1:
            parts[name] = np.concatenate([np.ravel(value).astype(float), np.full(rows - 1, np.nan)])
        elif value.size == rows:
            parts[name] = value.ravel()
        elif rows in value.shape:
            matrix = value if value.shape[0] == rows else value.T
            parts |= {f"{name}{k + 1}": matrix[:, k] for k in range(matrix.shape[1])}
    return Table(str(source), pd.DataFrame(parts), lambda k: f"sample {k + 1}")


def _variables(source: Source) -> dict[str, object]:
    from scipy.io import loadmat

    try:
        return dict(loadmat(stream(source)))
    except NotImplementedError:  # version 7.3 is HDF5
        mat73 = library("mat73", "files")
        try:
            return dict(mat73.loadmat(stream(source) if isinstance(source, Content) else str(source)))
        except (OSError, ValueError, TypeError) as error:
            raise DataError(f"{source}: cannot be read as a MATLAB file: {error}") from None
    except (OSError, ValueError, TypeError, IndexError) as error:
        raise DataError(f"{source}: cannot be read as a MATLAB file: {error}") from None
