//! STEP (ISO 10303-214): one B-spline face per patch, with edges and vertices that neighbours share, so that CAD programs
//! see a shell: a closed one, and a solid, where the surface has no boundary.
//!
//! CAD has no unit for Å: one millimetre stands for one Å.
//!
//! A patch becomes a `B_SPLINE_SURFACE_WITH_KNOTS` of one piece, with its Bézier points as poles and knots 0 and 1,
//! four times each; with weights it is a rational one. The curve of an edge is the part of the side that its segment
//! covers, as one patch has it. What stands around the geometry (units, contexts, a product with a name) is what the
//! schema asks for of a part. Files have no date, so that the same surface gives the same bytes.

use std::collections::BTreeMap;
use std::io::{self, Write};

use geom_core::compute::sets::DisjointSets;

use crate::Surface;
use crate::surface::PatchPoints;
use crate::surface::seams::{Seams, Side};

/// Writes a surface.
///
/// Of the name characters that STEP texts would have to escape are left out. One closed part becomes a solid; several
/// parts, or open ones, a model of shells, since nothing says which lies within which.
///
/// # Errors
/// Those of `out`.
pub fn write(out: &mut dyn Write, surface: &Surface, name: &str) -> io::Result<()> {
    let name: String = name
        .chars()
        .filter(|c| c.is_ascii() && !"'\\\n\r".contains(*c))
        .collect();
    let seams = Seams::of(surface);
    let mut file = File {
        out,
        last: 0,
        rational: surface.extraction().is_rational(),
    };
    file.text(&format!(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('spline surface; 1 mm stands for 1 Angstrom'),'2;1');\n\
         FILE_NAME('{name}','1970-01-01T00:00:00',(''),(''),'biogeom tspline','biogeom tspline','');\n\
         FILE_SCHEMA(('AUTOMOTIVE_DESIGN {{ 1 0 10303 214 1 1 1 1 }}'));\nENDSEC;\nDATA;\n"
    ))?;
    let mut vertices = Vec::with_capacity(seams.corners.len());
    for p in seams.positions(surface) {
        let point = file.point([p.x, p.y, p.z])?;
        vertices.push(file.add(&format!("VERTEX_POINT('',#{point})"))?);
    }
    let mut edges = Vec::with_capacity(seams.segments.len());
    for segment in &seams.segments {
        let points = curve(
            &surface.patches()[segment.owner.patch as usize],
            &segment.owner,
        );
        let curve = file.curve(&points)?;
        let [a, b] = segment.ends.map(|v| vertices[v as usize]);
        edges.push(file.add(&format!("EDGE_CURVE('',#{a},#{b},#{curve},.T.)"))?);
    }
    let mut faces = Vec::with_capacity(surface.patches().len());
    for (patch, points) in surface.patches().iter().enumerate() {
        let mut around = Vec::new();
        for side in 0..4 {
            for &(edge, forward) in seams.side(patch, side) {
                let (edge, sense) = (edges[edge as usize], if forward { 'T' } else { 'F' });
                around.push(file.add(&format!("ORIENTED_EDGE('',*,*,#{edge},.{sense}.)"))?);
            }
        }
        let around = file.add(&format!("EDGE_LOOP('',({}))", references(&around)))?;
        let bound = file.add(&format!("FACE_OUTER_BOUND('',#{around},.T.)"))?;
        let shape = file.surface(points)?;
        faces.push(file.add(&format!("ADVANCED_FACE('',(#{bound}),#{shape},.T.)"))?);
    }
    file.product(&name, &shells(&faces, &seams))?;
    file.text("ENDSEC;\nEND-ISO-10303-21;\n")
}

/// The faces of each connected part, by its first one, and whether it is closed.
/// Parts hang together over segments of two patches.
fn shells(faces: &[u32], seams: &Seams) -> Vec<(Vec<u32>, bool)> {
    let mut sets = DisjointSets::new(faces.len());
    for segment in &seams.segments {
        if let Some(other) = &segment.other {
            sets.join(segment.owner.patch, other.patch);
        }
    }
    let roots = sets.into_roots();
    let mut parts = BTreeMap::<u32, (Vec<u32>, bool)>::new();
    for (face, root) in faces.iter().zip(&roots) {
        parts
            .entry(*root)
            .or_insert((Vec::new(), true))
            .0
            .push(*face);
    }
    for segment in seams.segments.iter().filter(|s| s.other.is_none()) {
        let part = parts.get_mut(&roots[segment.owner.patch as usize]);
        part.expect("the part of a face").1 = false;
    }
    parts.into_values().collect()
}

