"""Atoms by gemmi and biotite: structures.py TASK..., each four words: FILE locations all|one TABLE, or FILE assembly NAME
TABLE.

TABLE holds our atoms: chain, residue's number, insertion code and name, atom's name and element, x, y, z.
Prints one line of JSON, per task an object per reader with counts, and how far the farthest atom of one is from those of
the other with the same names; or why the reader refuses the file."""

import gzip
import io
import json
import sys
import warnings

import biotite
import biotite.structure as struc
import biotite.structure.io.pdb as pdb
import biotite.structure.io.pdbx as pdbx
import gemmi
import numpy as np
from scipy.spatial import cKDTree

warnings.simplefilter("ignore")


# An element that was not read.
ANY = "*"


# Dummy atoms mark the planes of a membrane; ours keeps their number.
DUMMY = "DUM"


class Refused(Exception):
    """A reader does not find what the file has."""


def ours(table):
    names, places = [], []
    with open(table) as file:
        for line in file:
            *name, x, y, z = line.rstrip("\n").split("\t")
            names.append("|".join(name))
            places.append((float(x), float(y), float(z)))
    return names, np.array(places).reshape(-1, 3)


def apart(mine, theirs):
    """The farthest from its namesake in either direction, Å; a name that the other lacks is far away."""
    (names_a, a), (names_b, b) = mine, theirs
    number = {name: 1e6 * k for k, name in enumerate(sorted(set(names_a) | set(names_b)))}
    a, b = (
        np.column_stack([p, [number[n] for n in names]])
        for names, p in ((names_a, a), (names_b, b))
    )
    worst, example = 0.0, ""
    for names, p, q in ((names_a, a, b), (names_b, b, a)):
        if len(p) == 0 or len(q) == 0:
            return {"apart": 0.0 if len(p) == len(q) else 1e300, "example": "no atoms at all"}
        d, _ = cKDTree(q).query(p)
        k = int(np.argmax(d))
        if d[k] > worst:
            worst, example = float(d[k]), f"{names[k]} at {p[k, :3].tolist()}"
    return {"apart": worst, "example": example}


def by_gemmi(path, kind, asked):
    # Names are compared as they stand, so parts of a chain are one chain.
    entry = gemmi.read_structure(path, merge_chain_parts=True)
    model = entry[0]
    answer = {}
    if kind == "assembly":
        assembly = next((a for a in entry.assemblies if a.name == asked), None)
        if assembly is None:
            raise Refused("finds no assembly of this name")
        # By exact content: generators may use the same operator.
        copies = {
            tuple(np.round(np.array(o.transform.mat.tolist() + [o.transform.vec.tolist()]), 9).ravel() + 0.0)
            for g in assembly.generators
            for o in g.operators
        }
        answer["copies"] = len(copies)
        model = gemmi.make_assembly(assembly, model, gemmi.HowToNameCopiedChain.Dup)
    if asked == "one" and kind == "locations":
        # It keeps the first of the locations, so only their number is compared.
        entry.remove_alternative_conformations()
        return {"atoms": sum(len(r) for c in entry[0] for r in c if r.name != DUMMY)}, None
    names, places = [], []
    answer["dummies"] = sum(len(r) for c in model for r in c if r.name == DUMMY)
    for chain in model:
        for residue in chain:
            for atom in residue if residue.name != DUMMY else ():
                code = residue.seqid.icode.strip()
                words = (chain.name, residue.seqid.num, code, residue.name, atom.name)
                element = "H" if atom.element.name == "D" else atom.element.name.upper()
                names.append("|".join([*map(str, words), element]))
                places.append(atom.pos.tolist())
    answer["atoms"] = len(names)
    answer["chains"] = len({c.name for c in model if any(r.name != DUMMY for r in c)})
    if kind == "locations":
        answer["models"] = len(entry)
        # It passes over tables of assemblies without the column of methods.
        if entry.assemblies:
            answer["assemblies"] = len(entry.assemblies)
    return answer, (names, np.array(places).reshape(-1, 3))


def by_biotite(path, kind, asked):
    is_cif = ".cif" in path
    with (gzip.open if path.endswith(".gz") else open)(path, "rt") as raw:
        content = io.StringIO(raw.read())
    file = (pdbx.CIFFile if is_cif else pdb.PDBFile).read(content)
    from_file = pdbx if is_cif else pdb
    answer = {}
    if kind == "assembly":
        atoms = from_file.get_assembly(file, asked, model=1, altloc="all")
        answer["copies"] = len(np.unique(atoms.sym_id))
    else:
        altloc = "all" if asked == "all" else "occupancy"
        atoms = from_file.get_structure(file, model=1, altloc=altloc)
        answer["models"] = from_file.get_model_count(file)
        try:
            answer["assemblies"] = len(from_file.list_assemblies(file))
        except biotite.InvalidFileError:
            answer["assemblies"] = 0
    answer["dummies"] = int((atoms.res_name == DUMMY).sum())
    atoms = atoms[atoms.res_name != DUMMY]
    # Where old files have the entry's name instead of elements, it takes that.
    elements = atoms.element if all(map(str.isalpha, atoms.element)) else [ANY] * len(atoms)
    names = [
        f"{c}|{n}|{i.strip()}|{r}|{a}|{'H' if e == 'D' else e}"
        for c, n, i, r, a, e in zip(
            atoms.chain_id, atoms.res_id, atoms.ins_code, atoms.res_name, atoms.atom_name, elements
        )
    ]
    answer["atoms"] = len(names)
    answer["chains"] = len(set(atoms.chain_id))
    return answer, (names, atoms.coord.astype(float))


def told(reader, path, kind, asked, table):
    try:
        answer, atoms = reader(path, kind, asked)
    except (ValueError, RuntimeError, Refused, biotite.InvalidFileError, struc.BadStructureError) as error:
        return {"refused": f"{type(error).__name__}: {error}"}
    if atoms is None:
        return answer
    mine, places = ours(table)
    if atoms[0] and atoms[0][0].endswith(ANY):
        mine = [name[: name.rindex("|") + 1] + ANY for name in mine]
        answer["elements"] = "not read"
    return answer | apart((mine, places), atoms)


words = sys.argv[1:]
tasks = [words[k : k + 4] for k in range(0, len(words), 4)]
print(json.dumps([{"gemmi": told(by_gemmi, *t), "biotite": told(by_biotite, *t)} for t in tasks]))
