//! The bytes of a bundle into checked files in memory: nothing is written here.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use flate2::read::GzDecoder;

use super::content::{Content, shortened};
use super::{LOCK, MAX_FILES, MAX_UNPACKED_BYTES, SIGNATURE};
use crate::lock::{PublicKey, SIGNATURE_BYTES, Signature, demand, sha256_hex};
use crate::manifest::{Finding, MAX_BYTES};

/// A bundle whose files are all there and as its lock has them.
#[derive(Debug)]
pub struct Bundle {
    pub(super) content: Content,
    pub(super) lock: String,
    pub(super) signature: Option<(String, Signature)>,
    pub(super) files: BTreeMap<String, Vec<u8>>,
}

impl Bundle {
    /// Name of the skill.
    pub fn skill(&self) -> &str {
        &self.content.skill
    }

    /// Whether one of `keys` has signed it; no keys demand nothing.
    ///
    /// # Errors
    /// There is no signature, it is by none of the keys, or it is of other bytes.
    pub fn check_signature(&self, file: &Path, keys: &[PublicKey]) -> Result<(), Finding> {
        let signature = self.signature.as_ref().map(|(_, signature)| signature);
        demand(file, self.lock.as_bytes(), signature, keys)
    }
}

/// Reads a bundle from the bytes of `file`, which is only named in findings.
///
/// # Errors
/// It is no such archive, larger than allowed, holds anything but plain files that its lock names, in
/// the places of its skill, or lacks one of them, or a file is not as the lock has it.
pub fn unpack(file: &Path, bytes: &[u8]) -> Result<Bundle, Finding> {
    let damaged = |error: std::io::Error| {
        Finding::new(file, "file", error, "a whole bundle as `skills pack` writes it")
    };
    // A small file may promise terabytes: what is read ends here whatever it says.
    let unpacked = GzDecoder::new(bytes).take(MAX_UNPACKED_BYTES + (1 << 20));
    let mut archive = tar::Archive::new(unpacked);
    let mut reader = Reader { file, left: MAX_UNPACKED_BYTES, entries: 0 };
    // Raw, so that long names, sparse files and links are entries like others, and refused.
    let mut entries = archive.entries().map_err(damaged)?.raw(true);
    let (path, lock) = match entries.next() {
        Some(entry) => reader.entry(entry.map_err(damaged)?)?,
        None => return Err(Finding::new(file, "file", "nothing", "a bundle as `skills pack` writes it")),
    };
    let text = String::from_utf8(lock).ok().filter(|text| path == LOCK && text.len() as u64 <= MAX_BYTES);
    let Some(lock) = text else {
        let wanted = format!("{LOCK} first, a text of at most {MAX_BYTES} bytes");
        return Err(Finding::new(file, "entry", format!("{:?}", shortened(&path)), wanted));
    };
    let content = Content::parse(file, &lock)?;
    content.check_host(file)?;
    let (mut signature, mut files) = (None, BTreeMap::new());
    for entry in entries {
        let (path, bytes) = reader.entry(entry.map_err(damaged)?)?;
        if path == SIGNATURE && signature.is_none() && files.is_empty() {
            let text = String::from_utf8(bytes).ok().filter(|text| text.len() as u64 <= SIGNATURE_BYTES);
            let text = text.unwrap_or_default();
            signature = Some((text.clone(), Signature::parse(Path::new(SIGNATURE), &text)?));
            continue;
        }
        content.place(file, &path)?;
        let found = sha256_hex(&bytes);
        match content.files.get(&path) {
            Some(hash) if *hash == found => {}
            Some(hash) => {
                let field = format!("sha256 of {path}");
                return Err(Finding::new(file, field, found, format!("{hash}, as its lock has it")));
            }
            None => return Err(Finding::new(file, "entry", format!("{path:?}"), "a file that its lock has")),
        }
        if files.contains_key(&path) {
            return Err(Finding::new(file, "entry", format!("{path:?} twice"), "every file once"));
        }
        files.insert(path, bytes);
    }
    if let Some(missing) = content.files.keys().find(|path| !files.contains_key(*path)) {
        return Err(Finding::new(file, "entry", format!("no {missing}"), "every file that its lock has"));
    }
    Ok(Bundle { content, lock, signature, files })
}

/// Reads entries within the limits.
struct Reader<'a> {
    file: &'a Path,
    left: u64,
    entries: usize,
}

impl Reader<'_> {
    fn entry<R: Read>(&mut self, mut entry: tar::Entry<'_, R>) -> Result<(String, Vec<u8>), Finding> {
        let finding =
            |field: &str, found: String, wanted: String| Err(Finding::new(self.file, field, found, wanted));
        self.entries += 1;
        // The lock and its signature come on top.
        if self.entries > MAX_FILES + 2 {
            return finding(
                "entries",
                format!("more than {}", MAX_FILES + 2),
                format!("at most {}", MAX_FILES + 2),
            );
        }
        let path = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        let kind = entry.header().entry_type();
        if kind != tar::EntryType::Regular {
            return finding("entry", format!("{:?}, {kind:?}", shortened(&path)), "plain files alone".into());
        }
        let size = entry.size();
        if size > self.left {
            let found = format!("{:?} of {size} bytes", shortened(&path));
            return finding("entry", found, format!("at most {MAX_UNPACKED_BYTES} bytes in all"));
        }
        self.left -= size;
        let mut bytes = Vec::new();
        let read = (&mut entry).take(size).read_to_end(&mut bytes);
        match read {
            Ok(read) if read as u64 == size => Ok((path, bytes)),
            Ok(read) => finding(
                "entry",
                format!("{path:?} of {read} bytes"),
                format!("{size}: the file is cut short"),
            ),
            Err(error) => finding("entry", format!("{path:?}: {error}"), "a whole bundle".into()),
        }
    }
}
