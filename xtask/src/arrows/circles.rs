//! Circles among the files of a crate: strongly connected components (Tarjan 1972) of their arrows.

use std::collections::BTreeSet;

use super::modules::Module;

/// Every set of files that reach each other, as a line for people. A module and those below it may name
/// each other: a child uses its parent's types.
pub(super) fn circles(modules: &[Module], arrows: &BTreeSet<(usize, usize)>) -> Vec<String> {
    let mut below = vec![Vec::new(); modules.len()];
    for &(from, to) in arrows {
        let (a, b) = (&modules[from].path, &modules[to].path);
        if !a.starts_with(b) && !b.starts_with(a) {
            below[from].push(to);
        }
    }
    let mut search = Search {
        below: &below,
        order: vec![None; modules.len()],
        low: vec![0; modules.len()],
        stack: Vec::new(),
        next: 0,
        components: Vec::new(),
    };
    for start in 0..modules.len() {
        if search.order[start].is_none() {
            search.visit(start);
        }
    }
    let circles = search.components.into_iter().filter(|c| c.len() > 1);
    circles
        .map(|mut circle| {
            circle.sort_unstable();
            let names: Vec<_> = circle.iter().map(|&m| modules[m].path.join("::")).collect();
            names.join(" ⇄ ")
        })
        .collect()
}

/// Tarjan's depth-first search.
struct Search<'a> {
    below: &'a [Vec<usize>],
    /// When each was met; none before.
    order: Vec<Option<usize>>,
    /// The earliest that each reaches.
    low: Vec<usize>,
    stack: Vec<usize>,
    next: usize,
    components: Vec<Vec<usize>>,
}

impl Search<'_> {
    fn visit(&mut self, v: usize) {
        self.order[v] = Some(self.next);
        self.low[v] = self.next;
        self.next += 1;
        self.stack.push(v);
        for &w in &self.below[v] {
            match self.order[w] {
                None => {
                    self.visit(w);
                    self.low[v] = self.low[v].min(self.low[w]);
                }
                Some(order) if self.stack.contains(&w) => self.low[v] = self.low[v].min(order),
                Some(_) => {}
            }
        }
        // The first of its component that was met: the component lies above it on the stack.
        if self.order[v] == Some(self.low[v]) {
            let from = self.stack.iter().rposition(|&w| w == v).unwrap_or_default();
            self.components.push(self.stack.split_off(from));
        }
    }
}
