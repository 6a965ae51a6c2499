"""Geodesic distances by potpourri3d: distances.py MESH.ply TABLE SMOOTHING PATHS.

TABLE holds our distances from the first vertex. Prints one line of JSON: the mean of theirs by the heat method with the
same time of heating, the mean difference as a part of that, and the mean errors of both against so many paths that are
straightened until they are geodesic."""

import json
import sys

import numpy as np
import potpourri3d as pp3d
import trimesh

mesh = trimesh.load(sys.argv[1], process=False)
points, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
ours = np.loadtxt(sys.argv[2])
theirs = pp3d.MeshHeatMethodDistanceSolver(points, triangles, float(sys.argv[3])).compute_distance(0)

paths = pp3d.EdgeFlipGeodesicSolver(points, triangles)
# Far ones as often as near ones; not those beside the source.
order = np.argsort(ours)[len(ours) // 10 :]
targets = order[np.linspace(0, len(order) - 1, int(sys.argv[4])).astype(int)]


def length(target):
    path = paths.find_geodesic_path(0, int(target))
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


straight = np.array([length(t) for t in targets])
print(
    json.dumps(
        {
            "mean": float(theirs.mean()),
            "apart": float(np.abs(ours - theirs).mean() / theirs.mean()),
            "our error": float(np.abs(ours[targets] - straight).mean() / straight.mean()),
            "their error": float(np.abs(theirs[targets] - straight).mean() / straight.mean()),
        }
    )
)
