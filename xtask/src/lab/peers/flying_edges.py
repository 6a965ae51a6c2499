"""VTK's threaded flying edges on a raw f32 lattice: flying_edges.py FILE NX NY NZ LEVEL THREADS.

Prints one line of JSON: triangles, seconds (best of three)."""
import json
import sys
import time

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk

file, nx, ny, nz, level, threads = sys.argv[1:]
shape = int(nx), int(ny), int(nz)
vtk.vtkSMPTools.SetBackend("STDThread")
vtk.vtkSMPTools.Initialize(int(threads))
values = np.fromfile(file, dtype=np.float32)
image = vtk.vtkImageData()
image.SetDimensions(*shape)
image.GetPointData().SetScalars(numpy_to_vtk(values, deep=False))
best = float("inf")
for _ in range(3):
    edges = vtk.vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, float(level))
    edges.ComputeNormalsOff()
    edges.ComputeGradientsOff()
    edges.ComputeScalarsOff()
    start = time.perf_counter()
    edges.Update()
    best = min(best, time.perf_counter() - start)
print(json.dumps({"triangles": edges.GetOutput().GetNumberOfPolys(), "seconds": best}))
