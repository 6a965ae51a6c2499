// Weights of a voxel graph times a block, added to another: out += scale · W x, four columns of a node
// per thread. Neighbours are looked up through the lattice.

struct Neighbour { offset: i32, weight: f32 }
struct Parameters { nodes: u32, quads: u32, first: u32, scale: f32 } // first: row of node 0

@group(0) @binding(0) var<storage, read> places: array<u32>; // of each node in the lattice
@group(0) @binding(1) var<storage, read> node_at: array<u32>; // of each place, or NONE
@group(0) @binding(2) var<storage, read> stencil: array<Neighbour>;
@group(0) @binding(3) var<storage, read> x: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> out: array<vec4<f32>>;
@group(0) @binding(5) var<uniform> p: Parameters;

const NONE: u32 = 0xffffffffu;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= p.nodes * p.quads { return; }
    let node = i / p.quads;
    let quad = i % p.quads;
    let place = i32(places[node]);
    var sum = vec4<f32>();
    for (var s = 0u; s < arrayLength(&stencil); s += 1u) {
        let other = node_at[place + stencil[s].offset];
        if other != NONE {
            sum += stencil[s].weight * x[(p.first + other) * p.quads + quad];
        }
    }
    let at = (p.first + node) * p.quads + quad;
    out[at] += p.scale * sum;
}
