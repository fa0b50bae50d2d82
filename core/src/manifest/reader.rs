//! TOML from a file, with the parser's complaints turned into findings that name their field.

use std::io::Read;
use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::{Finding, SCHEMA};

/// Manifests are written by hand: more than this is no manifest.
pub(crate) const MAX_BYTES: u64 = 1 << 20;

/// Reads a text file of at most `max_bytes`; `file` and `field` say who named it, for the finding.
///
/// # Errors
/// The file is missing, unreadable, longer than that or not UTF-8.
pub fn read_bounded(path: &Path, max_bytes: u64, file: &Path, field: &str) -> Result<String, Finding> {
    let wanted = format!("a readable text file of at most {max_bytes} bytes");
    let finding = |found: String| Finding::new(file, field, format!("{}: {found}", path.display()), &wanted);
    let bytes = bytes_of(path, max_bytes).map_err(finding)?;
    String::from_utf8(bytes).map_err(|error| finding(error.to_string()))
}

/// The bytes of a file of at most `max_bytes`, read once, or why not.
pub(crate) fn bytes_of(path: &Path, max_bytes: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    // To open a pipe would wait for whoever writes to it.
    if std::fs::metadata(path).is_ok_and(|about| !about.is_file()) {
        return Err("no file".to_owned());
    }
    std::fs::File::open(path)
        .and_then(|opened| opened.take(max_bytes.saturating_add(1)).read_to_end(&mut bytes))
        .map_err(|error| error.to_string())?;
    if bytes.len() as u64 > max_bytes {
        return Err(format!("more than {max_bytes} bytes"));
    }
    Ok(bytes)
}

/// A manifest's text, from which checked fields are taken.
pub(super) struct Source<'a> {
    path: &'a Path,
    text: String,
}

impl<'a> Source<'a> {
    pub(super) fn read(path: &'a Path) -> Result<Self, Finding> {
        Ok(Self { path, text: read_bounded(path, MAX_BYTES, path, "file")? })
    }

    pub(super) const fn new(path: &'a Path, text: String) -> Self {
        Self { path, text }
    }

    /// Parses the text, the schema number first: a newer file may hold fields this version lacks.
    pub(super) fn parse<T: DeserializeOwned>(&self) -> Result<T, Finding> {
        #[derive(Deserialize)]
        struct Version {
            schema: u32,
        }
        let Version { schema } = toml::from_str(&self.text).map_err(|error| self.parser_finding(&error))?;
        if schema != SCHEMA {
            return Err(self.finding("schema", schema, SCHEMA));
        }
        toml::from_str(&self.text).map_err(|error| self.parser_finding(&error))
    }

    /// A finding about a field of this file.
    pub(super) fn finding(
        &self,
        field: &str,
        found: impl std::fmt::Display,
        wanted: impl std::fmt::Display,
    ) -> Finding {
        let line = self.line_of(field);
        Finding { line, ..Finding::new(self.path, field, found, wanted) }
    }

    /// `value` if it is inside; NaN never is.
    pub(super) fn inside(
        &self,
        field: &str,
        value: f64,
        range: std::ops::RangeInclusive<f64>,
    ) -> Result<f64, Finding> {
        if range.contains(&value) {
            return Ok(value);
        }
        Err(self.finding(field, value, format!("{} to {}", range.start(), range.end())))
    }

    /// The line on which a field `table.key` or `key` stands, if it stands on one of its own.
    fn line_of(&self, field: &str) -> Option<usize> {
        let mut table = "";
        for (index, line) in self.text.lines().enumerate() {
            if let Some(header) = header(line) {
                table = header;
            } else if let Some(key) = key(line) {
                let path = join(table, key);
                let rest = field.strip_prefix(path.as_str());
                if rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '['])) {
                    return Some(index + 1);
                }
            }
        }
        None
    }

    /// The field that stands at a byte of the text, and its line.
    fn field_at(&self, offset: usize) -> (String, usize) {
        let before = self.text.get(..offset).unwrap_or(&self.text);
        let line_number = before.matches('\n').count() + 1;
        let table = before.lines().rev().find_map(header).unwrap_or("");
        let line = self.text.lines().nth(line_number - 1).unwrap_or("");
        match header(line) {
            Some(table) => (table.to_owned(), line_number),
            None => (join(table, key(line).unwrap_or("")), line_number),
        }
    }

    fn parser_finding(&self, error: &toml::de::Error) -> Finding {
        let offset = error.span().map_or(0, |span| span.start);
        let (at, line) = self.field_at(offset);
        let message = error.message().lines().next().unwrap_or("");
        let quoted = || message.split('`').nth(1).unwrap_or("");
        let (before, wanted) = message.split_once(", expected ").unwrap_or((message, ""));
        let (field, found, wanted) = if message.starts_with("unknown field") {
            let table = self.text.get(..offset).unwrap_or("").lines().rev().find_map(header).unwrap_or("");
            let inline = at != quoted() && !at.ends_with(&format!(".{}", quoted())) && !at.is_empty();
            let parent = if inline { at.as_str() } else { table };
            (join(parent, quoted()), "a field that is not known here", wanted)
        } else if message.starts_with("missing field") {
            // The span is that of the table that lacks it.
            let table = self.text.get(offset..).unwrap_or("");
            let inline = if table.starts_with('{') { at.as_str() } else { "" };
            let parent = table.lines().next().and_then(header).unwrap_or(inline);
            (join(parent, quoted()), "nothing", "a value")
        } else if let Some((_, found)) =
            before.split_once(": ").filter(|(kind, _)| kind.starts_with("invalid"))
        {
            (at, found, wanted)
        } else {
            (at, message, "valid TOML that the documentation of manifests describes")
        };
        let field = if field.is_empty() { "file".to_owned() } else { field };
        let line = if message.starts_with("missing field") { None } else { Some(line) };
        Finding { line, ..Finding::new(self.path, field, found, wanted) }
    }
}

fn header(line: &str) -> Option<&str> {
    line.trim().strip_prefix('[')?.split(']').next().map(str::trim)
}

fn key(line: &str) -> Option<&str> {
    let (key, _) = line.split_once('=')?;
    let key = key.trim().trim_matches('"');
    (!key.is_empty() && !key.starts_with('#')).then_some(key)
}

fn join(table: &str, key: &str) -> String {
    match (table, key) {
        ("", key) => key.to_owned(),
        (table, "") => table.to_owned(),
        (table, key) => format!("{table}.{key}"),
    }
}
