//! Options of algorithms: one error for all that are out of their range.

use std::borrow::Cow;
use std::fmt::Display;

/// An option has a value that makes no sense.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("option {option} is {value}; it must {must}")]
pub struct OutOfRange {
    /// Name of the field of the options.
    pub option: &'static str,
    /// Its value.
    pub value: String,
    /// What it must do, e.g. "be positive".
    pub must: Cow<'static, str>,
}

impl OutOfRange {
    /// The error of an option.
    pub fn new(
        option: &'static str,
        value: impl Display,
        must: impl Into<Cow<'static, str>>,
    ) -> Self {
        let value = value.to_string();
        // Very small and very large numbers would be rows of zeros.
        let value = match value.parse::<f64>() {
            Ok(number) if value.len() > 24 => format!("{number:e}"),
            _ => value,
        };
        Self {
            option,
            value,
            must: must.into(),
        }
    }
}

/// Is the option as it must be? The error names it, its value and the cure.
///
/// ```
/// use geom_core::options::require;
/// let spacing = -0.5;
/// let error = require(spacing > 0.0, "spacing", spacing, "be positive").unwrap_err();
/// assert_eq!(error.to_string(), "option spacing is -0.5; it must be positive");
/// ```
pub fn require(
    holds: bool,
    option: &'static str,
    value: impl Display,
    must: &'static str,
) -> Result<(), OutOfRange> {
    if holds {
        Ok(())
    } else {
        Err(OutOfRange::new(option, value, must))
    }
}
