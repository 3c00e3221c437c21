//! A zip archive that stays packed.
//!
//! The table of contents is read once; an entry is unpacked when it is asked for, into memory of a bounded size, whatever the archive
//! says of itself. Nothing is written to the disk; an archive with names that would leave its folder is refused all the same, because
//! it was not made by somebody who wanted a recording to be read.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use zip::ZipArchive;

use super::frames::{ImageReader, ImageStore, Place};
use super::{GrayImage, decode};
use crate::fault::{Fault, text_of};

/// The largest table: an hour of inertial samples at 1 kHz has half of it.
const MOST_TABLE_BYTES: u64 = 512 << 20;
/// The largest image file: 32 million pixels of two bytes that do not compress.
const MOST_IMAGE_BYTES: u64 = 64 << 20;

/// An open archive; copies share it.
#[derive(Debug, Clone)]
pub(super) struct Archive {
    path: PathBuf,
    zip: Arc<Mutex<ZipArchive<BufReader<File>>>>,
    /// Names of files, to their number.
    entries: Arc<BTreeMap<String, usize>>,
}

impl Archive {
    /// Reads the table of contents.
    ///
    /// # Errors
    /// When it is cut off, damaged, or has names that leave its folder.
    pub(super) fn open(path: &Path) -> Result<Self, Fault> {
        let unreadable = |error: &dyn std::fmt::Display| {
            Fault::malformed(path, format!("zip archive is cut off or damaged ({error})"), "download or copy it again")
        };
        let file = File::open(path).map_err(|error| unreadable(&error))?;
        let zip = ZipArchive::new(BufReader::new(file)).map_err(|error| unreadable(&error))?;
        let mut entries = BTreeMap::new();
        for (index, name) in zip.file_names().enumerate() {
            let name = name.map_err(|error| unreadable(&error))?;
            if leaves_its_folder(&name) {
                let what = format!("zip archive holds the name `{}`, which leaves its folder", name.escape_debug());
                return Err(Fault::malformed(path, what, "do not trust it: get the recording from its origin"));
            }
            if !name.ends_with('/') && !name.starts_with("__MACOSX/") {
                entries.insert(name.into_owned(), index);
            }
        }
        Ok(Self { path: path.to_path_buf(), zip: Arc::new(Mutex::new(zip)), entries: Arc::new(entries) })
    }

    /// A name for messages.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// The archive itself.
    pub(super) fn file(&self) -> &Path {
        &self.path
    }

    /// All names of files.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    /// The number of a file.
    pub(super) fn entry(&self, name: &str) -> Option<usize> {
        self.entries.get(name).copied()
    }

    /// The text of a file that is in it.
    pub(super) fn text(&self, name: &str, remedy: &str) -> Result<String, Fault> {
        let path = self.path(name);
        let entry = self.entry(name).ok_or_else(|| Fault::missing(&path, "there is no such file", remedy))?;
        text_of(&path, self.bytes(entry, MOST_TABLE_BYTES)?)
    }

    /// Unpacks a file.
    fn bytes(&self, entry: usize, most: u64) -> Result<Vec<u8>, Fault> {
        // A thread that ended in the middle of a read leaves nothing behind: every read begins with a seek.
        let mut zip = self.zip.lock().unwrap_or_else(PoisonError::into_inner);
        let damaged = |name: &str, error: &dyn std::fmt::Display| {
            let what = format!("cannot be unpacked ({error})").replace('\n', " ");
            Fault::malformed(&self.path(name), what, "the archive is damaged or of an unusual kind: copy it again, or unpack it first")
        };
        let name = zip.name_for_index(entry).and_then(Result::ok).unwrap_or_default().into_owned();
        let file = zip.by_index(entry).map_err(|error| damaged(&name, &error))?;
        let mut bytes = Vec::new();
        file.take(most + 1).read_to_end(&mut bytes).map_err(|error| damaged(&name, &error))?;
        if bytes.len() as u64 > most {
            let what = format!("unpacks to more than {} MB", most >> 20);
            return Err(Fault::malformed(&self.path(&name), what, "no recording needs that: get the archive from its origin"));
        }
        Ok(bytes)
    }

    /// The image that an entry is.
    pub(super) fn image(&self, entry: usize) -> Result<GrayImage, Fault> {
        let bytes = self.bytes(entry, MOST_IMAGE_BYTES)?;
        decode::gray(&bytes).map_err(|reason| {
            let zip = self.zip.lock().unwrap_or_else(PoisonError::into_inner);
            let name = zip.name_for_index(entry).and_then(Result::ok).unwrap_or_default().into_owned();
            Fault::malformed(&self.path(&name), format!("image cannot be decoded ({reason})"), "copy the archive again")
        })
    }
}

fn leaves_its_folder(name: &str) -> bool {
    name.starts_with('/') || name.contains(['\\', '\0']) || name.get(1..2) == Some(":") || name.split('/').any(|part| part == "..")
}

impl ImageStore for Archive {
    fn reader(&self) -> Result<Box<dyn ImageReader>, Fault> {
        Ok(Box::new(self.clone()))
    }
}

impl ImageReader for Archive {
    fn read(&mut self, place: Place) -> Result<GrayImage, Fault> {
        self.image(usize::try_from(place.position).unwrap_or(usize::MAX))
    }
}
