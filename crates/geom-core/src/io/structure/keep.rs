//! What is kept of the rows of a file, once for all formats.
//!
//! The order matters, and is this: dummies of membranes go; rows of a chain come together, those of residues that exclude each
//! other apart; residues get their kind; one location of each atom is chosen, by residue and not by atom, since half of one
//! side chain and half of another are no molecule; radii are assigned, those of residues to chains of which one atom per residue
//! is known; what the options do not want is dropped; the selection is made of what is left; and at last the assembly
//! is built of copies of it. Each step counts what it takes away in the report.

use super::assembly::Copies;
use super::names;
use super::record::{Record, Records};
use super::{AltLocs, Format, Membrane, Radii, ReadOptions, ReadReport, ReadStructure};
use crate::Structure;
use crate::id::MAX_ELEMENTS;
use crate::io::{Error, ErrorKind};
use crate::structure::{
    Atom, Element, Name, ResidueKind, StructureBuilder, Transform, residue_radius, united_radius,
};

impl Records {
    /// What the options keep, as a structure.
    pub(super) fn keep(
        mut self,
        format: Format,
        options: &ReadOptions,
    ) -> Result<ReadStructure, Error> {
        let mut report = ReadReport {
            format,
            models: self.models,
            atoms_read: self.records.len(),
            altlocs: 0,
            hydrogens: 0,
            waters: 0,
            ions: 0,
            ligands: 0,
            unselected: 0,
            atoms: 0,
            trace_chains: 0,
            unknown_elements: 0,
            raised_radii: 0,
            zero_radii: 0,
            membrane: None,
            assemblies: self.assemblies.iter().map(|a| a.name.clone()).collect(),
            copies: 0,
            warnings: std::mem::take(&mut self.warnings),
        };
        // Nothing to keep, or too much, is said before any work.
        if self.records.is_empty() {
            let reason = format!(" in model {}: the file has {}", options.models, self.models);
            return Err(ErrorKind::NoAtoms(format!("{reason} models")).into());
        }
        if self.records.len() > options.max_atoms {
            return Err(too_large(self.records.len() as u128, options.max_atoms));
        }
        report.membrane = self.take_dummies();
        // Chains together: hetero atoms often stand behind all polymers.
        self.records.sort_by_key(|r| (r.domain, r.chain));
        self.untangle();
        self.classify();
        self.choose_locations(options.altlocs, &mut report);
        self.assign_radii(options, &mut report);
        self.drop_kinds(options, &mut report);
        if self.records.is_empty() {
            return Err(ErrorKind::NoAtoms(left_over(&report)).into());
        }
        // The selection is made of the structure as deposited, before it is copied.
        let (mut structure, mut parts) = self.build();
        if let Some(selector) = &options.select {
            let selection = structure
                .select(selector)
                .map_err(|e| ErrorKind::NoAtoms(format!(" selected: {e}")))?;
            let mut kept = vec![false; structure.atoms().len()];
            for range in selection.atom_ranges(&structure) {
                kept[range].fill(true);
            }
            let flags = selection.residues();
            parts = (0..parts.len())
                .filter(|&r| flags[r])
                .map(|r| parts[r])
                .collect();
            let before = structure.atoms().len();
            structure = structure.filter(|a| kept[a]);
            report.unselected = before - structure.atoms().len();
        }
        let mut places = vec![Transform::identity()];
        if let Some(name) = &options.assembly {
            let Some(assembly) = self.assemblies.iter().find(|a| a.name == *name) else {
                let known = match report.assemblies.len() {
                    0 => "this file defines none".to_owned(),
                    _ => format!("this file defines {}", report.assemblies.join(", ")),
                };
                return Err(ErrorKind::expected(format!("an assembly ({known})"), name).into());
            };
            // An assembly: which parts of the file each copy takes, and where it goes.
            let Copies { sets, copies } = assembly.copies(&self.parts)?;
            report.copies = copies.len();
            let flags = |set: &Option<Vec<u32>>| {
                let has = |part| set.as_ref().is_none_or(|s| s.binary_search(part).is_ok());
                parts.iter().map(has).collect()
            };
            let sets: Vec<Vec<bool>> = sets.iter().map(flags).collect();
            let copies = match options.instances {
                false => copies,
                true if sets.len() > 1 => return Err(uneven(name)),
                true => {
                    places = copies.into_iter().map(|copy| copy.1).collect();
                    vec![(0, Transform::identity())]
                }
            };
            structure = structure
                .copies(&sets, &copies, options.max_atoms)
                .map_err(|e| too_large(e.atoms, options.max_atoms))?;
            if structure.atoms().is_empty() {
                let reason = format!(" left: assembly {name} names none of the chains kept");
                return Err(ErrorKind::NoAtoms(reason).into());
            }
        }
        // What is left, counted.
        report.atoms = structure.atoms().len();
        report.zero_radii = structure.atoms().iter().filter(|a| a.radius == 0.0).count();
        let unknown = |a: &&Atom| a.element == Element::UNKNOWN;
        report.unknown_elements = structure.atoms().iter().filter(unknown).count();
        Ok(ReadStructure {
            structure,
            places,
            report,
        })
    }

