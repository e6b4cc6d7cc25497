"""Where the arrays of the interior-point method live, and the few operations that the array API standard lacks.

The method is written once against the standard; `Arrays` is the seam for the rest: moving in and out, new arrays on the
device, sparse products, a Cholesky factorisation that says whether it failed, the inverse of a triangle, and writing to
a diagonal. NumPy with LAPACK is the default, PyTorch serves a GPU, and any other namespace of the standard does what
the standard allows.

A device is waited for wherever a number is read. So no loop of the method reads one where it could go on without, and
no matrix of the inequality's order is moved in a step: tests count both.
"""

import warnings
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any, Protocol, runtime_checkable

import array_api_compat.numpy as numpy_namespace
import numpy as np
import scipy.linalg as sla
from scipy import sparse

from persid._libraries import library
from persid._memory import memory
from persid.errors import ModelError

Array = Any  # of one namespace of the array API standard, in binary64: the standard has no class for it
SparseMatrix = Any  # of SciPy

SMALL = 2**14  # entries up to which a sparse matrix is used as a dense one: a product then costs less than its call
HOST_BLOCK, DEVICE_BLOCK = 32, 1024  # rows of the Schur complement made at once: in the cache, or to keep a GPU busy


@runtime_checkable
class Arrays(Protocol):
    """A namespace `xp` of the array API standard, and what the method needs beyond it; M is symmetric throughout."""

    @property
    def xp(self) -> ModuleType:
        """The namespace."""
        ...

    @property
    def block(self) -> int:
        """How many rows of the Schur complement are made at once."""
        ...

    @property
    def memory(self) -> int:
        """How many bytes the arrays may take at most, where they live."""
        ...

    def put(self, a: np.ndarray) -> Array:
        """Return a host array as one of these."""
        ...

    def get(self, a: Array) -> np.ndarray:
        """Return one of these as a host array."""
        ...

    def empty(self, *shape: int) -> Array:
        """Return room for numbers, made where the arrays live."""
        ...

    def identity(self, order: int) -> Array:
        """Return the identity, made where the arrays live."""
        ...

    def sparse(self, M: SparseMatrix) -> Any:
        """Return what gives the product M @ v of a sparse matrix with a vector or a dense matrix."""
        ...

    def half(self, M: Array) -> Array:
        """Return L^-1 with M = L L'; LinAlgError where M is not positive definite."""
        ...

    def is_positive(self, M: Array) -> bool:
        """Whether M has a Cholesky factor."""
        ...

    def smallest(self, M: Array) -> float:
        """Return the smallest eigenvalue of a small M."""
        ...

    def inner(self, a: Array, b: Array) -> float:
        """Return the sum of all products of entries."""
        ...

    def solver(self, M: Array) -> Callable[[Array], Array]:
        """Return v -> M^-1 v for vectors or columns; only the lower triangle of M is read, and M is overwritten."""
        ...

    def add_to_diagonal(self, M: Array, v: Array | float) -> Array:
        """Return M + diag(v), written to M where that is possible."""
        ...


