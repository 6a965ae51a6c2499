# Opens the structure and the surface around it in PyMOL:  pymol view.pml
python
import json, os, struct
from pymol import cgo, cmd

here = os.path.dirname(os.path.abspath(__script__))

def surface(name):
    """The coloured triangles of NAME.glb (binary glTF 2.0) as an object of PyMOL."""
    with open(os.path.join(here, name + ".glb"), "rb") as file:
        data = file.read()
    length = struct.unpack_from("<I", data, 12)[0]
    gltf = json.loads(data[20:20 + length])
    start = 20 + length + 8
    letters = {5121: "B", 5123: "H", 5125: "I", 5126: "f"}
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}

    def array(number):
        accessor = gltf["accessors"][number]
        view = gltf["bufferViews"][accessor["bufferView"]]
        letter, wide = letters[accessor["componentType"]], width[accessor["type"]]
        step = view.get("byteStride", wide * struct.calcsize(letter))
        first = start + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        rows = [struct.unpack_from("<%d%s" % (wide, letter), data, first + i * step) for i in range(accessor["count"])]
        return [[v / 255.0 for v in row] for row in rows] if letter == "B" else rows

    parts = gltf["meshes"][0]["primitives"][0]
    places = array(parts["attributes"]["POSITION"])
    normals = array(parts["attributes"]["NORMAL"])
    colors = array(parts["attributes"]["COLOR_0"]) if "COLOR_0" in parts["attributes"] else None
    shape = [cgo.BEGIN, cgo.TRIANGLES]
    for (corner,) in array(parts["indices"]):
        if colors:
            shape += [cgo.COLOR, *colors[corner][:3]]
        shape += [cgo.NORMAL, *normals[corner], cgo.VERTEX, *places[corner]]
    shown = name if name == "surface" else name + "_surface"
    cmd.load_cgo(shape + [cgo.END], shown)
    cmd.set("cgo_transparency", 0.4, shown)

