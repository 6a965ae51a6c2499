//! mmCIF: the categories `_atom_site`, `_entity` and those of assemblies, out of a STAR file.
//!
//! STAR is a language of its own: values are words, quoted words or blocks of lines between semicolons, and a category is either
//! a list of single items or a `loop_` with a row of names and rows of values. `.` and `?` stand for nothing and for
//! unknown. What is read:
//!
//! | category | gives |
//! |---|---|
//! | `_atom_site` | the atoms; it must have `Cartn_x`, `_y`, `_z` (Å), an atom's and a residue's name |
//! | `_entity` | which atoms are polymer, ligand or water |
//! | `_pdbx_struct_oper_list` | rotations and translations (Å) by name |
//! | `_pdbx_struct_assembly_gen` | which chains are copied by which of them: `1,2`, `1-60`, `(1-60)(61-88)` for products |
//!
//! Chains, residue names and numbers are the author's (`auth_…`), as in PDB files; assemblies name
//! chains by `label_asym_id`.

use std::collections::BTreeMap;
use std::rc::Rc;

use super::Models;
use super::assembly::{Assembly, Generator, Operators};
use super::names;
use super::names::Names;
use super::record::{Record, Records, number, wanted};
use crate::Point3;
use crate::io::{Error, ErrorKind};
use crate::structure::{Atom, Name, Residue, ResidueKind, Transform, residues};

/// Does the content begin as a CIF does: comments, then `data_`?
pub(super) fn looks_like(content: &[u8]) -> bool {
    match Lexer::new(content).next() {
        Ok(Some(Token {
            bytes, word: true, ..
        })) => is_keyword(bytes, b"data_"),
        _ => false,
    }
}

/// Reads all atoms of the wanted models and the assemblies of the first data block that has atoms.
///
/// One pass. The lexer gives a token at a time and the rows of `_atom_site` become records at once, so that the text is
/// never held as a table; only the small categories of `TABLES` are, for which order does not matter then: they are
/// looked at in the end.
pub(super) fn parse(content: &[u8], models: Models) -> Result<Records, Error> {
    let mut lexer = Lexer::new(content);
    let mut reader = Reader::default();
    let mut block = false;
    let mut token = lexer.next()?;
    while let Some(t) = token {
        if t.word && is_keyword(t.bytes, b"data_") {
            if reader.seen {
                break;
            }
            block = true;
            reader = Reader::default();
            token = lexer.next()?;
        } else if !block {
            let found = String::from_utf8_lossy(t.bytes);
            return Err(Error::at_line(
                ErrorKind::expected("data_ of mmCIF", found),
                t.line,
            ));
        } else if t.word && t.bytes.eq_ignore_ascii_case(b"loop_") {
            token = reader.looped(&mut lexer, models, t.line)?;
        } else if t.word && t.bytes.starts_with(b"_") {
            let Some(value) = lexer.next()? else {
                let item = String::from_utf8_lossy(t.bytes).into_owned();
                return Err(Error::at_line(ErrorKind::Truncated(item), t.line));
            };
            if is_tag_or_keyword(&value) {
                let item = String::from_utf8_lossy(t.bytes);
                let found = String::from_utf8_lossy(value.bytes);
                let kind = ErrorKind::expected(format!("a value of {item}"), found);
                return Err(Error::at_line(kind, value.line));
            }
            reader.single(t.bytes, value);
            token = lexer.next()?;
        } else if is_tag_or_keyword(&t) {
            // save_ frames of dictionaries and the like hold no atoms.
            token = lexer.next()?;
        } else {
            let found = String::from_utf8_lossy(t.bytes);
            let kind = ErrorKind::expected("loop_ or an item (_category.name)", found);
            return Err(Error::at_line(kind, t.line));
        }
    }
    reader.finish(models)
}

/// A word or quoted value; `word` if it is not quoted.
#[derive(Clone, Copy, Debug)]
struct Token<'a> {
    bytes: &'a [u8],
    /// Only unquoted words can be tags, keywords or null values: `'_x'` and `"."` are text.
    word: bool,
    line: usize,
}

