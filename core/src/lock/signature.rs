//! Ed25519 signatures of locks, kept in a line of their own beside what they sign.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use ed25519_dalek::{Signer, SigningKey, VerifyingKey};

use super::hex;
use crate::manifest::{Finding, read_bounded};

/// Longest signature or key file, bytes.
pub(crate) const SIGNATURE_BYTES: u64 = 4096;
/// First word of a signature's line.
const ALGORITHM: &str = "ed25519";
/// First word of a secret key's line.
const SECRET: &str = "ed25519-secret";

/// A key that signatures are held against; 64 hex digits in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PublicKey(VerifyingKey);

/// A key that signs.
pub struct SecretKey(SigningKey);

/// A signature and the key it is said to be by: `ed25519 <key> <signature>`, in hex.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    key: PublicKey,
    signature: ed25519_dalek::Signature,
}

impl FromStr for PublicKey {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bytes = unhex(text).ok_or("no 64 hex digits")?;
        let key = VerifyingKey::from_bytes(&bytes).map_err(|_| "no point of the curve")?;
        // Of such a key anybody can make signatures.
        if key.is_weak() { Err("a weak key".to_owned()) } else { Ok(Self(key)) }
    }
}

impl fmt::Display for PublicKey {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&hex(self.0.as_bytes()))
    }
}

impl SecretKey {
    /// A new key from the system's randomness.
    ///
    /// # Errors
    /// The system has none to give.
    pub fn generate() -> std::io::Result<Self> {
        let mut seed = [0; 32];
        getrandom::fill(&mut seed).map_err(std::io::Error::from)?;
        Ok(Self(SigningKey::from_bytes(&seed)))
    }

    /// Reads a key that [`to_text`](Self::to_text) wrote.
    ///
    /// # Errors
    /// The file is unreadable or holds no key.
    pub fn read(file: &Path) -> Result<Self, Finding> {
        let text = read_bounded(file, SIGNATURE_BYTES, file, "file")?;
        let mut words = text.split_whitespace();
        let (word, digits, rest) = (words.next(), words.next(), words.next());
        let seed = digits.filter(|_| word == Some(SECRET) && rest.is_none()).and_then(unhex);
        // The text is secret, so what was found is not said.
        let seed = seed.ok_or_else(|| {
            Finding::new(file, "file", "something else", format!("`{SECRET}` and 64 hex digits"))
        })?;
        Ok(Self(SigningKey::from_bytes(&seed)))
    }

    /// The line that [`read`](Self::read) reads.
    pub fn to_text(&self) -> String {
        format!("{SECRET} {}\n", hex(self.0.as_bytes()))
    }

    /// What others check its signatures with.
    pub fn public(&self) -> PublicKey {
        PublicKey(self.0.verifying_key())
    }

    /// A signature of `bytes`.
    pub fn sign(&self, bytes: &[u8]) -> Signature {
        Signature { key: self.public(), signature: self.0.sign(bytes) }
    }
}

impl fmt::Debug for SecretKey {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "SecretKey(of {})", self.public())
    }
}

impl Signature {
    /// Reads a signature's file.
    ///
    /// # Errors
    /// It is unreadable or holds no signature.
    pub fn read(file: &Path) -> Result<Self, Finding> {
        let text = read_bounded(file, SIGNATURE_BYTES, file, "file")?;
        Self::parse(file, &text)
    }

    /// A signature from the text of `file`, which is only named in findings.
    ///
    /// # Errors
    /// It holds no signature.
    pub fn parse(file: &Path, text: &str) -> Result<Self, Finding> {
        let wanted = format!("`{ALGORITHM}`, a public key and a signature in hex");
        let finding = |found: &str| Finding::new(file, "file", found, &wanted);
        let words: Vec<&str> = text.split_whitespace().collect();
        let [ALGORITHM, key, signature] = words.as_slice() else {
            return Err(finding("something else"));
        };
        let key = key.parse::<PublicKey>().map_err(|error| finding(&format!("a key that is {error}")))?;
        let bytes = unhex(signature).ok_or_else(|| finding("a signature that is no 128 hex digits"))?;
        Ok(Self { key, signature: ed25519_dalek::Signature::from_bytes(&bytes) })
    }
}

impl fmt::Display for Signature {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(formatter, "{ALGORITHM} {} {}", self.key, hex(&self.signature.to_bytes()))
    }
}

/// Whether `bytes`, the content of `file`, are signed by one of `keys`; no keys demand nothing.
pub(crate) fn demand(
    file: &Path,
    bytes: &[u8],
    signature: Option<&Signature>,
    keys: &[PublicKey],
) -> Result<(), Finding> {
    if keys.is_empty() {
        return Ok(());
    }
    let listed: Vec<String> = keys.iter().map(ToString::to_string).collect();
    let refused = |found: String| {
        Err(Finding::new(file, "signature", found, format!("a signature by {}", listed.join(" or "))))
    };
    let Some(Signature { key, signature }) = signature else {
        return refused("nothing".to_owned());
    };
    if !keys.contains(key) {
        return refused(format!("one by {key}, which is not listed"));
    }
    match key.0.verify_strict(bytes, signature) {
        Ok(()) => Ok(()),
        Err(_) => refused(format!("one by {key} of other bytes")),
    }
}

/// Bytes from exactly as many lowercase hex digits as they take.
fn unhex<const N: usize>(text: &str) -> Option<[u8; N]> {
    let digits = text.as_bytes();
    let digit = |byte: u8| match byte {
        b'0'..=b'9' => Some(byte - b'0'),
        b'a'..=b'f' => Some(byte - b'a' + 10),
        _ => None,
    };
    if digits.len() != 2 * N {
        return None;
    }
    let mut bytes = [0; N];
    for (byte, pair) in bytes.iter_mut().zip(digits.as_chunks::<2>().0) {
        *byte = digit(pair[0])? << 4 | digit(pair[1])?;
    }
    Some(bytes)
}