    /// Membrane dummies are no atoms: the planes they mark.
    ///
    /// OPM marks the two planes of a membrane by hetero atoms `DUM` at their heights; which plane one belongs to is
    /// told by the mean of all z, so that it does not matter where z = 0 is.
    fn take_dummies(&mut self) -> Option<Membrane> {
        let is_dummy = |r: &Record| r.atom.hetero && r.residue.name.as_str() == "DUM";
        let heights = |records: &[Record]| -> Vec<f64> {
            let dummies = records.iter().filter(|r| is_dummy(r));
            dummies.map(|r| r.atom.position.z).collect()
        };
        let z = heights(&self.records);
        if z.is_empty() {
            return None;
        }
        self.records.retain(|r| !is_dummy(r));
        let middle = z.iter().sum::<f64>() / z.len() as f64;
        let mean = |side: &dyn Fn(f64) -> bool| {
            let (sum, n) = z
                .iter()
                .filter(|&&z| side(z))
                .fold((0.0, 0), |(s, n), z| (s + z, n + 1));
            if n > 0 { sum / n as f64 } else { middle }
        };
        Some(Membrane {
            lower: mean(&|z| z < middle),
            upper: mean(&|z| z >= middle),
            dummies: z.len(),
        })
    }

    /// The ranges of records with the same key, which must stand together.
    ///
    /// In O(n). Nothing is sorted here.
    fn groups<K: PartialEq>(&self, key: impl Fn(&Record) -> K) -> Vec<std::ops::Range<usize>> {
        let mut start = 0;
        self.records
            .chunk_by(|a, b| key(a) == key(b))
            .map(|group| {
                start += group.len();
                start - group.len()..start
            })
            .collect()
    }

    /// Residues that exclude each other may take turns row by row.
    ///
    /// Without labels of locations nothing is touched; with them the rows of each identity come together, in the order
    /// of their first rows. A stable sort: atoms keep their order.
    fn untangle(&mut self) {
        for group in self.groups(Record::place) {
            let records = &mut self.records[group];
            if records.iter().all(|r| r.altloc == b' ') {
                continue;
            }
            let mut order = Vec::new();
            for r in records.iter() {
                if !order.contains(&r.identity()) {
                    order.push(r.identity());
                }
            }
            records.sort_by_key(|r| order.iter().position(|i| *i == r.identity()));
        }
    }

    /// The kind of each residue, beyond what the format says: water and ions by name and size.
    ///
    /// A residue counts as of one atom if all its rows have one atom name, so that an ion with two locations is one.
    fn classify(&mut self) {
        for group in self.groups(|r| (r.place(), r.identity())) {
            let first = &self.records[group.start];
            let name = first.residue.name;
            let single = {
                let atom = first.atom.name;
                self.records[group.clone()]
                    .iter()
                    .all(|r| r.atom.name == atom)
            };
            let kind = match first.residue.kind {
                _ if names::is_water(name) => ResidueKind::Water,
                ResidueKind::Ligand if single => ResidueKind::Ion,
                ResidueKind::Polymer if single && names::is_ion(name) => ResidueKind::Ion,
                kind => kind,
            };
            for r in &mut self.records[group] {
                r.residue.kind = kind;
            }
        }
    }

