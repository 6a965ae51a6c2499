"""A mesh in parts as VTK and Gmsh read it: tiles.py FOLDER, the outputs of 20_tiles.

Prints one line of JSON: an object for the PVTU file and one for the parts of MSH together."""
import json
import os
import sys
from pathlib import Path

import gmsh
import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

FACES = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]


def told(ids, place, tets, regions, counts, atoms):
    """What both must agree on. Corners are numbers of the whole; a vertex is told once per part that has it."""
    order = np.argsort(ids, kind="stable")
    ids, place, atoms = ids[order], place[order], atoms[order]
    first = np.flatnonzero(np.r_[True, ids[1:] != ids[:-1]])
    known = ids[first]
    of = np.searchsorted(known, ids)
    # Copies of a vertex lie in one place, near one atom.
    apart = int((place[first][of] != place).any(axis=1).sum())
    apart += int((atoms[first][of] != atoms).sum())
    place = place[first]
    corners = place[np.searchsorted(known, tets)]
    a, b, c, d = (corners[:, k] for k in range(4))
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
    faces = np.sort(tets[:, FACES].reshape(-1, 3), axis=1)
    _, uses = np.unique(faces, axis=0, return_counts=True)
    return {
        "vertices": len(known),
        "copies that differ": apart,
        "tetrahedra": len(tets),
        "distinct tetrahedra": len(np.unique(np.sort(tets, axis=1), axis=0)),
        "boundary faces": int((uses == 1).sum()),
        "faces of three": int((uses > 2).sum()),
        "volumes": {str(r): float(volumes[regions == r].sum()) for r in np.unique(regions)},
        "groups": counts,
        "atoms": int(((known + 1) * atoms[first]).sum()),
    }


def pvtu(file):
    reader = vtk.vtkXMLPUnstructuredGridReader()
    reader.SetFileName(str(file))
    reader.Update()
    grid = reader.GetOutput()
    point = lambda name: vtk_to_numpy(grid.GetPointData().GetArray(name))
    cell = lambda name: vtk_to_numpy(grid.GetCellData().GetArray(name))
    ids, own = point("GlobalNodeIds"), cell("vtkGhostType") == 0
    kinds = np.array([grid.GetCellType(c) for c in range(grid.GetNumberOfCells())])
    starts = vtk_to_numpy(grid.GetCells().GetOffsetsArray())[:-1]
    corners = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
    is_tet = (kinds == vtk.VTK_TETRA) & own
    tets = ids[corners[starts[is_tet][:, None] + np.arange(4)]]
    counts = {}
    for i in range(grid.GetFieldData().GetNumberOfArrays()):
        array = grid.GetFieldData().GetArray(i)
        tag, dimension = (int(v) for v in vtk_to_numpy(array))
        of = own & (cell("group") == tag) & ((kinds == vtk.VTK_TETRA) == (dimension == 3))
        counts[array.GetName()] = int(of.sum())
    place = vtk_to_numpy(grid.GetPoints().GetData())
    result = told(ids, place, tets, cell("region")[is_tet], counts, point("atom"))
    # Each vertex is owned by one part.
    owned = np.bincount(ids, point("vtkGhostType") == 0)
    result["vertices without one owner"] = int((owned != 1).sum())
    return result


def misplaced(files):
    """Ghosts of parts that are not in the layer they should be, or whose owner is another; those that are missing, too."""
    parts = []
    for file in files:
        reader = vtk.vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(file))
        reader.Update()
        grid = reader.GetOutput()
        if grid.GetNumberOfCells() == 0:
            empty = np.zeros(0, int)
            parts.append((np.zeros((0, 4), int), empty, empty, empty))
            continue
        cell = lambda name: vtk_to_numpy(grid.GetCellData().GetArray(name)).astype(int)
        ids = vtk_to_numpy(grid.GetPointData().GetArray("GlobalNodeIds"))
        kinds = np.array([grid.GetCellType(c) for c in range(grid.GetNumberOfCells())])
        starts = vtk_to_numpy(grid.GetCells().GetOffsetsArray())[:-1]
        corners = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
        is_tet = kinds == vtk.VTK_TETRA
        tets = np.sort(ids[corners[starts[is_tet][:, None] + np.arange(4)]], axis=1)
        parts.append((tets, cell("vtkGhostType")[is_tet], cell("layer")[is_tet], cell("owner")[is_tet]))
    own = [tets[ghost == 0] for tets, ghost, _, _ in parts]
    everything = np.concatenate(own)
    owner = np.repeat(np.arange(len(own)), [len(o) for o in own])
    wrong = 0
    for number, (tets, _, layer, told) in enumerate(parts):
        near = np.zeros(everything.max() + 1, bool)
        near[own[number]] = True
        expected = {(*t, 0, number) for t in own[number].tolist()}
        taken = owner == number
        for step in (1, 2) if len(own[number]) else ():
            new = near[everything].any(axis=1) & ~taken
            expected |= {(*t, step, o) for t, o in zip(everything[new].tolist(), owner[new].tolist())}
            taken |= new
            near[everything[new]] = True
        found = {(*t, l, o) for t, l, o in zip(tets.tolist(), layer.tolist(), told.tolist())}
        wrong += len(found ^ expected)
    return wrong


