"""Grids through mrcfile and GridDataFormats: grids.py MAP DX FOLDER.

Reads ours, and writes into FOLDER what it read, in the ways that those programs write. Prints one line
of JSON."""
import json
import sys
from pathlib import Path

import gridData
import mrcfile
import numpy as np

map_file, dx_file, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
with mrcfile.open(map_file) as mrc:
    values = mrc.data.copy()  # z, y, x
    origin = [float(mrc.header.origin[k]) for k in "xyz"]
    spacing = [float(mrc.voxel_size[k]) for k in "xyz"]
    rms, mean = float(mrc.header.rms), float(mrc.header.dmean)
valid = mrcfile.validate(map_file, print_file=sys.stderr)
dx = gridData.Grid(dx_file)  # x, y, z

written = []
whole = np.round(values * 100)
for dtype in ("int8", "int16", "float32", "uint16", "float16"):
    for name in (f"{dtype}.mrc", f"{dtype}.mrc.gz"):
        data = (np.abs(whole) % 100 if dtype == "uint16" else np.clip(whole, -100, 100)).astype(dtype)
        compression = "gzip" if name.endswith("gz") else None
        with mrcfile.new(folder / name, data, compression=compression, overwrite=True) as mrc:
            mrc.voxel_size = tuple(spacing)
            mrc.header.origin.x, mrc.header.origin.y, mrc.header.origin.z = origin
        written.append({"name": name, "sum": float(data.astype(float).sum())})
grid = gridData.Grid(dx.grid, edges=dx.edges)
grid.export(folder / "peer.dx", type="double")
written.append({"name": "peer.dx", "sum": float(dx.grid.sum())})

x, y, z = np.meshgrid(*(np.arange(n) for n in dx.grid.shape), indexing="ij")
weight = 1 + x + 2 * y + 3 * z
print(
    json.dumps(
        {
            "valid": bool(valid),
            "origin": origin,
            "spacing": spacing,
            "rms": rms,
            "mean": mean,
            "weighted": float((values.T.astype(float) * weight).sum()),
            "dx origin": [float(c) for c in dx.origin],
            "dx spacing": [float(c) for c in dx.delta],
            "dx weighted": float((dx.grid.astype(float) * weight).sum()),
            "written": written,
        }
    )
)
