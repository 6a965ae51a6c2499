// Measures of tetrahedra, one per thread: Joe–Liu, edge ratio, smallest and largest dihedral angle
// (degrees), and six volumes. Positions are pairs (high, low) of f32 whose sum is the f64 value, so
// that differences keep all digits.

@group(0) @binding(0) var<storage, read> positions: array<vec4<f32>>; // high, low per vertex
@group(0) @binding(1) var<storage, read> tets: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read_write> angles: array<vec4<f32>>; // joe-liu, ratio, min, max
@group(0) @binding(3) var<storage, read_write> volumes: array<f32>;

fn edge(a: u32, b: u32) -> vec3<f32> {
    let high = positions[2u * b].xyz - positions[2u * a].xyz;
    return high + (positions[2u * b + 1u].xyz - positions[2u * a + 1u].xyz);
}

// Dihedral angle between faces with outward normals n and m.
fn angle(n: vec3<f32>, m: vec3<f32>) -> f32 {
    return degrees(atan2(length(cross(n, m)), -dot(n, m)));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= arrayLength(&tets) { return; }
    let t = tets[i];
    let ab = edge(t.x, t.y);
    let ac = edge(t.x, t.z);
    let ad = edge(t.x, t.w);
    // In units of the longest of three edges: neither large nor small units overflow.
    let m = max(max(abs(ab), abs(ac)), abs(ad));
    let reach = max(m.x, max(m.y, m.z));
    let scale = select(1.0, reach, reach > 0.0);
    let b = ab / scale;
    let c = ac / scale;
    let d = ad / scale;
    let bc = c - b;
    let bd = d - b;
    let cd = d - c;
    let v6 = dot(cross(b, c), d);
    let e = array<f32, 6>(dot(b, b), dot(c, c), dot(d, d), dot(bc, bc), dot(bd, bd), dot(cd, cd));
    let longest = max(max(max(e[0], e[1]), max(e[2], e[3])), max(e[4], e[5]));
    let shortest = min(min(min(e[0], e[1]), min(e[2], e[3])), min(e[4], e[5]));
    let sum = e[0] + e[1] + e[2] + e[3] + e[4] + e[5];
    var joe_liu = 0.0;
    if sum > 0.0 { joe_liu = 20.78460969 * v6 / (sum * sqrt(sum)); }
    var ratio = 3.0e38;
    if shortest > 0.0 { ratio = sqrt(longest / shortest); }
    var low = 0.0;
    var high = 180.0;
    if v6 > 0.0 {
        let na = cross(bc, bd);
        let nb = cross(d, c);
        let nc = cross(b, d);
        let nd = cross(c, b);
        let s = array<f32, 6>(angle(na, nb), angle(na, nc), angle(na, nd), angle(nb, nc), angle(nb, nd), angle(nc, nd));
        low = min(min(min(s[0], s[1]), min(s[2], s[3])), min(s[4], s[5]));
        high = max(max(max(s[0], s[1]), max(s[2], s[3])), max(s[4], s[5]));
    }
    angles[i] = vec4<f32>(joe_liu, ratio, low, high);
    volumes[i] = v6 * scale * scale * scale;
}
