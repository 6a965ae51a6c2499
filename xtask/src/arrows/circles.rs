//! Circles among the files of a crate: strongly connected components (Tarjan 1972) of their arrows.

use std::collections::BTreeSet;

use super::modules::Module;

/// Every set of files that reach each other, as a line for people. A module and those below it may name
/// each other: a child uses its parent's types. What a parent takes from its child counts, since through the child a circle
/// may come back from outside.
pub(super) fn circles(modules: &[Module], arrows: &BTreeSet<(usize, usize)>) -> Vec<String> {
    let mut below = vec![Vec::new(); modules.len()];
    for &(from, to) in arrows {
        let (a, b) = (&modules[from].path, &modules[to].path);
        if !a.starts_with(b) {
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

#[cfg(test)]
mod tests {
    use super::super::modules;
    use super::*;

    /// The circles of a crate of these files.
    fn circles_of(files: &[(&str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        let modules = modules::read(folder.path()).unwrap();
        circles(&modules, &modules::arrows(&modules))
    }

    #[test]
    fn a_circle_is_found_through_re_exports_and_paths() {
        let root = (
            "lib.rs",
            "mod a; mod b; mod c; pub use b::{self as other, B};",
        );
        // a names b by a re-export of the root, b names c in its body, c names a in a type.
        let found = circles_of(&[
            root,
            ("a.rs", "use crate::B; pub struct A;"),
            ("b/mod.rs", "pub struct B; fn f() { super::c::g(); }"),
            ("c.rs", "pub fn g() {} fn h(a: &crate::a::A) {}"),
        ]);
        assert_eq!(found, ["a ⇄ b ⇄ c"]);
        let open = circles_of(&[
            root,
            ("a.rs", "use crate::other::B; pub struct A;"),
            ("b.rs", "pub struct B; fn f() { super::c::g(); }"),
            (
                "c.rs",
                "pub fn g() {} #[cfg(test)] mod tests { use crate::a::A; }",
            ),
        ]);
        assert!(open.is_empty(), "tests do not count: {open:?}");
    }

    #[test]
    fn a_child_may_use_its_parents_types() {
        let found = circles_of(&[
            ("lib.rs", "mod a;"),
            ("a/mod.rs", "mod b; pub struct A; pub use b::B;"),
            ("a/b.rs", "use super::A; pub struct B(A);"),
        ]);
        assert!(found.is_empty(), "{found:?}");
    }

    #[test]
    fn a_circle_is_found_that_goes_through_a_child() {
        let found = circles_of(&[
            ("lib.rs", "mod a; mod b;"),
            ("a/mod.rs", "mod c; use c::C; pub struct A(C);"),
            ("a/c.rs", "use super::super::b::f; pub struct C;"),
            ("b.rs", "use super::a::A; pub fn f() {}"),
        ]);
        assert_eq!(found, ["a ⇄ a::c ⇄ b"]);
    }
}