impl<'a> Token<'a> {
    /// The value; empty if it is unknown (`?`) or does not apply (`.`).
    fn value(&self) -> &'a [u8] {
        match self.bytes {
            b"." | b"?" if self.word => b"",
            bytes => bytes,
        }
    }
}

/// Keywords do not depend on case, and those of blocks have a name behind them: `data_1ABC`.
fn is_keyword(word: &[u8], start: &[u8]) -> bool {
    word.get(..start.len())
        .is_some_and(|w| w.eq_ignore_ascii_case(start))
}

/// What ends a row of values. Called for every value of a file, so that most are told by their first letter.
fn is_tag_or_keyword(token: &Token) -> bool {
    token.word
        && match token.bytes[0] {
            b'_' => true,
            b'd' | b'D' => is_keyword(token.bytes, b"data_"),
            b'l' | b'L' => token.bytes.eq_ignore_ascii_case(b"loop_"),
            b's' | b'S' => {
                is_keyword(token.bytes, b"save_") || token.bytes.eq_ignore_ascii_case(b"stop_")
            }
            b'g' | b'G' => token.bytes.eq_ignore_ascii_case(b"global_"),
            _ => false,
        }
}

/// Splits STAR into words, quoted values and text fields.
///
/// CIF 1.1, by bytes: control characters are blanks, and anything beyond ASCII belongs to words.
struct Lexer<'a> {
    content: &'a [u8],
    at: usize,
    line: usize,
    /// Number of lines that hold only `#`, as some programs write behind each category.
    rules: usize,
}

impl<'a> Lexer<'a> {
    fn new(content: &'a [u8]) -> Self {
        Self {
            content,
            at: 0,
            line: 1,
            rules: 0,
        }
    }

    /// `None` at the end of the file.
    ///
    /// Fails at a text field without its second semicolon and at a quote that does not close within its line, in the
    /// line where the value begins: a file that was cut off there.
    fn next(&mut self) -> Result<Option<Token<'a>>, Error> {
        let content = self.content;
        loop {
            match content.get(self.at) {
                None => return Ok(None),
                Some(b'\n') => {
                    self.line += 1;
                    self.at += 1;
                }
                Some(b) if *b <= b' ' => self.at += 1,
                Some(b'#') => {
                    let end = self.end_of_line();
                    let rule = content[self.at + 1..end].trim_ascii().is_empty();
                    self.rules += usize::from(rule);
                    self.at = end;
                }
                Some(_) => break,
            }
        }
        // A value is a text field, a quoted one, or a word.
        let (start, line) = (self.at, self.line);
        let token = |bytes, word| Ok(Some(Token { bytes, word, line }));
        match content[start] {
            b';' if start == 0 || content[start - 1] == b'\n' => {
                // Up to a line that begins with a semicolon.
                let mut end = start;
                loop {
                    end = match content[end..].iter().position(|&b| b == b'\n') {
                        Some(n) => end + n + 1,
                        None => {
                            let what = "a text field (no closing semicolon)".to_owned();
                            return Err(Error::at_line(ErrorKind::Truncated(what), line));
                        }
                    };
                    self.line += 1;
                    if content.get(end) == Some(&b';') {
                        break;
                    }
                }
                self.at = end + 1;
                token(content[start + 1..end].trim_ascii_end(), false)
            }
            quote @ (b'\'' | b'"') => {
                // A quote closes only before a blank.
                let end = self.end_of_line();
                let rest = &content[start + 1..end];
                let closing = (0..rest.len())
                    .find(|&i| rest[i] == quote && rest.get(i + 1).is_none_or(|b| *b <= b' '));
                let Some(closing) = closing else {
                    let what = "a quoted value (no closing quote)".to_owned();
                    return Err(Error::at_line(ErrorKind::Truncated(what), line));
                };
                self.at = start + closing + 2;
                token(&rest[..closing], false)
            }
            _ => {
                let word = &content[start..];
                let length = word.iter().position(|b| *b <= b' ').unwrap_or(word.len());
                self.at = start + length;
                token(&word[..length], true)
            }
        }
    }

    /// The place of the line's end, or of the end of the file.
    fn end_of_line(&self) -> usize {
        let rest = &self.content[self.at..];
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.at + length
    }
}

