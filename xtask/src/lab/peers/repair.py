"""What MeshFix does to surfaces: repair.py FILE.ply...

Each part of a surface for itself, since it keeps one. Prints one line of JSON: per file the numbers of triangles before and
after, of borders, of triangles that cut another, and the volumes."""

import json
import sys

import numpy as np
import trimesh
from pymeshfix import PyTMesh


def repaired(part):
    points = np.ascontiguousarray(part.vertices, dtype=np.float64)
    triangles = np.ascontiguousarray(part.faces, dtype=np.int32)
    fix = PyTMesh()
    fix.set_quiet(True)
    fix.load_array(points, triangles)
    cut = len(fix.select_intersecting_triangles())
    borders = fix.n_boundaries
    fix.fill_small_boundaries(0, True)
    clean = fix.clean(10, 3)
    made = trimesh.Trimesh(*fix.return_arrays(), process=False)
    return cut, borders, clean, made


def told(file):
    mesh = trimesh.load(file, process=False)
    answer = {"borders": 0, "cut": 0, "triangles": 0, "volume": 0.0, "kept": 0, "clean": True}
    before = {tuple(sorted(map(tuple, t))) for t in mesh.triangles}
    for part in mesh.split(only_watertight=False):
        cut, borders, clean, made = repaired(part)
        after = {tuple(sorted(map(tuple, t))) for t in made.triangles}
        answer["borders"] += borders
        answer["cut"] += cut
        answer["clean"] &= bool(clean)
        answer["triangles"] += len(made.faces)
        answer["kept"] += len(before & after)
        answer["volume"] += float(made.volume)
    return answer


print(json.dumps([told(file) for file in sys.argv[1:]]))
