//! Names and numbers of the parts of a volume and of its boundary, as a file had them, for what becomes of it.

use super::{AnyMesh, MeshFile};
use crate::compute::parallel;
use crate::io::view::{Group, NO_GROUP, View};
use crate::mesh::{Region, sorted};
use crate::search::bvh::TriangleTree;
use crate::{Point3, TetMesh, TriMesh};

/// The groups of a file of tetrahedra: materials by region, patches of the boundary and of interfaces by place.
///
/// ```no_run
/// use geom_core::io::mesh::{self, AnyMesh, VolumeGroups};
/// let file = mesh::read("steel_in_air.msh")?;
/// let groups = VolumeGroups::of(&file);
/// if let AnyMesh::Tet(volume) = file.mesh {
///     // … improve it …
///     mesh::save("better.msh", &groups.view(&volume))?;
/// }
/// # Ok::<(), geom_core::io::Error>(())
/// ```
///
/// A region has the group of the first of its tetrahedra that has one. Patches are kept as triangles in a tree, since
/// vertices have other numbers, or are gone, when the mesh comes back.
pub struct VolumeGroups {
    regions: Vec<(Region, Group)>,
    patches: Option<Patches>,
}

/// The faces that part regions, or bound them, in the file's mesh.
struct Patches {
    /// Over all interfaces of the file's mesh, named or not, so that a face near an unnamed one gets no name.
    tree: TriangleTree,
    /// The group of each; [`NO_GROUP`] where the file names none.
    group_of: Vec<u32>,
    groups: Vec<Group>,
}

impl VolumeGroups {
    /// Those of a file; none if it holds no tetrahedra or names no groups.
    ///
    /// O(n log n) for the faces. A region whose tetrahedra are in several groups keeps the first one.
    pub fn of(file: &MeshFile) -> Self {
        let AnyMesh::Tet(mesh) = &file.mesh else {
            return Self {
                regions: Vec::new(),
                patches: None,
            };
        };
        let mut regions: Vec<(Region, Group)> = Vec::new();
        let mut seen = [false; 256];
        for (&region, &group) in mesh.regions().iter().zip(&file.group_of) {
            let seen = &mut seen[usize::from(region)];
            if let (Some(group), false) = (file.groups.get(group as usize), *seen) {
                regions.push((region, group.clone()));
                *seen = true;
            }
        }
        Self {
            regions,
            patches: Patches::of(file, mesh),
        }
    }

    /// A mesh with the file's names and numbers for its regions, and for the faces that lie where the file's patches
    /// did: each face has the group of the nearest one of the file's. What the file names not has the names of
    /// [`View::of_tets`]. The borders of patches are kept exactly where the mesh has kept them, as at creases; within
    /// a plane they follow its edges.
    ///
    /// Nearest is measured from the middle of a face to the file's faces. One lookup per face, in parallel.
    pub fn view<'a>(&self, mesh: &'a TetMesh) -> View<'a> {
        let names: Vec<(Region, &str)> = self
            .regions
            .iter()
            .map(|(region, group)| (*region, group.name.as_str()))
            .collect();
        let mut view = View::of_tets(mesh, &names);
        let mut all = Numbered::default();
        // Each of the few groups is looked up once, not once per cell; the file's first, so that their tags stay.
        let mut of_region: [Option<u32>; 256] = [None; 256];
        for (region, group) in &self.regions {
            of_region[usize::from(*region)] = Some(all.number(group));
        }
        let of_tets = mesh.regions().iter().map(|&r| of_region[usize::from(r)]);
        let of_faces = match &self.patches {
            Some(patches) => patches.nearest(&view, &mut all),
            None => vec![None; view.cells() - mesh.tets().len()],
        };
        let ours: Vec<u32> = view.groups.iter().map(|g| all.number(g)).collect();
        let given = of_tets.chain(of_faces).zip(view.group_of.iter());
        let mut group_of: Vec<u32> = given
            .map(|(given, &own)| given.unwrap_or(ours[own as usize]))
            .collect();
        view.groups = all.used(&mut group_of);
        view.group_of = group_of.into();
        view
    }
}

/// Groups without a double.
#[derive(Default)]
struct Numbered(Vec<Group>);

impl Numbered {
    /// Two of one name and dimension are one, whose tag is that of the first.
    fn number(&mut self, group: &Group) -> u32 {
        let same = |g: &Group| g.name == group.name && g.dimension == group.dimension;
        let known = self.0.iter().position(same);
        known.unwrap_or_else(|| {
            self.0.push(group.clone());
            self.0.len() - 1
        }) as u32
    }

    /// Those that occur, renumbered.
    fn used(self, group_of: &mut [u32]) -> Vec<Group> {
        let mut number = vec![NO_GROUP; self.0.len()];
        group_of.iter().for_each(|&g| number[g as usize] = 0);
        let mut kept = Vec::new();
        for (number, group) in number.iter_mut().zip(self.0) {
            if *number == 0 {
                *number = kept.len() as u32;
                kept.push(group);
            }
        }
        group_of.iter_mut().for_each(|g| *g = number[*g as usize]);
        kept
    }
}

impl Patches {
    fn of(file: &MeshFile, mesh: &TetMesh) -> Option<Self> {
        let mut named: Vec<([u32; 3], u32)> = file
            .faces
            .iter()
            .filter(|face| face.1 != NO_GROUP)
            .map(|&(corners, group)| (sorted(corners), group))
            .collect();
        if named.is_empty() {
            return None;
        }
        named.sort_unstable();
        let triangles: Vec<[u32; 3]> = mesh.interfaces().iter().map(|face| face.triangle).collect();
        let group = |&corners: &[u32; 3]| {
            let found = named.binary_search_by_key(&sorted(corners), |n| n.0);
            found.map_or(NO_GROUP, |at| named[at].1)
        };
        let group_of = triangles.iter().map(group).collect();
        let faces = TriMesh::new(mesh.positions().to_vec(), triangles);
        let faces = faces.expect("the faces of a valid mesh are valid");
        Some(Self {
            // Without faces no patch is near to anything.
            tree: TriangleTree::new(&faces).ok()?,
            group_of,
            groups: file.groups.clone(),
        })
    }

    /// The group of the patch nearest to each face of a view, if that has one.
    ///
    /// `None` where that patch has no name in the file.
    fn nearest(&self, view: &View<'_>, all: &mut Numbered) -> Vec<Option<u32>> {
        let number: Vec<u32> = self.groups.iter().map(|g| all.number(g)).collect();
        let group = |&[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| view.points[v as usize].coords);
            let nearest = self.tree.closest(&Point3::from((a + b + c) / 3.0));
            let group = self.group_of[nearest.triangle as usize];
            number.get(group as usize).copied()
        };
        parallel::map_each(&view.triangles(), group)
    }
}