/// A small category, with the line of each row.
#[derive(Debug, Default)]
struct Table {
    items: Vec<String>,
    rows: Vec<(Vec<String>, usize)>,
}

impl Table {
    /// Items are kept in small letters.
    fn column(&self, item: &str) -> Option<usize> {
        self.items.iter().position(|i| i == item)
    }
}

/// Files with as many lines of `#` mark the end of every category; some programs write a few.
const MANY_RULES: usize = 10;

/// The small categories that are read.
const TABLES: [&str; 3] = [
    "_entity.",
    "_pdbx_struct_assembly_gen.",
    "_pdbx_struct_oper_list.",
];

/// The items of `_atom_site` that are read.
///
/// By their places in this list: `at(17)` in the reader of a row is the number of the model.
const ITEMS: [&str; 19] = [
    "cartn_x",
    "cartn_y",
    "cartn_z",
    "group_pdb",
    "type_symbol",
    "label_atom_id",
    "auth_atom_id",
    "label_comp_id",
    "auth_comp_id",
    "label_asym_id",
    "auth_asym_id",
    "label_seq_id",
    "auth_seq_id",
    "pdbx_pdb_ins_code",
    "label_alt_id",
    "occupancy",
    "b_iso_or_equiv",
    "pdbx_pdb_model_num",
    "label_entity_id",
];

/// What is known of a data block so far. A block without atoms is forgotten when the next one begins.
#[derive(Default)]
struct Reader {
    found: Records,
    tables: [Table; TABLES.len()],
    /// Are there atom sites in this block?
    seen: bool,
    /// `_atom_site` items that are not in a loop: a single atom.
    lone: Vec<(String, Vec<u8>, usize)>,
    /// Crystallographic CIF with fractional coordinates.
    fractional: bool,
    /// Names of entities, and per record the number of its own; what they are is known only when `_entity` has been
    /// read.
    entities: Names,
    entity_of: Vec<u32>,
    /// Number of the model of the last row, and is it wanted?
    model: Option<u32>,
    keep: bool,
}

impl Reader {
    /// The category's table, if it is read.
    fn table(&mut self, tag: &str) -> Option<(&mut Table, usize)> {
        let i = TABLES.iter().position(|t| tag.starts_with(t))?;
        Some((&mut self.tables[i], TABLES[i].len()))
    }

    /// An item outside of a loop. One that follows a loop of its category, of more than one row, replaces it, as no
    /// proper file has it.
    fn single(&mut self, tag: &[u8], value: Token) {
        let tag = String::from_utf8_lossy(tag).to_ascii_lowercase();
        if let Some(item) = tag.strip_prefix("_atom_site.") {
            self.seen = true;
            self.lone
                .push((item.to_owned(), value.value().to_vec(), value.line));
        } else if let Some((table, prefix)) = self.table(&tag) {
            if table.rows.len() > 1 {
                *table = Table::default();
            }
            table.items.push(tag[prefix..].to_owned());
            let text = String::from_utf8_lossy(value.value()).into_owned();
            match table.rows.first_mut() {
                Some((row, _)) => row.push(text),
                None => table.rows.push((vec![text], value.line)),
            }
        }
    }

