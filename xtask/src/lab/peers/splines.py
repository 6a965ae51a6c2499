"""What other programs see in a spline surface: Gmsh in its STEP, VTK in its Bezier cells, SciPy in its matrices.

    splines.py STEP VTU POINTS STIFFNESS.mtx STIFFNESS.npz MASS.mtx MASS.npz COUNT

POINTS holds where each cell should be at 3 x 3 parameters, as f64. Prints one line of JSON."""
import json
import sys

import gmsh
import numpy as np
import scipy.io
import scipy.sparse as sp
import scipy.sparse.linalg as sla
import vtk

PLACES = (0.0, 0.3, 1.0)


def area(face, points, pieces=1):
    """By Gauss's rule of points x points on pieces x pieces parts: where a patch is nearly folded, the integrand has a kink,
    and rules differ by more than surfaces do."""
    (u0, v0), (u1, v1) = gmsh.model.getParametrizationBounds(2, face)
    x, w = np.polynomial.legendre.leggauss(points)
    x = np.concatenate([(k + (x + 1) / 2) / pieces for k in range(pieces)])
    w = np.tile(w / 2 / pieces, pieces)
    u, v = np.meshgrid(u0 + (u1 - u0) * x, v0 + (v1 - v0) * x, indexing="ij")
    at = np.stack([u.ravel(), v.ravel()], axis=1).ravel()
    tangents = np.array(gmsh.model.getDerivative(2, face, at)).reshape(-1, 6)
    normals = np.cross(tangents[:, :3], tangents[:, 3:])
    return float(np.outer(w, w).ravel() @ np.linalg.norm(normals, axis=1)) * (u1 - u0) * (v1 - v0)


def measured(file):
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.importShapes(file)
    gmsh.model.occ.synchronize()
    faces, solids = gmsh.model.getEntities(2), gmsh.model.getEntities(3)
    answer = {
        "faces": len(faces),
        "solids": len(solids),
        "area": sum(area(face, 10) for _, face in faces),
        "area_finely": sum(area(face, 16, 2) for _, face in faces),
        "volume": sum(gmsh.model.occ.getMass(*s) for s in solids),
    }
    gmsh.finalize()
    return answer


def evaluated(file, points):
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(file)
    reader.Update()
    grid = reader.GetOutput()
    expected = np.fromfile(points, "<f8").reshape(-1, 3)
    sub, at, weights, worst, n, cells = vtk.reference(0), [0.0] * 3, [0.0] * 16, 0.0, 0, 0
    for c in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(c)
        cells += cell.GetCellType() == 77
        for t in PLACES:
            for s in PLACES:
                cell.EvaluateLocation(sub, [s, t, 0.0], at, weights)
                worst = max(worst, float(np.linalg.norm(expected[n] - at)))
                n += 1
    assert n == len(expected)
    return {"cells": int(cells), "apart": worst}


def eigenvalues(stiffness, mass, count):
    read = scipy.io.mmread if stiffness.endswith("mtx") else sp.load_npz
    k, m = sp.csc_matrix(read(stiffness)), sp.csc_matrix(read(mass))
    # A little below zero, in units of the largest scale.
    shift = -1e-3 * k.diagonal().sum() / m.diagonal().sum()
    start = np.random.default_rng(1).standard_normal(k.shape[0])
    values = sla.eigsh(k, count, m, sigma=shift, v0=start, tol=1e-13, return_eigenvectors=False)
    return sorted(float(v) for v in values)


step, vtu, points, *matrices, count = sys.argv[1:]
answer = measured(step) | evaluated(vtu, points)
for i, kind in enumerate(("mtx", "npz")):
    answer[kind] = eigenvalues(matrices[i], matrices[2 + i], int(count))
print(json.dumps(answer))
