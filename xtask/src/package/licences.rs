//! The licences of all that the workspace builds on.

use serde_json::Value;

use super::packages;
use crate::Outcome;

/// What may be built on: nothing of these asks more of a user than to keep a notice.
const TAKEN: [&str; 14] = [
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "CDLA-Permissive-2.0",
    "ISC",
    "MIT",
    "MIT-0",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Every package that any feature builds on has a licence that is taken.
pub(super) fn check(metadata: &Value) -> Outcome {
    let refused: Vec<String> = packages(metadata)
        .filter_map(|package| {
            let licence = package["license"].as_str().unwrap_or_default();
            let refused = !is_taken(licence);
            refused.then(|| format!("{} has the licence `{licence}`", package["name"]))
        })
        .collect();
    if !refused.is_empty() {
        return Err(refused.join("; "));
    }
    println!("licences of {} packages", packages(metadata).count());
    Ok(())
}

/// Can all that a licence expression demands be met? `OR` (once written `/`) offers a choice, `AND` does not and binds
/// tighter, parentheses group.
fn is_taken(expression: &str) -> bool {
    let expression = expression.replace('/', " OR ");
    let spaced = expression.replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut rest = &words[..];
    any(&mut rest) == Some(true) && rest.is_empty()
}

/// One of several; `None` where words are missing.
fn any(words: &mut &[&str]) -> Option<bool> {
    let mut taken = all(words)?;
    while let ["OR", rest @ ..] = words {
        *words = rest;
        taken |= all(words)?;
    }
    Some(taken)
}

/// Each of several.
fn all(words: &mut &[&str]) -> Option<bool> {
    let mut taken = one(words)?;
    while let ["AND", rest @ ..] = words {
        *words = rest;
        taken &= one(words)?;
    }
    Some(taken)
}

/// A licence, perhaps with an exception, or a group.
fn one(words: &mut &[&str]) -> Option<bool> {
    let (name, rest) = match words {
        ["(", rest @ ..] => {
            *words = rest;
            let taken = any(words)?;
            *words = words.strip_prefix(&[")"])?;
            return Some(taken);
        }
        [name, "WITH", exception, rest @ ..] => (format!("{name} WITH {exception}"), rest),
        [name, rest @ ..] => ((*name).to_owned(), rest),
        [] => return None,
    };
    *words = rest;
    Some(TAKEN.contains(&name.as_str()))
}

#[cfg(test)]
mod tests {
    use super::is_taken;

    #[test]
    fn a_choice_needs_one_licence_and_a_sum_all() {
        for taken in [
            "MIT",
            "GPL-3.0 OR MIT",
            "MIT/Apache-2.0",
            "(MIT OR GPL-2.0) AND Unicode-3.0",
        ] {
            assert!(is_taken(taken), "{taken}");
        }
        let refused = [
            "",
            "GPL-3.0",
            "MIT AND GPL-3.0",
            "MIT OR",
            "(MIT",
            "MIT MIT",
            "GPL-2.0 AND MIT OR MPL-2.0",
        ];
        for refused in refused {
            assert!(!is_taken(refused), "{refused}");
        }
        assert!(is_taken("Apache-2.0 WITH LLVM-exception OR MIT"));
    }
}