    /// A loop; returns the token after it.
    fn looped<'a>(
        &mut self,
        lexer: &mut Lexer<'a>,
        models: Models,
        line: usize,
    ) -> Result<Option<Token<'a>>, Error> {
        let rules = lexer.rules;
        // The header: tags up to the first value.
        let mut tags = Vec::new();
        let mut token = lexer.next()?;
        while let Some(t) = token.filter(|t| t.word && t.bytes[0] == b'_') {
            tags.push(String::from_utf8_lossy(t.bytes).to_ascii_lowercase());
            token = lexer.next()?;
        }
        let Some(first) = tags.first() else {
            let kind = ErrorKind::expected("items after loop_", "none");
            return Err(Error::at_line(kind, line));
        };
        // Atoms are read row by row as they come; the few tables that say more are kept whole, all others skipped.
        let atoms = first.starts_with("_atom_site.");
        self.fractional |= first.starts_with("_atom_site_");
        let mut columns = [None; ITEMS.len()];
        if atoms {
            self.seen = true;
            columns = columns_of(tags.iter().map(|t| t.strip_prefix("_atom_site.")), line)?;
        }
        let mut table = None;
        if let Some((t, prefix)) = self.table(first) {
            t.items = tags
                .iter()
                .map(|t| t.get(prefix..).unwrap_or_default().to_owned())
                .collect();
            t.rows.clear();
            table = TABLES.iter().position(|t| first.starts_with(t));
        }
        // Rows until a tag or keyword; one that is not full is cut off or wrong.
        let category = first.split('.').next().unwrap_or_default().to_owned();
        let width = tags.len();
        let mut row: Vec<&[u8]> = Vec::with_capacity(width);
        let mut row_line = 0;
        loop {
            match token {
                Some(t) if !is_tag_or_keyword(&t) => {
                    if row.is_empty() {
                        row_line = t.line;
                    }
                    row.push(t.value());
                    if row.len() == width {
                        if atoms {
                            self.atom(&row, &columns, models)
                                .map_err(|kind| Error::at_line(kind, row_line))?;
                        } else if let Some(i) = table {
                            let text = |v: &&[u8]| String::from_utf8_lossy(v).into_owned();
                            self.tables[i]
                                .rows
                                .push((row.iter().map(text).collect(), row_line));
                        }
                        row.clear();
                    }
                }
                _ if row.is_empty() => break,
                None => {
                    let what = format!("a row of {category}");
                    return Err(Error::at_line(ErrorKind::Truncated(what), row_line));
                }
                Some(t) => {
                    let expected = format!("{width} values in each row of {category}");
                    let kind = ErrorKind::expected(expected, String::from_utf8_lossy(t.bytes));
                    return Err(Error::at_line(kind, t.line));
                }
            }
            token = lexer.next()?;
        }
        if atoms && token.is_none() {
            // Where a file marks the ends of its categories, the end of the atoms is marked too.
            let unmarked = lexer.rules == rules;
            if (unmarked && rules >= MANY_RULES) || !lexer.content.ends_with(b"\n") {
                let missing = if unmarked {
                    "line with #"
                } else {
                    "end of line"
                };
                let what = format!("the loop of _atom_site (no {missing} behind it)");
                return Err(Error::at_line(ErrorKind::Truncated(what), lexer.line));
            }
            if unmarked && rules > 0 {
                let doubt = "no line with # behind the atoms: is the file whole?";
                self.found.warnings.push(doubt.to_owned());
            }
        }
        Ok(token)
    }

    /// A row of `_atom_site`. Authors' names count before those of the format, as in PDB files; only assemblies go by
    /// `label_asym_id`. Rows of models that are not wanted are not looked at further.
    fn atom(
        &mut self,
        row: &[&[u8]],
        columns: &[Option<usize>; ITEMS.len()],
        models: Models,
    ) -> Result<(), ErrorKind> {
        let at = |item: usize| columns[item].map_or(&b""[..], |c| row[c]);
        let either = |first: usize, second: usize| match at(first) {
            b"" => at(second),
            value => value,
        };
        // A row of another model than the last one begins a model.
        let model = match at(17) {
            b"" => 1,
            n => integer(n).ok_or_else(|| expected("a model number", n))?,
        };
        if self.model != Some(model) {
            self.model = Some(model);
            self.keep = wanted(models, model, self.found.models);
            self.found.models += 1;
            if self.keep {
                self.found.domains.push((model, 1));
            }
        }
        if !self.keep {
            return Ok(());
        }
        let coordinate = |item: usize| {
            measured(at(item)).ok_or_else(|| {
                let axis = ["Cartn_x", "Cartn_y", "Cartn_z"][item];
                expected(&format!("a finite {axis}"), at(item))
            })
        };
        let position = Point3::new(coordinate(0)?, coordinate(1)?, coordinate(2)?);
        // The author's names and numbers, or where there are none those of the format.
        let residue = name(either(8, 7))?;
        let sequence = either(12, 11);
        let sequence_number = match sequence {
            b"" => 0,
            n => integer(n).ok_or_else(|| expected("a residue number", n))?,
        };
        let chain = either(10, 9);
        name(chain)?;
        // Assemblies name chains by the format's names.
        let part = either(9, 10);
        let hetero = at(3).eq_ignore_ascii_case(b"HETATM");
        let atom_name = name(either(6, 5))?;
        let symbol = std::str::from_utf8(at(4)).unwrap_or_default();
        let found = &mut self.found;
        found.records.push(Record {
            atom: Atom {
                position,
                radius: 0.0,
                charge: 0.0,
                b_factor: measured(at(16)).unwrap_or(0.0) as f32,
                name: atom_name,
                element: names::element_in_file(symbol).unwrap_or_else(|| {
                    names::element_of(atom_name, residue, is_ion(atom_name, residue), None)
                }),
                hetero,
            },
            residue: Residue {
                name: residue,
                number: sequence_number,
                insertion: name(at(13))?,
                kind: match hetero && !residues::is_polymer(residue) {
                    true => ResidueKind::Ligand,
                    false => ResidueKind::Polymer,
                },
            },
            // Absent for what is no polymer.
            sequence: integer(at(11)).unwrap_or(0),
            chain: found.chains.index(chain),
            part: found.parts.index(part),
            domain: found.domains.len() as u32 - 1,
            altloc: at(14).first().copied().unwrap_or(b' '),
            occupancy: measured(at(15)).unwrap_or(1.0) as f32,
        });
        self.entity_of.push(self.entities.index(at(18)));
        Ok(())
    }

    /// What only the whole block tells: an atom outside of a loop, kinds by entity, and assemblies.
    fn finish(mut self, models: Models) -> Result<Records, Error> {
        if !self.lone.is_empty() {
            let lone = std::mem::take(&mut self.lone);
            let line = lone[0].2;
            let columns = columns_of(lone.iter().map(|(item, ..)| Some(item.as_str())), line)?;
            let row: Vec<&[u8]> = lone.iter().map(|(_, value, _)| value.as_slice()).collect();
            self.atom(&row, &columns, models)
                .map_err(|kind| Error::at_line(kind, line))?;
        }
        if !self.seen {
            return Err(if self.fractional {
                let reason = "a small-molecule CIF with fractional coordinates is not read here: \
                              convert it to mmCIF or PDB";
                ErrorKind::Unsupported(reason.to_owned()).into()
            } else {
                ErrorKind::NoAtoms(" in this mmCIF file: it has no _atom_site".to_owned()).into()
            });
        }
        self.kinds();
        self.assemblies()?;
        Ok(self.found)
    }

    /// Entities say what is a polymer, where the file describes them.
    fn kinds(&mut self) {
        let [entity, ..] = &self.tables;
        let (Some(id), Some(kind)) = (entity.column("id"), entity.column("type")) else {
            return;
        };
        let mut kinds = BTreeMap::new();
        for (row, _) in &entity.rows {
            let kind = match row[kind].as_str() {
                "polymer" => ResidueKind::Polymer,
                "water" => ResidueKind::Water,
                _ => ResidueKind::Ligand,
            };
            kinds.extend(
                self.entities
                    .find(row[id].as_bytes())
                    .map(|index| (index, kind)),
            );
        }
        for (r, entity) in self.found.records.iter_mut().zip(&self.entity_of) {
            if let Some(&kind) = kinds.get(entity) {
                r.residue.kind = kind;
            }
        }
    }

    /// Assemblies in the order of the file; rows with one `assembly_id` are generators of one. Nothing is evaluated
    /// here, but for the numbers of the operators.
    fn assemblies(&mut self) -> Result<(), Error> {
        let [_, generators, operators] = &self.tables;
        let mut named = BTreeMap::new();
        if let Some(id) = operators.column("id") {
            for (row, line) in &operators.rows {
                let mut transform = Transform::identity();
                let value = |item: String| {
                    operators
                        .column(&item)
                        .and_then(|c| measured(row[c].as_bytes()))
                        .ok_or_else(|| {
                            let expected = format!("{item} of operator {}", row[id]);
                            Error::at_line(ErrorKind::expected(expected, "none"), *line)
                        })
                };
                for i in 0..3 {
                    for j in 0..3 {
                        let item = format!("matrix[{}][{}]", i + 1, j + 1);
                        transform.rotation[(i, j)] = value(item)?;
                    }
                    transform.translation[i] = value(format!("vector[{}]", i + 1))?;
                }
                named.insert(row[id].clone(), transform);
            }
        }
        let named = Rc::new(named);
        let columns = ["assembly_id", "oper_expression", "asym_id_list"];
        let [Some(id), Some(text), Some(list)] = columns.map(|c| generators.column(c)) else {
            return Ok(());
        };
        for (row, line) in &generators.rows {
            let all = &mut self.found.assemblies;
            let place = all
                .iter()
                .position(|a| a.name == row[id])
                .unwrap_or_else(|| {
                    all.push(Assembly {
                        name: row[id].clone(),
                        generators: Vec::new(),
                    });
                    all.len() - 1
                });
            let parts = row[list].split(',').map(|n| n.trim().as_bytes().to_vec());
            all[place].generators.push(Generator {
                parts: Some(parts.collect()),
                operators: Operators::Expression {
                    text: row[text].clone(),
                    line: *line,
                    named: Rc::clone(&named),
                },
            });
        }
        Ok(())
    }
}

