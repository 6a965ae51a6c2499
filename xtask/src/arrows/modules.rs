//! The modules of a crate and which of them names which, read from the sources by `syn`.
//!
//! A path is followed through re-exports to the file that defines the item, so that `crate::Error` is an
//! arrow to `error.rs` and not to `lib.rs`. Tests do not count.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use syn::visit::Visit;
use syn::{Attribute, Item, UseTree, Visibility};

/// A module of a crate: a file, or a part of one.
pub(super) struct Module {
    pub(super) file: PathBuf,
    /// The names of the modules from the crate's root to this one.
    pub(super) path: Vec<String>,
    /// Its child modules by name.
    children: BTreeMap<String, usize>,
    /// What it brings into scope by `use`: the name, and the path as written.
    imports: Vec<(String, Vec<String>)>,
    /// Modules whose whole contents it brings into scope.
    globs: Vec<Vec<String>>,
    /// The items that it defines.
    items: BTreeSet<String>,
    /// Every path that starts at `crate`, `self` or `super`.
    named: Vec<Vec<String>>,
}

/// Reads the modules of a crate from its `lib.rs` on, parents before children.
pub(super) fn read(source: &Path) -> Result<Vec<Module>, String> {
    let mut modules = Vec::new();
    let file = source.join("lib.rs");
    let reader = read_file(&file)?;
    add(&file, source, Vec::new(), reader, &mut modules)?;
    Ok(modules)
}

/// What a file names and defines.
fn read_file(file: &Path) -> Result<Reader, String> {
    let text = std::fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
    let syntax = syn::parse_file(&text).map_err(|e| format!("{}: {e}", file.display()))?;
    let mut reader = Reader::default();
    reader.visit_file(&syntax);
    Ok(reader)
}

/// Adds a module and its children, whose files lie in `folder`; gives its number.
fn add(
    file: &Path,
    folder: &Path,
    path: Vec<String>,
    reader: Reader,
    modules: &mut Vec<Module>,
) -> Result<usize, String> {
    let number = modules.len();
    modules.push(Module {
        file: file.to_owned(),
        path: path.clone(),
        children: BTreeMap::new(),
        imports: reader.imports,
        globs: reader.globs,
        items: reader.items,
        named: reader.named,
    });
    let own = |name: &String| [&path[..], std::slice::from_ref(name)].concat();
    for (name, inline) in reader.inline {
        let child = add(file, &folder.join(&name), own(&name), inline, modules)?;
        modules[number].children.insert(name, child);
    }
    for name in reader.children {
        let flat = folder.join(format!("{name}.rs"));
        let below = folder.join(&name);
        let file = match flat.exists() {
            true => flat,
            false => below.join("mod.rs"),
        };
        let child = add(&file, &below, own(&name), read_file(&file)?, modules)?;
        modules[number].children.insert(name, child);
    }
    Ok(number)
}

/// Which file names an item of which other, both by number.
pub(super) fn arrows(modules: &[Module]) -> BTreeSet<(usize, usize)> {
    let mut arrows = BTreeSet::new();
    for (from, module) in modules.iter().enumerate() {
        let imports = module.imports.iter().map(|(_, path)| path);
        for path in imports.chain(&module.globs).chain(&module.named) {
            if let Some(to) = resolve(modules, from, path, 0).filter(|&to| to != from) {
                arrows.insert((from, to));
            }
        }
    }
    arrows
}

/// The module that defines what a path written in module `at` names; none outside of the crate.
fn resolve(modules: &[Module], at: usize, path: &[String], depth: usize) -> Option<usize> {
    // Re-exports of re-exports; a glob of a parent could go on for ever.
    if depth > 16 {
        return None;
    }
    let (first, rest) = path.split_first()?;
    match first.as_str() {
        "crate" => inside(modules, 0, rest, depth),
        "self" => inside(modules, at, rest, depth),
        "super" => {
            let above = modules[at].path.split_last()?.1;
            let parent = modules.iter().position(|m| m.path == above)?;
            match rest.first().map(String::as_str) {
                Some("super") => resolve(modules, parent, rest, depth + 1),
                _ => inside(modules, parent, rest, depth),
            }
        }
        // `use` may start at a module in scope.
        _ if modules[at].children.contains_key(first) => inside(modules, at, path, depth),
        _ => None,
    }
}

