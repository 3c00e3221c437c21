//! The files of a recording, in a folder or in an archive that stays packed: one way to read both.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use libella_core::time::Timestamp;

use super::archive::Archive;
use super::decode;
use super::frames::{Frames, ImageFile, PackedImage, PackedImages, Place};
use crate::fault::{Fault, read_text};

/// The files of a recording. Names are relative, with `/` between their parts.
#[derive(Debug, Clone)]
pub(super) enum Files {
    /// Files of a folder.
    Folder(PathBuf),
    /// Files of an archive.
    Archive(Archive),
}

impl Files {
    /// A name for messages.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        match self {
            Self::Folder(folder) => name.split('/').filter(|part| !part.is_empty()).fold(folder.clone(), |path, part| path.join(part)),
            Self::Archive(archive) => archive.path(name),
        }
    }

    /// Whether there is a file of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        match self {
            Self::Folder(_) => self.path(name).is_file(),
            Self::Archive(archive) => archive.entry(name).is_some(),
        }
    }

    /// Whether there is a folder of this name.
    pub(super) fn has_folder(&self, name: &str) -> bool {
        match self {
            Self::Folder(_) => self.path(name).is_dir(),
            Self::Archive(archive) => archive.names().any(|file| file.strip_prefix(name).is_some_and(|rest| rest.starts_with('/'))),
        }
    }

    /// The text of a file.
    pub(super) fn text(&self, name: &str, remedy: &str) -> Result<String, Fault> {
        match self {
            Self::Folder(_) => read_text(&self.path(name), remedy),
            Self::Archive(archive) => archive.text(name, remedy),
        }
    }

    /// The names of the files right in a folder, which is given with its `/` or empty; sorted.
    pub(super) fn names_in(&self, folder: &str) -> Vec<String> {
        let mut names: Vec<String> = match self {
            Self::Folder(_) => std::fs::read_dir(self.path(folder))
                .into_iter()
                .flatten()
                .flatten()
                .filter(|entry| entry.path().is_file())
                .filter_map(|entry| entry.file_name().into_string().ok())
                .collect(),
            Self::Archive(archive) => {
                archive.names().filter_map(|name| name.strip_prefix(folder)).filter(|name| !name.contains('/')).map(str::to_owned).collect()
            }
        };
        names.sort();
        names
    }

    /// Width and height of an image, or `None` where it cannot be read.
    pub(super) fn image_size(&self, name: &str) -> Option<(u32, u32)> {
        match self {
            Self::Folder(_) => decode::size(&self.path(name)),
            Self::Archive(archive) => {
                let image = archive.image(archive.entry(name)?).ok()?;
                Some((u32::try_from(image.width).ok()?, u32::try_from(image.height).ok()?))
            }
        }
    }

    /// Images to be read later, by the names of their files.
    pub(super) fn frames(&self, images: Vec<(Timestamp, String)>) -> Frames {
        match self {
            Self::Folder(_) => {
                Frames::Images(images.into_iter().map(|(stamp, name)| ImageFile { stamp, path: self.path(&name) }).collect())
            }
            Self::Archive(archive) => {
                let place = |name: &str| Some(Place { file: 0, position: archive.entry(name)? as u64, index: 0 });
                let images = images.iter().filter_map(|(stamp, name)| Some(PackedImage { stamp: *stamp, place: place(name)? }));
                Frames::Packed(PackedImages { images: images.collect(), store: Arc::new(archive.clone()) })
            }
        }
    }

    /// The folder in which the recording lies: of an archive that of the archive.
    pub(super) fn surroundings(&self) -> Self {
        let parent = |path: &Path| path.canonicalize().ok().and_then(|path| path.parent().map(Path::to_path_buf));
        let path = match self {
            Self::Folder(folder) => folder,
            Self::Archive(archive) => archive.file(),
        };
        Self::Folder(parent(path).unwrap_or_else(|| PathBuf::from(".")))
    }
}
