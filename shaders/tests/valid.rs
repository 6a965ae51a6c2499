//! Every kernel is valid WGSL, and says of itself what its source says.

use std::collections::BTreeSet;

use geom_shaders::ALL;
use naga::valid::{Capabilities, ValidationFlags, Validator};

#[test]
fn every_kernel_parses_and_validates() {
    for shader in ALL {
        let module = naga::front::wgsl::parse_str(shader.source)
            .unwrap_or_else(|e| panic!("{}: {}", shader.name, e.emit_to_string(shader.source)));
        Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{}: {}", shader.name, e.emit_to_string(shader.source)));
        let entries: Vec<_> = module
            .entry_points
            .iter()
            .map(|e| (e.name.as_str(), e.workgroup_size))
            .collect();
        assert_eq!(entries, [("main", shader.workgroup)], "{}", shader.name);
    }
}

#[test]
fn kernels_need_no_more_than_every_device_grants() {
    for shader in ALL {
        assert!(
            shader.workgroup.iter().product::<u32>() <= 256,
            "{}",
            shader.name
        );
        let module = naga::front::wgsl::parse_str(shader.source).expect("parses");
        let storage = module
            .global_variables
            .iter()
            .filter(|(_, v)| matches!(v.space, naga::AddressSpace::Storage { .. }))
            .count();
        assert!(storage <= 8, "{}: {storage} storage buffers", shader.name);
    }
}

fn name(path: &std::path::Path) -> String {
    path.file_stem()
        .expect("a name")
        .to_string_lossy()
        .into_owned()
}

#[test]
fn names_are_unique_and_every_source_file_is_listed() {
    let names: BTreeSet<_> = ALL.iter().map(|s| s.name).collect();
    assert_eq!(names.len(), ALL.len());
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("wgsl");
    let mut files = BTreeSet::new();
    for folder in std::fs::read_dir(root).expect("the folder of the sources") {
        let folder = folder.expect("an entry").path();
        let of = name(&folder);
        for file in std::fs::read_dir(folder).expect("one folder per crate") {
            let path = file.expect("an entry").path();
            if of == "common" {
                let shared = std::fs::read_to_string(&path).expect("text");
                let users = ALL.iter().filter(|s| s.source.contains(&shared)).count();
                assert!(users > 1, "{}: shared by {users} kernels", path.display());
            } else {
                files.insert(format!("{of}_{}", name(&path)));
            }
        }
    }
    let listed: BTreeSet<String> = names.iter().map(|&n| n.to_owned()).collect();
    assert_eq!(files, listed);
}

/// The checks above can fail.
#[test]
fn a_wrong_kernel_is_caught() {
    let wrong = "@compute @workgroup_size(64) fn main() { let x: u32 = 1.5; }";
    assert!(naga::front::wgsl::parse_str(wrong).is_err());
}