class Host:
    """NumPy arrays, factorised by LAPACK."""

    xp, block = numpy_namespace, HOST_BLOCK

    @property
    def memory(self) -> int:
        return memory()

    def put(self, a: np.ndarray) -> np.ndarray:
        return a

    def get(self, a: np.ndarray) -> np.ndarray:
        return a

    def empty(self, *shape: int) -> np.ndarray:
        return np.empty(shape)

    def identity(self, order: int) -> np.ndarray:
        return np.eye(order)

    def sparse(self, M: SparseMatrix) -> SparseMatrix | np.ndarray:
        return M if M.shape[0] * M.shape[1] > SMALL else M.toarray()

    def half(self, M: np.ndarray) -> np.ndarray:
        factor, failed = sla.lapack.dpotrf(M, lower=1, clean=1)
        if failed:
            raise sla.LinAlgError("not positive definite")
        inverse: np.ndarray = sla.lapack.dtrtri(factor, lower=1, overwrite_c=1)[0]  # trtrs would start threads
        return inverse

    def is_positive(self, M: np.ndarray) -> bool:
        return bool(sla.lapack.dpotrf(M, lower=1, clean=0)[1] == 0)

    def smallest(self, M: np.ndarray) -> float:
        values, _, _, _, failed = sla.lapack.dsyevr(M, compute_v=0, range="I", il=1, iu=1)
        if failed:
            raise sla.LinAlgError("no eigenvalues")
        return float(values[0])

    def inner(self, a: np.ndarray, b: np.ndarray) -> float:
        return float(np.dot(a.ravel(), b.ravel()))

    def solver(self, M: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        factor, failed = sla.lapack.dpotrf(M.T, lower=0, clean=0, overwrite_a=1)  # M' is in LAPACK's order
        if failed:
            raise sla.LinAlgError("not positive definite")
        return lambda v: np.asarray(sla.lapack.dpotrs(factor, v, lower=0)[0])

    def add_to_diagonal(self, M: np.ndarray, v: np.ndarray | float) -> np.ndarray:
        np.einsum("ii->i", M)[:] += v  # a view of the diagonal
        return M


class Standard:
    """Any namespace of the array API standard: sparse matrices become dense, triangles are inverted as matrices."""

    block = DEVICE_BLOCK

    def __init__(self, xp: ModuleType, device: Any = None) -> None:
        self.xp, self.device = xp, device

    @property
    def memory(self) -> int:
        return memory()

    def put(self, a: np.ndarray) -> Array:
        return self.xp.asarray(np.ascontiguousarray(a), device=self.device, copy=True)

    def get(self, a: Array) -> np.ndarray:
        return np.asarray(a)

    def empty(self, *shape: int) -> Array:
        return self.xp.empty(shape, dtype=self.xp.float64, device=self.device)

    def identity(self, order: int) -> Array:
        return self.xp.eye(order, dtype=self.xp.float64, device=self.device)

    def sparse(self, M: SparseMatrix) -> Any:
        return self.put(M.toarray())

    def half(self, M: Array) -> Array:
        return self.xp.linalg.inv(self._factor(M))

    def is_positive(self, M: Array) -> bool:
        try:
            self._factor(M)
        except sla.LinAlgError:
            return False
        return True

    def smallest(self, M: Array) -> float:
        return float(self.xp.linalg.eigvalsh(M)[0])

    def inner(self, a: Array, b: Array) -> float:
        return float(self.xp.vecdot(self.xp.reshape(a, (-1,)), self.xp.reshape(b, (-1,))))

    def solver(self, M: Array) -> Callable[[Array], Array]:
        half = self.half(self.xp.tril(M) + self.xp.tril(M, k=-1).T)
        return lambda v: half.T @ (half @ v)

    def add_to_diagonal(self, M: Array, v: Array | float) -> Array:
        return M + v * self.identity(M.shape[0])

    def _factor(self, M: Array) -> Array:
        """Return L; LinAlgError where M is not positive definite: then namespaces raise, or return no numbers."""
        L = self.xp.linalg.cholesky(M)
        if not bool(self.xp.all(self.xp.isfinite(L))):
            raise sla.LinAlgError("not positive definite")
        return L


class Torch(Standard):
    """PyTorch arrays on a device, such as "cuda"."""

    def __init__(self, device: str) -> None:
        self.torch = library("torch", "gpu")
        try:
            self.torch.zeros(1, dtype=self.torch.float64, device=device)
        except (RuntimeError, AssertionError, TypeError) as error:  # PyTorch raises any, the last without binary64
            raise ModelError(f"no device {device!r} here: {str(error).splitlines()[0]}") from None
        super().__init__(import_module("array_api_compat.torch"), self.torch.device(device))

    @property
    def memory(self) -> int:
        return int(self.torch.cuda.mem_get_info(self.device)[1]) if self.device.type == "cuda" else memory()

    def get(self, a: Array) -> np.ndarray:
        return np.asarray(a.cpu().numpy())

    def sparse(self, M: SparseMatrix) -> Any:
        rows = sparse.csr_array(M)
        parts = (self.put(rows.indptr.astype(np.int64)), self.put(rows.indices.astype(np.int64)), self.put(rows.data))
        with warnings.catch_warnings(action="ignore", category=UserWarning):  # PyTorch calls its CSR matrices beta
            return self.torch.sparse_csr_tensor(*parts, size=rows.shape, check_invariants=False)

    def half(self, M: Array) -> Array:
        return self.torch.linalg.solve_triangular(self._factor(M), self.identity(len(M)), upper=False)

    def smallest(self, M: Array) -> float:
        try:
            return float(self.torch.linalg.eigvalsh(M)[0])
        except self.torch.linalg.LinAlgError as error:  # a RuntimeError, not NumPy's
            raise sla.LinAlgError(str(error)) from None

    def solver(self, M: Array) -> Callable[[Array], Array]:
        L = self._factor(M)

        def solve(v: Array) -> Array:
            columns = v if v.ndim == 2 else v[:, None]
            return self.torch.cholesky_solve(columns, L).reshape(v.shape)

        return solve

    def add_to_diagonal(self, M: Array, v: Array | float) -> Array:
        M.diagonal().add_(v)
        return M

    def _factor(self, M: Array) -> Array:
        """Return L; LinAlgError also where M is not finite: not every device reports that, but L ends in NaN then."""
        L, failed = self.torch.linalg.cholesky_ex(M)
        if not bool((failed == 0) & self.torch.isfinite(L[-1, -1])):
            raise sla.LinAlgError("not positive definite")
        return L


HOST: Arrays = Host()


def arrays_on(device: str) -> Arrays:
    """Return the arrays of a device: "cpu" for NumPy, and PyTorch for any other, such as "cuda" or "cuda:1"."""
    return HOST if device == "cpu" else Torch(device)


def is_out_of_memory(error: Exception) -> bool:
    """Whether an error says that the host or a device has no memory left: PyTorch's is a RuntimeError by that name."""
    return isinstance(error, MemoryError) or type(error).__name__ == "OutOfMemoryError"