def msh(files):
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 1)
    ids, place, atoms, tets, regions, counts, seen = [], [], [], [], [], {}, set()
    ghosts, named = 0, set()
    for file in files:
        gmsh.clear()
        gmsh.merge(str(file))
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        if len(tags) == 0:
            continue
        ids.append(tags.astype(np.int64) - 1)
        place.append(xyz.reshape(-1, 3))
        names = [gmsh.option.getString(f"View[{i}].Name") for i in range(len(gmsh.view.getTags()))]
        view = gmsh.view.getTags()[names.index("atom")]
        _, of, data, _, _ = gmsh.view.getModelData(view, 0)
        values = dict(zip(of.tolist(), (d[0] for d in data)))
        atoms.append(np.array([values[int(t)] for t in tags]).astype(np.int64))
        for dimension, entity in gmsh.model.getEntities():
            if dimension < 2:
                continue
            kind = gmsh.model.getType(dimension, entity)
            _, elements, nodes = gmsh.model.mesh.getElements(dimension, entity)
            if kind.startswith("Ghost"):
                # Ghosts are named by tags that their owners use.
                ghosts += sum(map(len, elements))
                named.update(t for e in elements for t in e.tolist())
            if not kind.startswith("Partition"):
                continue
            physical = gmsh.model.getPhysicalGroupsForEntity(dimension, entity)[0]
            name = gmsh.model.getPhysicalName(dimension, physical)
            assert gmsh.model.getParent(dimension, entity) == (dimension, physical)
            assert len(gmsh.model.getPartitions(dimension, entity)) == 1
            for tags, corners in zip(elements, nodes):
                counts[name] = counts.get(name, 0) + len(tags)
                assert seen.isdisjoint(tags.tolist()), "a tag twice"
                seen.update(tags.tolist())
                if dimension == 3:
                    corners = corners.astype(np.int64).reshape(-1, 4) - 1
                    tets.append(corners)
                    regions.append(np.full(len(corners), {"exterior": 0, "molecule": 1}[name]))
    # All parts at once, as somebody would open them.
    gmsh.clear()
    for file in files:
        # Gmsh to 4.15 looks for ghosts in a table of the file before, and does not find them, unless that is cleared away.
        gmsh.model.mesh.removeDuplicateElements()
        gmsh.merge(str(file))
    together = sum(
        len(e)
        for d, t in gmsh.model.getEntities(3)
        if gmsh.model.getType(d, t).startswith("Partition")
        for e in gmsh.model.mesh.getElements(d, t)[1]
    )
    ids, atoms = np.concatenate(ids), np.concatenate(atoms)
    place, tets, regions = map(np.concatenate, (place, tets, regions))
    result = told(ids, place, tets, regions, counts, atoms)
    result["ghosts of nobody"] = len(named - seen)
    result["ghosts"] = ghosts
    result["opened together"] = together
    return result


folder = Path(sys.argv[1])
parts = sorted((folder / "parts").glob("volume_*.msh"), key=lambda p: int(p.stem.split("_")[1]))
pieces = sorted((folder / "parts").glob("part_*.vtu"), key=lambda p: int(p.stem.split("_")[1]))
both = {"pvtu": pvtu(folder / "volume.pvtu"), "msh": msh(parts), "misplaced": misplaced(pieces)}
print(json.dumps(both), flush=True)
# Gmsh falls over its own feet when it forgets parts that have been opened together, its own as well.
os._exit(0)
