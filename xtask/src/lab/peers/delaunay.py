"""Random Delaunay meshes of scipy: delaunay.py CUBE CLOUD, two files that meshio writes.

CUBE is the unit cube with a regular grid on its faces and random points inside, CLOUD the hull of random
points in a ball. Prints one line of JSON: the number of tetrahedra of each."""
import json
import sys

import meshio
import numpy as np
from scipy.spatial import Delaunay

random = np.random.default_rng(1)


def mesh(points):
    tets = Delaunay(points).simplices
    a, b, c, d = (points[tets[:, k]] for k in range(4))
    volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)
    # Points of one face make flat tetrahedra on the hull.
    kept = np.abs(volume) > 1e-12
    tets, volume = tets[kept], volume[kept]
    tets[volume < 0] = tets[volume < 0][:, [1, 0, 2, 3]]
    return meshio.Mesh(points, [("tetra", tets)])


n = 9
axis = np.linspace(0, 1, n)
grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
on_face = np.any((grid == 0) | (grid == 1), axis=1)
inside = random.uniform(0.5 / n, 1 - 0.5 / n, (n**3 - on_face.sum(), 3))
cube = mesh(np.vstack([grid[on_face], inside]))

ball = random.normal(size=(600, 3))
ball *= (random.uniform(size=(600, 1)) ** (1 / 3)) / np.linalg.norm(ball, axis=1)[:, None]
cloud = mesh(ball)

counts = []
for path, made in zip(sys.argv[1:], [cube, cloud]):
    made.write(path)
    counts.append(len(made.cells[0].data))
print(json.dumps(counts))
