//! Whether an ELF file is whole: `dlopen` maps what the headers promise, and a page that a truncated
//! file lacks ends the process with SIGBUS instead of an error.

/// A defect: field of the file, what was found, what would be right.
pub(super) type Defect = (&'static str, String, String);

const HEADER_BYTES: usize = 64;
const SHARED_OBJECT: u64 = 3;
const LOAD: u64 = 1;
const NO_BYTES_IN_FILE: u64 = 8;

#[cfg(target_arch = "x86_64")]
const MACHINE: (u64, &str) = (62, "x86-64");
#[cfg(target_arch = "aarch64")]
const MACHINE: (u64, &str) = (183, "AArch64");
#[cfg(target_arch = "riscv64")]
const MACHINE: (u64, &str) = (243, "RISC-V");
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64")))]
const MACHINE: (u64, &str) = (0, "this machine");

/// Checks that `bytes` are a 64-bit little-endian shared object of this machine whose segments,
/// sections and section table all lie inside the file.
///
/// # Source
/// System V ABI, chapter 4: ELF header, program header, section header (64-bit class).
pub(super) fn check(bytes: &[u8]) -> Result<(), Defect> {
    let magic = bytes.get(..6).unwrap_or(bytes);
    if magic != b"\x7fELF\x02\x01" {
        let found = match bytes {
            [] => "an empty file".to_owned(),
            _ => format!("a file that begins with \"{}\"", magic.escape_ascii()),
        };
        return Err(("file", found, "a shared library (64-bit ELF)".into()));
    }
    if bytes.len() < HEADER_BYTES {
        return Err(truncated("ELF header", bytes.len(), HEADER_BYTES as u64));
    }
    let kind = number(bytes, 16, 2);
    if kind != SHARED_OBJECT {
        return Err(("ELF type", kind.to_string(), format!("{SHARED_OBJECT}, a shared object")));
    }
    let machine = number(bytes, 18, 2);
    if MACHINE.0 != 0 && machine != MACHINE.0 {
        return Err(("ELF machine", machine.to_string(), format!("{}, {}", MACHINE.0, MACHINE.1)));
    }
    let program = Table::new(bytes, "ELF program headers", 32, 54, 56)?;
    for header in program.rows.chunks_exact(program.row_bytes) {
        if number(header, 0, 4) == LOAD {
            let (offset, length) = (number(header, 8, 8), number(header, 32, 8));
            inside("ELF segments", bytes, offset, length)?;
        }
    }
    let section = Table::new(bytes, "ELF section table", 40, 58, 60)?;
    for header in section.rows.chunks_exact(section.row_bytes) {
        if number(header, 4, 4) != NO_BYTES_IN_FILE {
            let (offset, length) = (number(header, 24, 8), number(header, 32, 8));
            inside("ELF sections", bytes, offset, length)?;
        }
    }
    Ok(())
}

/// A header table, whole.
struct Table<'a> {
    rows: &'a [u8],
    row_bytes: usize,
}

impl<'a> Table<'a> {
    fn new(
        bytes: &'a [u8],
        field: &'static str,
        offset_at: usize,
        row_bytes_at: usize,
        count_at: usize,
    ) -> Result<Self, Defect> {
        let (offset, row_bytes) = (number(bytes, offset_at, 8), number(bytes, row_bytes_at, 2));
        let count = number(bytes, count_at, 2);
        if count > 0 && row_bytes < 56 {
            return Err((field, format!("rows of {row_bytes} bytes"), "rows of at least 56 bytes".into()));
        }
        let rows = inside(field, bytes, offset, count * row_bytes)?;
        Ok(Self { rows, row_bytes: row_bytes.max(1) as usize })
    }
}

fn inside<'a>(field: &'static str, bytes: &'a [u8], offset: u64, length: u64) -> Result<&'a [u8], Defect> {
    let end = offset.saturating_add(length);
    usize::try_from(offset)
        .ok()
        .zip(usize::try_from(end).ok())
        .and_then(|(start, end)| bytes.get(start..end))
        .ok_or_else(|| truncated(field, bytes.len(), end))
}

fn truncated(field: &'static str, length: usize, end: u64) -> Defect {
    (field, format!("a file of {length} bytes"), format!("{end} bytes: the file is cut short"))
}

fn number(bytes: &[u8], at: usize, length: usize) -> u64 {
    let slice = bytes.get(at..at + length).unwrap_or(&[]);
    slice.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
}

#[cfg(all(test, target_os = "linux", target_pointer_width = "64"))]
mod tests {
    use super::*;

    /// Test programs are position-independent, so this one's own file is a whole shared object.
    fn whole() -> Vec<u8> {
        std::fs::read(std::env::current_exe().expect("a path")).expect("this program's file")
    }

    #[test]
    fn a_whole_file_passes_and_every_cut_is_noticed() {
        let bytes = whole();
        check(&bytes).expect("whole");
        for share in [0.001, 0.1, 0.5, 0.9, 0.999] {
            let cut = (bytes.len() as f64 * share) as usize;
            let (_, found, wanted) = check(&bytes[..cut]).expect_err("cut");
            assert!(found.contains(&cut.to_string()) || wanted.contains("cut short"), "{found}, {wanted}");
        }
        check(&bytes[..bytes.len() - 1]).expect_err("one byte short");
    }

    #[test]
    fn another_machine_and_plain_text_are_refused() {
        let mut bytes = whole();
        bytes[18] ^= 0xff;
        assert_eq!(check(&bytes).expect_err("foreign").0, "ELF machine");
        assert_eq!(check(b"hello").expect_err("text").0, "file");
        assert_eq!(check(b"").expect_err("empty").0, "file");
        assert_eq!(check(b"\x7fELF\x02\x01\x01").expect_err("stub").0, "ELF header");
    }

    #[test]
    fn huge_offsets_do_not_overflow() {
        let mut bytes = whole();
        bytes[40..48].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(check(&bytes).expect_err("far away").0, "ELF section table");
    }
}
