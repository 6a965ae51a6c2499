"""A solver's view of a mesh: solve.py PROBLEM RADIUS FILE, with linear finite elements of scikit-fem.

PROBLEM interior: -Δu = 1 in the ball, u = 0 on `molecule|exterior`.
PROBLEM exterior: Δu = 0 around it, u = 1 on `molecule|exterior`, u = RADIUS/r on the other faces.
PROBLEM both: -div(k grad u) = f, with k = 2, f = 1 in `molecule` and k = 80, f = 0 in `exterior`.

Prints one line of JSON: the error in L2 relative to the solution, and what names arrived."""
import json
import sys

import meshio
import numpy as np
import skfem
from skfem.helpers import dot, grad
from skfem.io.meshio import from_meshio

problem, radius, file = sys.argv[1], float(sys.argv[2]), sys.argv[3]
raw = meshio.read(file)
if not raw.cell_sets and "group" in raw.cell_data:
    # VTU has numbers per cell, and in its field data what they are called.
    groups = raw.cell_data.pop("group")
    raw.cell_sets = {
        name: [np.flatnonzero(g == int(np.ravel(number)[0])) for g in groups]
        for name, number in raw.field_data.items()
    }
# meshio's own notes are no names of parts.
raw.cell_sets = {name: cells for name, cells in raw.cell_sets.items() if not name.startswith("gmsh:")}
mesh = from_meshio(raw)
regions = sorted(mesh.subdomains or {})
boundaries = sorted(mesh.boundaries or {})

inside, outside = 2.0, 80.0


def exact(x):
    r = np.maximum(np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2), 1e-12)
    if problem == "interior":
        return (radius**2 - r**2) / 6
    if problem == "exterior":
        return radius / r
    within = radius**2 / (3 * outside) + (radius**2 - r**2) / (6 * inside)
    return np.where(r < radius, within, radius**3 / (3 * outside * r))


element = skfem.ElementTetP1()
whole = skfem.Basis(mesh, element)
stiffness = skfem.BilinearForm(lambda u, v, _: dot(grad(u), grad(v)))
load = skfem.LinearForm(lambda v, _: 1.0 * v)
if problem == "both":
    parts = [skfem.Basis(mesh, element, elements=name) for name in ("molecule", "exterior")]
    a = inside * stiffness.assemble(parts[0]) + outside * stiffness.assemble(parts[1])
    b = load.assemble(parts[0])
else:
    a = stiffness.assemble(whole)
    b = load.assemble(whole) * (problem == "interior")

values = exact(whole.doflocs)
fixed = []
for name in boundaries:
    if name == "molecule|exterior":
        if problem == "both":
            continue
        dofs = whole.get_dofs(name).all()
        values[dofs] = 0.0 if problem == "interior" else 1.0
    else:
        dofs = whole.get_dofs(name).all()
    fixed.append(dofs)
system = skfem.condense(a, b, x=values, D=np.unique(np.concatenate(fixed)))
u = skfem.solve(*system, solver=skfem.solver_iter_pcg(rtol=1e-10))

square = skfem.Functional(lambda w: (w["u"] - exact(w.x)) ** 2).assemble(whole, u=u)
norm = skfem.Functional(lambda w: exact(w.x) ** 2).assemble(whole)
print(
    json.dumps(
        {
            "error": float(np.sqrt(square / norm)),
            "vertices": int(mesh.p.shape[1]),
            "regions": regions,
            "boundaries": boundaries,
        }
    )
)
