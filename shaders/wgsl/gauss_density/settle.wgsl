// The atoms of a trial take their places in the trees of the cells, a thread per atom of a cell.

struct Slot {
    item: u32,
    first: u32,
    end: u32,
    pad0: u32,
}

// High parts of the place and the decay, low parts and the lift.
struct Atom {
    high: vec4<f32>,
    low: vec4<f32>,
}

struct Centre {
    high: vec4<f32>,
    low: vec4<f32>,
}

@group(0) @binding(1) var<storage, read_write> items: array<Item>;
@group(0) @binding(2) var<storage, read> slots: array<Slot>;
// Atom and cell of each slot.
@group(0) @binding(3) var<storage, read> homes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> centres: array<Centre>;
@group(0) @binding(5) var<storage, read> atoms: array<Atom>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.count { return; }
    let home = homes[id.x];
    let atom = atoms[home.x];
    let centre = centres[home.y];
    let at = (atom.high.xyz - centre.high.xyz) + (atom.low.xyz - centre.low.xyz);
    let item = slots[id.x].item;
    items[item].at = vec4<f32>(at, atom.high.w);
    items[item].lift = atom.low.w;
}
