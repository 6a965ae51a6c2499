//! The faults, by the crate whose tests must see them.

mod crossfield;
mod dual_contour;
mod gauss_density;
mod geom_core;
mod secondfund_ops;
mod spectral_corresp;
mod tet_quality;
mod tspline;

/// A fault to plant: text of a file, exactly once in it, and what stands there instead.
pub(super) struct Fault {
    /// From the workspace root.
    pub(super) file: &'static str,
    old: &'static str,
    new: &'static str,
    /// What is wrong then.
    pub(super) breaks: &'static str,
    /// Does it change what is computed? Others make it slower or a little worse, which no test has to see.
    pub(super) results: bool,
    /// A test that saw it, which is asked first: `laws::a_law`.
    pub(super) witness: Option<&'static str>,
}

impl Fault {
    /// One that changes what is computed.
    pub(super) const fn wrong(
        breaks: &'static str,
        file: &'static str,
        old: &'static str,
        new: &'static str,
    ) -> Self {
        Self {
            file,
            old,
            new,
            breaks,
            results: true,
            witness: None,
        }
    }

    /// One that makes it slower, or a little worse.
    pub(super) const fn poor(
        breaks: &'static str,
        file: &'static str,
        old: &'static str,
        new: &'static str,
    ) -> Self {
        Self {
            results: false,
            ..Self::wrong(breaks, file, old, new)
        }
    }

    /// The same with a test that saw it.
    pub(super) const fn seen_by(self, witness: &'static str) -> Self {
        Self {
            witness: Some(witness),
            ..self
        }
    }

    /// The file with the fault in it.
    pub(super) fn planted(&self, text: &str) -> Result<String, String> {
        match text.matches(self.old).count() {
            1 if self.old != self.new => Ok(text.replacen(self.old, self.new, 1)),
            1 => Err(format!("{}: `{}` stays as it is", self.file, self.breaks)),
            times => Err(format!(
                "{}: the text of `{}` is found {times} times, not once",
                self.file, self.breaks
            )),
        }
    }
}

/// The faults by the crate whose tests must see them.
pub(super) const LISTS: [(&str, &[Fault]); 8] = [
    ("geom-core", geom_core::FAULTS),
    ("gauss-density", gauss_density::FAULTS),
    ("dual-contour", dual_contour::FAULTS),
    ("tet-quality", tet_quality::FAULTS),
    ("crossfield", crossfield::FAULTS),
    ("tspline", tspline::FAULTS),
    ("spectral-corresp", spectral_corresp::FAULTS),
    ("secondfund-ops", secondfund_ops::FAULTS),
];