/// Where the items that are read stand in a row; an error names one that is missing.
fn columns_of<'a>(
    items: impl Iterator<Item = Option<&'a str>> + Clone,
    line: usize,
) -> Result<[Option<usize>; ITEMS.len()], Error> {
    let columns = ITEMS.map(|item| items.clone().position(|i| i == Some(item)));
    let needed = [
        ("_atom_site.Cartn_x", columns[0].is_some()),
        ("_atom_site.Cartn_y", columns[1].is_some()),
        ("_atom_site.Cartn_z", columns[2].is_some()),
        (
            "_atom_site.label_atom_id",
            columns[5].or(columns[6]).is_some(),
        ),
        (
            "_atom_site.label_comp_id",
            columns[7].or(columns[8]).is_some(),
        ),
    ];
    match needed.iter().find(|(_, there)| !there) {
        None => Ok(columns),
        Some((item, _)) => {
            let kind = ErrorKind::expected(format!("the item {item}"), "a loop without it");
            Err(Error::at_line(kind, line))
        }
    }
}

fn expected(what: &str, found: &[u8]) -> ErrorKind {
    ErrorKind::expected(what, String::from_utf8_lossy(found))
}

fn integer<N: std::str::FromStr>(text: &[u8]) -> Option<N> {
    std::str::from_utf8(text).ok()?.parse().ok()
}

