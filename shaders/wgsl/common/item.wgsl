// A tree of atoms and nodes as items, children side by side. Sums are logarithms to base 2.

struct Item {
    // Atoms: offset from the centre of the block or cell (Å), and κ log2 e. Nodes: x is the power.
    at: vec4<f32>,
    // Atoms: κ r² log2 e.
    lift: f32,
    // Children, as items.
    first: u32,
    end: u32,
    // The node above; ROOT for the topmost.
    parent: u32,
}

const ROOT: u32 = 0xffffffffu;
// The logarithm of 0.
const NOTHING: f32 = -3.0e38;
