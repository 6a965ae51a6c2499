// The tree that a kernel reads.

@group(0) @binding(1) var<storage, read> items: array<Item>;