/// Components that are ions bear the names of their only atoms, of which some say how charged they are: `CA` of `CA`, `FE` of
/// `FE2`. Where no element is given, calcium is told from the Cα of a residue by that.
fn is_ion(atom: Name, component: Name) -> bool {
    let component = component.as_str();
    component.trim_end_matches(|c: char| c.is_ascii_digit()) == atom.as_str()
        || component == atom.as_str()
}

/// Refused, not cut: two names cut alike would become one.
fn name(text: &[u8]) -> Result<Name, ErrorKind> {
    Name::from_bytes(text)
        .ok_or_else(|| expected("a name of at most eight printable ASCII characters", text))
}

/// A number, its standard uncertainty in parentheses left out: `1.5(3)` is 1.5 ± 0.3.
///
/// `None` for what is no number, also for the nulls `.` and `?`.
pub(super) fn measured(field: &[u8]) -> Option<f64> {
    let Some(open) = field.iter().position(|&b| b == b'(') else {
        return number(field);
    };
    let (value, uncertainty) = (&field[..open], &field[open + 1..]);
    let digits = uncertainty.strip_suffix(b")")?;
    (!digits.is_empty() && digits.iter().all(u8::is_ascii_digit)).then_some(())?;
    number(value)
}

/// All words and where they begin; for tests.
#[cfg(feature = "testing")]
pub(super) fn words(content: &[u8]) -> Result<Vec<(String, usize)>, Error> {
    let mut lexer = Lexer::new(content);
    let mut words = Vec::new();
    while let Some(token) = lexer.next()? {
        let value = String::from_utf8_lossy(token.value()).into_owned();
        words.push((value, token.line));
    }
    Ok(words)
}
