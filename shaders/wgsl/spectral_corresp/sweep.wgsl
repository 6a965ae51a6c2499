// A step of Jacobi's method for the distortion with a pull towards targets: how far each node moves. One thread per
// node.

@group(0) @binding(5) var<storage, read> rotations: array<vec4<f32>>; // three rows per node
@group(0) @binding(6) var<storage, read> targets: array<vec4<f32>>;   // from where the node is now; the pull
@group(0) @binding(7) var<storage, read_write> moves: array<vec4<f32>>;

fn turned(node: u32, e: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(rotations[3u * node].xyz, e),
        dot(rotations[3u * node + 1u].xyz, e),
        dot(rotations[3u * node + 2u].xyz, e),
    );
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= task.nodes { return; }
    let p = rest[i].xyz;
    let x = now[i].xyz;
    let first = starts[i];
    let end = starts[i + 1u];
    let to = targets[i].xyz;
    let pull = targets[i].w;
    if first == end {
        moves[i] = vec4<f32>(select(vec3<f32>(), to, pull > 0.0), 0.0);
        return;
    }
    var sum = vec3<f32>();
    var edges = vec3<f32>();
    for (var at = first; at < end; at += 1u) {
        let j = others[at];
        let e = p - rest[j].xyz;
        sum += (now[j].xyz - x) + 0.5 * turned(j, e);
        edges += e;
    }
    let own = (sum + 0.5 * turned(i, edges)) / f32(end - first);
    moves[i] = vec4<f32>((own + to * pull) / (1.0 + pull), 0.0);
}