/// A file as it is written: entities are numbered as they come, and what an entity refers to is written before it.
struct File<'a> {
    out: &'a mut dyn Write,
    /// The number of the last entity.
    last: u32,
    /// Whether points have weights that must be said.
    rational: bool,
}

/// A list as it stands in parentheses.
fn references(ids: &[u32]) -> String {
    let ids: Vec<String> = ids.iter().map(|id| format!("#{id}")).collect();
    ids.join(",")
}

/// A real number needs a point.
fn real(x: f64) -> String {
    let text = format!("{x:.16E}");
    // Rust writes 1.0…E0; what is not finite has no place in a surface.
    text.replace("E0", "")
}

impl File<'_> {
    /// Writes what is no entity.
    fn text(&mut self, text: &str) -> io::Result<()> {
        self.out.write_all(text.as_bytes())
    }

    /// Writes an entity and answers its number.
    fn add(&mut self, entity: &str) -> io::Result<u32> {
        self.last += 1;
        writeln!(self.out, "#{}={entity};", self.last)?;
        Ok(self.last)
    }

    /// In Å.
    fn point(&mut self, p: [f64; 3]) -> io::Result<u32> {
        let [x, y, z] = p.map(real);
        self.add(&format!("CARTESIAN_POINT('',({x},{y},{z}))"))
    }

    /// Of homogeneous points, which are divided by their weights.
    fn points(&mut self, points: &[[f64; 4]]) -> io::Result<Vec<u32>> {
        let place = |&[x, y, z, w]: &[f64; 4]| self.point([x / w, y / w, z / w]);
        points.iter().map(place).collect()
    }

    /// A cubic Bézier curve.
    fn curve(&mut self, points: &[[f64; 4]; 4]) -> io::Result<u32> {
        const KNOTS: &str = "(4,4),(0.,1.),.UNSPECIFIED.";
        let ids = references(&self.points(points)?);
        let shape = format!("3,({ids}),.UNSPECIFIED.,.F.,.F.");
        if !self.rational {
            return self.add(&format!("B_SPLINE_CURVE_WITH_KNOTS('',{shape},{KNOTS})"));
        }
        let weights = points.map(|p| real(p[3])).join(",");
        self.add(&format!(
            "(BOUNDED_CURVE()B_SPLINE_CURVE({shape})B_SPLINE_CURVE_WITH_KNOTS({KNOTS})CURVE()\
             GEOMETRIC_REPRESENTATION_ITEM()RATIONAL_B_SPLINE_CURVE(({weights}))REPRESENTATION_ITEM(''))"
        ))
    }

    /// A bicubic Bézier patch, its first parameter along side 0.
    fn surface(&mut self, points: &PatchPoints) -> io::Result<u32> {
        const KNOTS: &str = "(4,4),(4,4),(0.,1.),(0.,1.),.UNSPECIFIED.";
        let ids = self.points(points)?;
        // Rows of the second parameter for each place of the first.
        let net = |text: &dyn Fn(usize) -> String| {
            let row = |a: usize| {
                (0..4)
                    .map(|b| text(a + 4 * b))
                    .collect::<Vec<_>>()
                    .join(",")
            };
            (0..4)
                .map(|a| format!("({})", row(a)))
                .collect::<Vec<_>>()
                .join(",")
        };
        let shape = net(&|k| format!("#{}", ids[k]));
        let shape = format!("3,3,({shape}),.UNSPECIFIED.,.F.,.F.,.F.");
        if !self.rational {
            return self.add(&format!("B_SPLINE_SURFACE_WITH_KNOTS('',{shape},{KNOTS})"));
        }
        let weights = net(&|k| real(points[k][3]));
        self.add(&format!(
            "(BOUNDED_SURFACE()B_SPLINE_SURFACE({shape})B_SPLINE_SURFACE_WITH_KNOTS({KNOTS})\
             GEOMETRIC_REPRESENTATION_ITEM()RATIONAL_B_SPLINE_SURFACE(({weights}))REPRESENTATION_ITEM('')SURFACE())"
        ))
    }

    /// The shell, and all that a file needs around it.
    fn product(&mut self, name: &str, parts: &[(Vec<u32>, bool)]) -> io::Result<()> {
        let mut shells = Vec::with_capacity(parts.len());
        for (faces, closed) in parts {
            let (kind, faces) = (if *closed { "CLOSED" } else { "OPEN" }, references(faces));
            shells.push(self.add(&format!("{kind}_SHELL('',({faces}))"))?);
        }
        // One closed shell bounds a solid. Of several, which may lie within each other, only the surfaces are said.
        let (item, kind) = match parts {
            [(_, true)] => (
                format!("MANIFOLD_SOLID_BREP('{name}',#{})", shells[0]),
                "ADVANCED_BREP_SHAPE_REPRESENTATION",
            ),
            _ => (
                format!(
                    "SHELL_BASED_SURFACE_MODEL('{name}',({}))",
                    references(&shells)
                ),
                "MANIFOLD_SURFACE_SHAPE_REPRESENTATION",
            ),
        };
        let item = self.add(&item)?;
        let origin = self.point([0.0; 3])?;
        let up = self.add("DIRECTION('',(0.,0.,1.))")?;
        let along = self.add("DIRECTION('',(1.,0.,0.))")?;
        let axes = self.add(&format!("AXIS2_PLACEMENT_3D('',#{origin},#{up},#{along})"))?;
        let length = self.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")?;
        let angle = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")?;
        let solid = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")?;
        let near = self.add(&format!(
            "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-06),#{length},'distance_accuracy_value','')"
        ))?;
        let context = self.add(&format!(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{near}))\
             GLOBAL_UNIT_ASSIGNED_CONTEXT((#{length},#{angle},#{solid}))REPRESENTATION_CONTEXT('',''))"
        ))?;
        let shape = self.add(&format!("{kind}('',(#{axes},#{item}),#{context})"))?;
        let application = self.add("APPLICATION_CONTEXT('automotive design')")?;
        self.add(&format!(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,#{application})"
        ))?;
        let of_product = self.add(&format!("PRODUCT_CONTEXT('',#{application},'mechanical')"))?;
        let product = self.add(&format!("PRODUCT('{name}','{name}','',(#{of_product}))"))?;
        let formation = self.add(&format!("PRODUCT_DEFINITION_FORMATION('','',#{product})"))?;
        let design = self.add(&format!(
            "PRODUCT_DEFINITION_CONTEXT('part definition',#{application},'design')"
        ))?;
        let definition = self.add(&format!(
            "PRODUCT_DEFINITION('design','',#{formation},#{design})"
        ))?;
        let whole = self.add(&format!("PRODUCT_DEFINITION_SHAPE('','',#{definition})"))?;
        self.add(&format!(
            "SHAPE_DEFINITION_REPRESENTATION(#{whole},#{shape})"
        ))?;
        Ok(())
    }
}

/// The Bézier points of a part of a side, by de Casteljau's scheme.
fn curve(points: &PatchPoints, side: &Side) -> [[f64; 4]; 4] {
    let of_side = match side.side {
        0 => [0, 1, 2, 3],
        1 => [3, 7, 11, 15],
        2 => [15, 14, 13, 12],
        _ => [12, 8, 4, 0],
    };
    let whole = of_side.map(|b| points[b]);
    let [a, b] = side.range;
    // The blossom at (a, a, a), (a, a, b), (a, b, b), (b, b, b).
    [[a, a, a], [a, a, b], [a, b, b], [b, b, b]].map(|at| {
        let mut p = whole;
        for (n, t) in (1..).zip(at) {
            for i in 0..4 - n {
                p[i] = std::array::from_fn(|c| p[i][c] * (1.0 - t) + p[i + 1][c] * t);
            }
        }
        p[0]
    })
}