    /// One location of each atom.
    ///
    /// Two residues that exclude each other share place but not name, and the labels of one may be those of the other:
    /// sums are thus by label *and* residue name, and what wins is a pair. Of the winner's residue each atom is taken
    /// at the winning label, or, where it lacks one there, at the label where it is most occupied; unlabelled atoms
    /// belong to every location.
    fn choose_locations(&mut self, policy: AltLocs, report: &mut ReadReport) {
        if policy == AltLocs::All || self.records.iter().all(|r| r.altloc == b' ') {
            return;
        }
        let mut kept = vec![true; self.records.len()];
        // Residues that exclude each other share a place, not always the name.
        for group in self.groups(Record::place) {
            let records = &self.records[group.clone()];
            // Summed occupancies per label and residue name, labels in alphabetical order.
            let mut sums: Vec<(u8, Name, f64)> = Vec::new();
            for r in records.iter().filter(|r| r.altloc != b' ') {
                let known = sums
                    .iter_mut()
                    .find(|s| (s.0, s.1) == (r.altloc, r.residue.name));
                match known {
                    Some(s) => s.2 += f64::from(r.occupancy),
                    None => sums.push((r.altloc, r.residue.name, f64::from(r.occupancy))),
                }
            }
            if sums.is_empty() {
                continue;
            }
            sums.sort_by_key(|s| s.0);
            let asked = match policy {
                AltLocs::Label(label) => sums.iter().find(|s| char::from(s.0) == label),
                _ => None,
            };
            let best = sums[1..]
                .iter()
                .fold(&sums[0], |b, s| if s.2 > b.2 { s } else { b });
            let &(label, name, _) = asked.unwrap_or(best);
            for (i, r) in group.clone().zip(records) {
                let alternatives = || {
                    records.iter().enumerate().filter(|(_, o)| {
                        o.residue.name == name && o.atom.name == r.atom.name && o.altloc != b' '
                    })
                };
                kept[i] = match r.altloc {
                    // Atoms without a label belong to all locations of their residue.
                    b' ' => r.residue.name == name || !sums.iter().any(|s| s.1 == r.residue.name),
                    _ if r.residue.name != name => false,
                    own if own == label => {
                        // The same atom twice under one label: the first.
                        let first = alternatives().find(|(_, o)| o.altloc == label);
                        first.is_some_and(|(first, _)| group.start + first == i)
                    }
                    _ if alternatives().any(|(_, o)| o.altloc == label) => false,
                    _ => {
                        let most = alternatives()
                            .reduce(|b, o| if o.1.occupancy > b.1.occupancy { o } else { b });
                        most.is_some_and(|(most, _)| group.start + most == i)
                    }
                };
            }
        }
        report.altlocs = kept.iter().filter(|k| !**k).count();
        let mut i = 0;
        self.records.retain(|_| {
            i += 1;
            kept[i - 1]
        });
    }

    /// From the file as a whole or not at all. The lower bound comes last, so that it holds for all sources.
    fn assign_radii(&mut self, options: &ReadOptions, report: &mut ReadReport) {
        let from_file = options.radii == Radii::File && self.has_radii;
        if !from_file {
            for r in &mut self.records {
                r.atom.radius = match options.radii {
                    Radii::United => united_radius(r.residue.name, r.atom.name, r.atom.element),
                    _ => r.atom.element.vdw_radius(),
                };
            }
            report.trace_chains = self.inflate_traces();
        }
        for r in &mut self.records {
            if r.atom.radius < options.min_radius {
                r.atom.radius = options.min_radius;
                report.raised_radii += 1;
            }
        }
    }

