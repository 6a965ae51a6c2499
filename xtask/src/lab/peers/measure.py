"""What trimesh and meshio measure: measure.py FILE..., surfaces or tetrahedra.

Prints one line of JSON: an object per file."""
import json
import sys
from pathlib import Path

import meshio
import numpy as np
import trimesh


def surface(mesh):
    return {
        "watertight": bool(mesh.is_watertight),
        "oriented": bool(mesh.is_winding_consistent),
        "euler": int(mesh.euler_number),
        "parts": int(mesh.body_count),
        "area": float(mesh.area),
        "volume": float(mesh.volume),
    }


def dihedrals(points, tets):
    """Six angles per tetrahedron, degrees: between the outward normals of two faces."""
    corners = points[tets]
    normals = []
    for k in range(4):
        a, b, c = (corners[:, i] for i in range(4) if i != k)
        normal = np.cross(b - a, c - a)
        inward = np.einsum("ij,ij->i", normal, corners[:, k] - a) > 0
        normal[inward] *= -1
        normals.append(normal / np.linalg.norm(normal, axis=1)[:, None])
    cosines = [
        -np.einsum("ij,ij->i", normals[i], normals[j])
        for i in range(4)
        for j in range(i + 1, 4)
    ]
    return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def regions(mesh):
    """Per tetrahedron: from the cell field, or else from the names of physical groups."""
    if "region" in mesh.cell_data:
        number, data = int, mesh.cell_data["region"]
    else:
        names = {int(v[0]): k for k, v in mesh.field_data.items() if int(v[1]) == 3}
        known = {"exterior": 0, "molecule": 1}
        number, data = lambda tag: known[names[tag]], mesh.cell_data["gmsh:physical"]
    data = [np.ravel(d) for b, d in zip(mesh.cells, data) if b.type == "tetra"]
    return np.array([number(v) for v in np.concatenate(data)])


def volume(mesh):
    tets = np.vstack([b.data for b in mesh.cells if b.type == "tetra"])
    region = regions(mesh)
    points = mesh.points
    a, b, c, d = (points[tets[:, k]] for k in range(4))
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
    angles = dihedrals(points, tets)
    faces = np.sort(tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    edges = np.sort(
        tets[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2), axis=1
    )
    _, uses = np.unique(faces, axis=0, return_counts=True)
    kinds = len(np.unique(tets)), len(np.unique(edges, axis=0)), len(uses), len(tets)
    return {
        "volumes": {str(r): float(volumes[region == r].sum()) for r in np.unique(region)},
        "smallest volume": float(volumes.min()),
        "min dihedral": float(angles.min()),
        "max dihedral": float(angles.max()),
        "faces of three": int((uses > 2).sum()),
        "boundary faces": int((uses == 1).sum()),
        "euler": kinds[0] - kinds[1] + kinds[2] - kinds[3],
    }


def measure(file):
    if Path(file).suffix in (".msh", ".vtu"):
        mesh = meshio.read(file)
        if any(block.type == "tetra" for block in mesh.cells):
            return volume(mesh)
        return surface(trimesh.Trimesh(mesh.points, mesh.get_cells_type("triangle")))
    mesh = trimesh.load(file, force="mesh")
    # The same corners in each triangle of a bare list.
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    return surface(mesh)


print(json.dumps([measure(file) for file in sys.argv[1:]]))
