"""TetGen's tetrahedra inside a closed surface: tetrahedralize.py SURFACE OUT, OUT a file that meshio writes.

Prints the number of tetrahedra as JSON."""
import json
import sys

import meshio
import tetgen
import trimesh

surface = trimesh.load(sys.argv[1], process=False)
made = tetgen.TetGen(surface.vertices, surface.faces).tetrahedralize(order=1, minratio=1.3, mindihedral=10)
points, tets = made[0], made[1]
meshio.Mesh(points, [("tetra", tets)]).write(sys.argv[2])
print(json.dumps(len(tets)))
