//! A number for everything that determines a result, so that a finished run is found again and never mistaken for another.
//!
//! FNV-1a with 64 bits: fixed for ever, and nobody forges results here.

use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use crate::fault::Fault;

/// Tables up to this size are read whole.
const WHOLE_BYTES: u64 = 64 << 20;
/// Of what is larger, this much of both ends.
const ENDS_BYTES: u64 = 1 << 20;

/// A hash that is being made.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fingerprint(u64);

impl Fingerprint {
    pub fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    /// Takes in one piece; pieces do not run into each other.
    pub fn add(mut self, bytes: &[u8]) -> Self {
        for byte in (bytes.len() as u64).to_le_bytes().iter().chain(bytes) {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        self
    }

    pub fn hex(self) -> String {
        format!("{:016x}", self.0)
    }
}

/// The program that runs.
pub(super) fn of_program() -> String {
    let bytes = std::env::current_exe().and_then(std::fs::read).unwrap_or_default();
    Fingerprint::new().add(env!("CARGO_PKG_VERSION").as_bytes()).add(&bytes).hex()
}

/// A recording: all of its tables, names and sizes of its images. Where it lies does not matter.
pub(super) fn of_recording(path: &Path, with_depth: bool) -> Result<String, Fault> {
    let mut print = Fingerprint::new();
    if path.is_file() {
        return Ok(add_file(print, path)?.hex());
    }
    let mav0 = path.join("mav0");
    let root = if mav0.is_dir() { mav0.as_path() } else { path };
    add_folder(&mut print, root, "", with_depth)?;
    Ok(print.hex())
}

/// A file by its content.
pub(super) fn of_file(path: &Path) -> Result<String, Fault> {
    Ok(add_file(Fingerprint::new(), path)?.hex())
}

fn add_folder(print: &mut Fingerprint, folder: &Path, below: &str, with_depth: bool) -> Result<(), Fault> {
    let unreadable = |error| unreadable(folder, &error);
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let mut names = entries.map(|entry| entry.map(|entry| entry.file_name())).collect::<Result<Vec<_>, _>>().map_err(unreadable)?;
    // The order in which a disk lists its files is its own.
    names.sort();
    for name in names {
        let (path, shown) = (folder.join(&name), format!("{below}/{}", name.to_string_lossy()));
        if path.is_dir() {
            let unused = shown == "/cam1" || (shown == "/cam0/depth" && !with_depth);
            if !unused {
                add_folder(print, &path, &shown, with_depth)?;
            }
            continue;
        }
        let is_image = path.extension().is_some_and(|kind| ["png", "jpg", "jpeg"].iter().any(|image| kind.eq_ignore_ascii_case(image)));
        *print = print.add(shown.as_bytes());
        *print = if is_image { print.add(&path.metadata().map_err(unreadable)?.len().to_le_bytes()) } else { add_file(*print, &path)? };
    }
    Ok(())
}

fn add_file(print: Fingerprint, path: &Path) -> Result<Fingerprint, Fault> {
    let read = || -> std::io::Result<Fingerprint> {
        let mut file = std::fs::File::open(path)?;
        let length = file.metadata()?.len();
        let mut bytes = Vec::new();
        if length <= WHOLE_BYTES {
            file.read_to_end(&mut bytes)?;
        } else {
            (&mut file).take(ENDS_BYTES).read_to_end(&mut bytes)?;
            file.seek(SeekFrom::Start(length - ENDS_BYTES))?;
            file.read_to_end(&mut bytes)?;
        }
        Ok(print.add(&length.to_le_bytes()).add(&bytes))
    };
    read().map_err(|error| unreadable(path, &error))
}

fn unreadable(path: &Path, error: &std::io::Error) -> Fault {
    Fault::missing(path, format!("cannot be read ({error})"), "check its permissions and the disk")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_its_definition_and_knows_where_pieces_end() {
        // Of eight zero bytes (the length of an empty piece): the offset times the prime to the eighth, mod 2^64.
        let mut by_hand: u64 = 0xcbf2_9ce4_8422_2325;
        (0..8).for_each(|_| by_hand = by_hand.wrapping_mul(1_099_511_628_211));
        assert_eq!(Fingerprint::new().add(b"").hex(), format!("{by_hand:016x}"));
        assert_ne!(Fingerprint::new().add(b"ab").add(b"c").hex(), Fingerprint::new().add(b"a").add(b"bc").hex());
    }

    #[test]
    fn a_recording_is_known_by_its_content_wherever_it_lies() {
        let make = |value: &str| {
            let folder = tempfile::tempdir().unwrap();
            for (name, text) in [("mav0/imu0/data.csv", value), ("mav0/cam0/data/1.png", "abc"), ("mav0/cam0/depth/1.png", "d")] {
                let path = folder.path().join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, text).unwrap();
            }
            folder
        };
        let (one, same, other) = (make("1,2"), make("1,2"), make("1,3"));
        let print = |folder: &tempfile::TempDir| of_recording(folder.path(), false).unwrap();
        assert_eq!(print(&one), print(&same));
        assert_ne!(print(&one), print(&other));
        std::fs::write(one.path().join("mav0/cam0/depth/1.png"), "longer").unwrap();
        assert_eq!(print(&one), print(&same), "depth maps that nobody reads");
        assert_ne!(of_recording(one.path(), true).unwrap(), of_recording(same.path(), true).unwrap());
        std::fs::write(one.path().join("mav0/cam0/data/1.png"), "another size").unwrap();
        assert_ne!(print(&one), print(&same));
    }
}
