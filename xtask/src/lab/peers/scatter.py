"""A separable scatter of one level of Gaussians on a dense lattice, compiled by numba and threaded
over slabs: scatter.py FILE NX NY NZ OX OY OZ SPACING DECAY CUT THREADS.

FILE holds x, y, z, radius of each atom as f64. Kernels below CUT are dropped. Prints one line of
JSON: pairs, seconds (best of three, compilation left out), and the sum of the lattice."""
import json
import sys
import time

import numba
import numpy as np

file = sys.argv[1]
nx, ny, nz = (int(v) for v in sys.argv[2:5])
ox, oy, oz, spacing, decay, cut = (float(v) for v in sys.argv[5:11])
numba.set_num_threads(int(sys.argv[11]))
atoms = np.fromfile(file, dtype=np.float64).reshape(-1, 4)
atoms = atoms[np.argsort(atoms[:, 2], kind="stable")]
SLAB = 8


@numba.njit(parallel=True, fastmath=True)
def scatter(atoms, reach, far, grid, ox, oy, oz, h, decay):
    nz, ny, nx = grid.shape
    slabs = (nz + SLAB - 1) // SLAB
    pairs = np.zeros(slabs, np.int64)
    for s in numba.prange(slabs):
        k0, k1 = s * SLAB, min(nz, (s + 1) * SLAB)
        low, high = oz + k0 * h - far, oz + (k1 - 1) * h + far
        first = np.searchsorted(atoms[:, 2], low)
        last = np.searchsorted(atoms[:, 2], high)
        ex = np.empty(nx, np.float32)
        for a in range(first, last):
            x, y, z, r = atoms[a]
            c = reach[a]
            ka, kb = max(k0, int(np.ceil((z - c - oz) / h))), min(k1 - 1, int((z + c - oz) / h))
            if ka > kb:
                continue
            ia, ib = max(0, int(np.ceil((x - c - ox) / h))), min(nx - 1, int((x + c - ox) / h))
            ja, jb = max(0, int(np.ceil((y - c - oy) / h))), min(ny - 1, int((y + c - oy) / h))
            w = decay
            for i in range(ia, ib + 1):
                ex[i] = np.exp(-w * (ox + i * h - x) ** 2)
            for k in range(ka, kb + 1):
                fz = np.exp(w * (r * r - (oz + k * h - z) ** 2))
                for j in range(ja, jb + 1):
                    f = np.float32(fz * np.exp(-w * (oy + j * h - y) ** 2))
                    row = grid[k, j]
                    for i in range(ia, ib + 1):
                        row[i] += f * ex[i]
            pairs[s] += (kb - ka + 1) * (jb - ja + 1) * (ib - ia + 1)
    return pairs.sum()


# exp(-decay (d² - r²)) = cut, the kernel of our model
reach = np.sqrt(atoms[:, 3] ** 2 - np.log(cut) / decay)
tiny = np.zeros((8, 8, 8), np.float32)
scatter(atoms[:1], reach[:1], reach[:1].max(), tiny, ox, oy, oz, spacing, decay)
best = float("inf")
for _ in range(3):
    grid = np.zeros((nz, ny, nx), np.float32)
    start = time.perf_counter()
    pairs = scatter(atoms, reach, reach.max(), grid, ox, oy, oz, spacing, decay)
    best = min(best, time.perf_counter() - start)
print(json.dumps({"pairs": int(pairs), "seconds": best, "sum": float(grid.sum(dtype=np.float64))}))
