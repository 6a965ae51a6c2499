"""Quads of a triangle mesh by Instant Meshes (Jakob, Tarini, Panozzo and Sorkine-Hornung, 2015; pynanoinstantmeshes).

    quads.py MESH.obj QUADS OUT.obj

Asks for so many quads, in its deterministic mode, and writes what comes. Prints seconds, and how many faces have
four corners and other numbers of them."""

import json
import os
import sys
import time

import numpy as np
import pynanoinstantmeshes

points, faces = [], []
with open(sys.argv[1]) as file:
    for line in file:
        words = line.split()
        if words and words[0] == "v":
            points.append([float(x) for x in words[1:4]])
        elif words and words[0] == "f":
            faces.append([int(w.split("/")[0]) - 1 for w in words[1:4]])

# It tells what it does on the standard output, where only the answer shall go.
sys.stdout.flush()
answer = os.dup(1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
start = time.perf_counter()
# At last it cuts each face into quads at its middle: four of each quad.
made, polygons = pynanoinstantmeshes.remesh(
    np.array(points, np.float32),
    np.array(faces, np.uint32),
    max(int(sys.argv[2]) // 4, 8),
    align_to_boundaries=True,
    deterministic=True,
)
seconds = time.perf_counter() - start
os.dup2(answer, 1)

counts = {}
with open(sys.argv[3], "w") as file:
    for p in made:
        file.write("v %.9g %.9g %.9g\n" % tuple(p))
    for polygon in polygons:
        corners = []
        for v in polygon:
            if int(v) not in corners:
                corners.append(int(v))
        counts[len(corners)] = counts.get(len(corners), 0) + 1
        file.write("f " + " ".join(str(v + 1) for v in corners) + "\n")

print(json.dumps({
    "seconds": seconds,
    "quads": counts.get(4, 0),
    "others": sum(n for k, n in counts.items() if k != 4),
}))
