//! Words of a text with the lines on which they stand.
//!
//! Both text formats are words between white space, whose lines mean nothing: readers ask for one word after the other
//! and say what they expect, and an error names the line where something else stood.

use std::str::FromStr;

use crate::Error;

/// Reads a text word by word.
pub(super) struct Words<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    line: usize,
    words: std::str::SplitAsciiWhitespace<'a>,
}

impl<'a> Words<'a> {
    /// From the beginning.
    pub(super) fn new(text: &'a str) -> Self {
        Self {
            lines: text.lines().enumerate(),
            line: 0,
            words: "".split_ascii_whitespace(),
        }
    }

    /// The next word, over the ends of lines.
    pub(super) fn next(&mut self) -> Option<&'a str> {
        loop {
            if let Some(word) = self.words.next() {
                return Some(word);
            }
            let (line, text) = self.lines.next()?;
            (self.line, self.words) = (line + 1, text.split_ascii_whitespace());
        }
    }

    /// The next word as a number or whatever else is expected.
    pub(super) fn read<T: FromStr>(&mut self, expected: &'static str) -> Result<T, Error> {
        let word = self.next().unwrap_or("the end");
        word.parse().map_err(|_| self.wrong(expected, word))
    }

    /// So many of them.
    pub(super) fn several<T: FromStr>(
        &mut self,
        count: usize,
        expected: &'static str,
    ) -> Result<Vec<T>, Error> {
        // Nothing is allocated for what is not there.
        let mut out = Vec::new();
        for _ in 0..count {
            out.push(self.read(expected)?);
        }
        Ok(out)
    }

    /// An array of numbers.
    pub(super) fn array<const N: usize>(
        &mut self,
        expected: &'static str,
    ) -> Result<[f64; N], Error> {
        let mut out = [0.0; N];
        for x in &mut out {
            *x = self.read(expected)?;
        }
        Ok(out)
    }

    /// The next word must be this one.
    pub(super) fn expect(&mut self, expected: &'static str) -> Result<(), Error> {
        match self.next() {
            Some(word) if word == expected => Ok(()),
            other => Err(self.wrong(expected, other.unwrap_or("the end"))),
        }
    }

    /// The error for the line of the last word; of what was found the first 40 characters.
    pub(super) fn wrong(&self, expected: &'static str, found: &str) -> Error {
        Error::File {
            line: self.line,
            expected,
            found: found.chars().take(40).collect(),
        }
    }
}
