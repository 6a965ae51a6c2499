"""The smallest eigenpairs of K x = lambda M x by SciPy's eigsh in shift-invert mode, once with its own
factorization (superlu) and once with CHOLMOD (cholmod).

    eigsh.py FOLDER SHIFT SOLVER,... THREADS COUNT...

THREADS is the number of threads of the dense products (BLAS), 0 for what is the default. FOLDER holds starts.u64, indices.u32, values.f64 (K in compressed rows) and mass.f64 (the diagonal of
M). Prints a list with, per count and solver, the values, wall seconds and CPU seconds of the fastest of three runs."""

import json
import os
import sys
import time

# Read when NumPy is loaded.
if sys.argv[4] != "0":
    os.environ["OPENBLAS_NUM_THREADS"] = sys.argv[4]

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla


def cholmod(matrix):
    """Solves with a factor of a positive definite matrix."""
    import cvxopt
    import cvxopt.cholmod

    lower = sp.tril(matrix).tocoo()
    a = cvxopt.spmatrix(lower.data, lower.row, lower.col, matrix.shape)
    factor = cvxopt.cholmod.symbolic(a)
    cvxopt.cholmod.numeric(a, factor)

    def solve(b):
        x = cvxopt.matrix(np.ascontiguousarray(b, dtype=float).reshape(-1, 1))
        cvxopt.cholmod.solve(factor, x)
        return np.array(x).ravel()

    return sla.LinearOperator(matrix.shape, matvec=solve, dtype=float)


def main():
    folder, shift, solvers = sys.argv[1], float(sys.argv[2]), sys.argv[3].split(",")
    counts = [int(c) for c in sys.argv[5:]]
    read = lambda name, kind: np.fromfile(f"{folder}/{name}", dtype=kind)
    starts = read("starts.u64", "<u8").astype(np.int64)
    n = len(starts) - 1
    k = sp.csr_matrix((read("values.f64", "<f8"), read("indices.u32", "<u4").astype(np.int32), starts), shape=(n, n)).tocsc()
    m = sp.diags(read("mass.f64", "<f8")).tocsc()
    # The same start for each, and not a constant.
    start = np.random.default_rng(1).standard_normal(n)
    answers = []
    for count in counts:
        for solver in solvers:
            best = None
            # The fastest of three: times of some hundredths of a second vary by a third.
            for _ in range(3):
                wall, cpu = time.perf_counter(), time.process_time()
                inverse = None
                if solver == "cholmod":
                    try:
                        inverse = cholmod(k - shift * m)
                    except ImportError:
                        break
                values = sla.eigsh(k, count, m, sigma=shift, OPinv=inverse, v0=start, return_eigenvectors=True)[0]
                took = (time.perf_counter() - wall, time.process_time() - cpu)
                best = min(best or took, took)
            if best is None:
                continue
            answers.append({
                "count": count,
                "solver": solver,
                "values": sorted(float(v) for v in values),
                "seconds": best[0],
                "cpu": best[1],
            })
    print(json.dumps(answers))


main()
