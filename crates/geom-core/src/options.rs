//! Options of algorithms: one error for all that are out of their range.
//!
//! A verb checks its `Options` before it does anything else. The first field that is out of its range ends the work;
//! what is wrong in the input data is an error of the algorithm, not this one.

use std::borrow::Cow;
use std::fmt::Display;

/// An option has a value that makes no sense. Two of these are equal if they would print the same.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("option {option} is {value}; it must {must}")]
pub struct OutOfRange {
    /// Name of the field of the options.
    pub option: &'static str,
    /// Its value. More than 24 characters of a number become one with an exponent, as `1e-300`.
    pub value: String,
    /// What it must do, e.g. "be positive".
    ///
    /// It completes the sentence of the message, so that it begins with a verb and has no full stop.
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

/// For fields that may be infinite, which JSON writes as `null`: what is null is infinite.
///
/// # Errors
/// Those of the format.
#[cfg(feature = "serde")]
pub fn or_infinite<'de, D: serde::Deserializer<'de>>(value: D) -> Result<f64, D::Error> {
    let value = <Option<f64> as serde::Deserialize>::deserialize(value)?;
    Ok(value.unwrap_or(f64::INFINITY))
}

/// Is the option as it must be? The error names it, its value and the cure.
///
/// ```
/// use geom_core::options::require;
/// let spacing = -0.5;
/// let error = require(spacing > 0.0, "spacing", spacing, "be positive").unwrap_err();
/// assert_eq!(error.to_string(), "option spacing is -0.5; it must be positive");
/// ```
///
/// # Errors
/// [`OutOfRange`] where `holds` is false. NaN fails every comparison, so that a condition written as what must be
/// (`x > 0.0`, not `!(x <= 0.0)`) refuses it.
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
