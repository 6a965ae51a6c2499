//! Words of text formats, each with its line.
//!
//! Words are what blanks and line ends separate, as bytes of the file: nothing is copied, and text need not be UTF-8.
//! One pass over the file; the line of an error costs nothing, since it is counted on the way.

use super::{Error, ErrorKind};

/// Walks through the words of a text.
pub(super) struct Words<'a> {
    text: &'a [u8],
    at: usize,
    line: usize,
}

impl<'a> Words<'a> {
    /// Stands before the first byte, in line 1.
    pub(super) fn new(text: &'a [u8]) -> Self {
        Self {
            text,
            at: 0,
            line: 1,
        }
    }

    /// The line of the next byte, from 1.
    pub(super) fn line(&self) -> usize {
        self.line
    }

    /// The place of the next byte.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    /// Goes on at a later place; the lines in between are counted.
    pub(super) fn skip_to(&mut self, at: usize) {
        let at = at.min(self.text.len());
        self.line += self.text[self.at..at]
            .iter()
            .filter(|&&b| b == b'\n')
            .count();
        self.at = at;
    }

    /// Goes on after `n` bytes that are no text, and have no lines.
    ///
    /// For binary parts between lines of text, as MSH has them, which the caller reads on its own. They must be there.
    pub(super) fn advance(&mut self, n: usize) {
        self.at += n;
    }

    /// Skips blanks, line ends, and comments from `#` to the end of the line if `comments`.
    fn skip(&mut self, comments: bool) {
        while let Some(&b) = self.text.get(self.at) {
            match b {
                b'\n' => self.line += 1,
                b if b.is_ascii_whitespace() => {}
                b'#' if comments => {
                    while self.text.get(self.at).is_some_and(|&b| b != b'\n') {
                        self.at += 1;
                    }
                    continue;
                }
                _ => return,
            }
            self.at += 1;
        }
    }

    /// The next word, or `None` at the end.
    ///
    /// A word ends before a blank only: with `comments`, a `#` inside of a word belongs to the word.
    pub(super) fn next(&mut self, comments: bool) -> Option<&'a [u8]> {
        self.skip(comments);
        let start = self.at;
        while self
            .text
            .get(self.at)
            .is_some_and(|b| !b.is_ascii_whitespace())
        {
            self.at += 1;
        }
        (self.at > start).then(|| &self.text[start..self.at])
    }

    /// The rest of this line, without its end.
    ///
    /// Also without the carriage return that files from Windows have there. Stands at the start of the next line then.
    pub(super) fn rest_of_line(&mut self) -> &'a [u8] {
        let rest = &self.text[self.at..];
        let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.skip_to(self.at + end + 1);
        rest[..end].strip_suffix(b"\r").unwrap_or(&rest[..end])
    }

    /// The next word, which must be there.
    ///
    /// Comments are not looked for: a `#` there is a word.
    pub(super) fn word(&mut self, what: &str) -> Result<&'a [u8], Error> {
        self.next(false)
            .ok_or_else(|| Error::at_line(ErrorKind::Truncated(what.to_owned()), self.line))
    }

    /// The next word as a number.
    ///
    /// As Rust parses it: `1e-3`, `nan` and `inf` are numbers of type f64, `1d-3` of Fortran and `1,5` are not.
    pub(super) fn number<T: std::str::FromStr>(&mut self, what: &str) -> Result<T, Error> {
        let word = self.word(what)?;
        self.parsed(word, what)
    }

    /// This word of the current line as a number.
    pub(super) fn parsed<T: std::str::FromStr>(&self, word: &[u8], what: &str) -> Result<T, Error> {
        parse(word).ok_or_else(|| {
            let found = String::from_utf8_lossy(word);
            Error::at_line(ErrorKind::expected(what, found), self.line)
        })
    }
}

/// A word as a number.
///
/// `None` if it is none, or no UTF-8.
pub(super) fn parse<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}