    /// Where a chain has one atom per residue, that atom stands for the residue. Returns the number
    /// of such chains.
    ///
    /// Nine residues of ten, of at least three, must have but one atom, with a name that traces use (`BB` is that of
    /// coarse-grained models); the rest, which may have more, keeps the radii of its elements.
    fn inflate_traces(&mut self) -> usize {
        let mut traces = 0;
        for chain in self.groups(|r| (r.domain, r.chain)) {
            let polymer: Vec<_> = chain
                .filter(|&i| self.records[i].residue.kind == ResidueKind::Polymer)
                .collect();
            let mut alone = Vec::new();
            let mut count = 0;
            for residue in polymer.chunk_by(|&a, &b| self.records[a].same_residue(&self.records[b]))
            {
                count += 1;
                if let [i] = *residue {
                    let atom = &self.records[i].atom;
                    if matches!(
                        atom.name.as_str(),
                        "CA" | "P" | "C4'" | "C3'" | "C1'" | "BB"
                    ) {
                        alone.push(i);
                    }
                }
            }
            if count >= 3 && alone.len() * 10 >= count * 9 {
                traces += 1;
                for i in alone {
                    let r = &mut self.records[i];
                    r.atom.radius = residue_radius(r.residue.name);
                }
            }
        }
        traces
    }

    /// With united radii hydrogens go whatever the options say, for those radii count them already.
    fn drop_kinds(&mut self, options: &ReadOptions, report: &mut ReadReport) {
        let hydrogens = options.hydrogens && options.radii != Radii::United;
        self.records.retain(|r| {
            let dropped = match r.residue.kind {
                ResidueKind::Water if !options.waters => &mut report.waters,
                ResidueKind::Ion if !options.ions => &mut report.ions,
                ResidueKind::Ligand if !options.ligands => &mut report.ligands,
                _ if !hydrogens && r.atom.element == Element::HYDROGEN => &mut report.hydrogens,
                _ => return true,
            };
            *dropped += 1;
            false
        });
    }

    /// The structure, and the part of each residue.
    ///
    /// Domains, chains and residues begin where a record differs from the one before it: records must stand together by
    /// then. They are freed before anything is selected or copied.
    fn build(&mut self) -> (Structure, Vec<u32>) {
        let mut builder = StructureBuilder::new();
        let mut parts = Vec::new();
        let mut before: Option<&Record> = None;
        for r in &self.records {
            let domain = before.is_none_or(|b| b.domain != r.domain);
            let chain = domain || before.is_none_or(|b| b.chain != r.chain);
            let residue = chain || before.is_none_or(|b| !b.same_residue(r));
            if domain {
                let (model, copy) = self.domains[r.domain as usize];
                builder.domain(model, copy);
            }
            if chain {
                let name = Name::from_bytes(self.chains.name(r.chain));
                builder.chain(name.unwrap_or_default());
            }
            if residue {
                builder.residue_of(r.residue);
                parts.push(r.part);
            }
            builder.atom(r.atom);
            before = Some(r);
        }
        self.records = Vec::new();
        (builder.build(), parts)
    }
}

/// The end of the message that no atom is left: which options took how many.
fn left_over(report: &ReadReport) -> String {
    let dropped = [
        (report.waters, "water atoms (option waters)"),
        (report.hydrogens, "hydrogens (option hydrogens)"),
        (report.ions, "ions (option ions)"),
        (report.ligands, "atoms of ligands (option ligands)"),
        (report.membrane.map_or(0, |m| m.dummies), "membrane dummies"),
    ];
    let dropped: Vec<_> = dropped
        .iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, what)| format!("{n} {what}"))
        .collect();
    format!(
        " left of {}: left out are {}",
        report.atoms_read,
        dropped.join(", ")
    )
}

/// Instances are of one unit.
fn uneven(assembly: &str) -> Error {
    ErrorKind::Unsupported(format!(
        "the copies of assembly {assembly} have different chains, so they are no instances of one unit; read it without \
         instances"
    ))
    .into()
}

fn too_large(atoms: u128, limit: usize) -> Error {
    let limit = limit.min(MAX_ELEMENTS);
    ErrorKind::TooLarge(format!(
        "{atoms} atoms are too many: at most {limit} are allowed here and fit in memory"
    ))
    .into()
}