/// The module that defines what `path` names, seen from module `at`.
fn inside(modules: &[Module], at: usize, path: &[String], depth: usize) -> Option<usize> {
    let Some((first, rest)) = path.split_first() else {
        return Some(at);
    };
    let module = &modules[at];
    if let Some(&child) = module.children.get(first) {
        return inside(modules, child, rest, depth);
    }
    if module.items.contains(first) {
        return Some(at);
    }
    if let Some((_, from)) = module.imports.iter().find(|(name, _)| name == first) {
        let whole = [&from[..], rest].concat();
        return resolve(modules, at, &whole, depth + 1);
    }
    let mut globs = module.globs.iter();
    globs
        .find_map(|glob| {
            let from = resolve(modules, at, glob, depth + 1)?;
            let known = modules[from].items.contains(first)
                || modules[from].imports.iter().any(|(n, _)| n == first);
            known.then(|| inside(modules, from, path, depth + 1))
        })
        // A macro's product, or a method of an item: it lies where the path ends.
        .unwrap_or(Some(at))
}

/// Collects what a file names and defines.
#[derive(Default)]
struct Reader {
    /// Children in files of their own, and in this file.
    children: Vec<String>,
    inline: Vec<(String, Reader)>,
    imports: Vec<(String, Vec<String>)>,
    globs: Vec<Vec<String>>,
    items: BTreeSet<String>,
    named: Vec<Vec<String>>,
}

impl Reader {
    fn use_tree(&mut self, before: &[String], tree: &UseTree) {
        let with = |name: &dyn ToString| [before, &[name.to_string()]].concat();
        match tree {
            UseTree::Path(path) => self.use_tree(&with(&path.ident), &path.tree),
            UseTree::Group(group) => {
                for tree in &group.items {
                    self.use_tree(before, tree);
                }
            }
            UseTree::Glob(_) => self.globs.push(before.to_vec()),
            // `use a::{self}` brings in `a`.
            UseTree::Name(name) if name.ident == "self" => {
                self.imports
                    .extend(before.last().map(|n| (n.clone(), before.to_vec())));
            }
            UseTree::Name(name) => self
                .imports
                .push((name.ident.to_string(), with(&name.ident))),
            UseTree::Rename(rename) => {
                let path = match rename.ident == "self" {
                    true => before.to_vec(),
                    false => with(&rename.ident),
                };
                self.imports.push((rename.rename.to_string(), path));
            }
        }
    }
}

impl<'ast> Visit<'ast> for Reader {
    fn visit_item(&mut self, item: &'ast Item) {
        if attributes(item).iter().any(is_test) {
            return;
        }
        match item {
            Item::Mod(module) => match &module.content {
                None => self.children.push(module.ident.to_string()),
                Some((_, items)) => {
                    let mut reader = Self::default();
                    items.iter().for_each(|item| reader.visit_item(item));
                    self.inline.push((module.ident.to_string(), reader));
                }
            },
            _ => {
                self.items.extend(defined(item));
                syn::visit::visit_item(self, item);
            }
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.use_tree(&[], &item.tree);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names: Vec<_> = path.segments.iter().map(|s| s.ident.to_string()).collect();
        if names.len() > 1 && ["crate", "self", "super"].contains(&names[0].as_str()) {
            self.named.push(names);
        }
        syn::visit::visit_path(self, path);
    }

    fn visit_visibility(&mut self, _: &'ast Visibility) {
        // `pub(super)` and `pub(in crate::x)` are no arrows.
    }
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(i) => &i.attrs,
        Item::Enum(i) => &i.attrs,
        Item::Fn(i) => &i.attrs,
        Item::Impl(i) => &i.attrs,
        Item::Mod(i) => &i.attrs,
        Item::Static(i) => &i.attrs,
        Item::Struct(i) => &i.attrs,
        Item::Trait(i) => &i.attrs,
        Item::Type(i) => &i.attrs,
        Item::Use(i) => &i.attrs,
        _ => &[],
    }
}

/// Is it `#[cfg(test)]`?
fn is_test(attribute: &Attribute) -> bool {
    attribute.path().is_ident("cfg")
        && attribute
            .parse_args::<syn::Path>()
            .is_ok_and(|p| p.is_ident("test"))
}

/// The name that an item brings into being.
fn defined(item: &Item) -> Option<String> {
    let name = match item {
        Item::Const(i) => &i.ident,
        Item::Enum(i) => &i.ident,
        Item::Fn(i) => &i.sig.ident,
        Item::Static(i) => &i.ident,
        Item::Struct(i) => &i.ident,
        Item::Trait(i) => &i.ident,
        Item::Type(i) => &i.ident,
        Item::Union(i) => &i.ident,
        _ => return None,
    };
    Some(name.to_string())
}
