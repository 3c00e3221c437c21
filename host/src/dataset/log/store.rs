//! Images out of the chunks of a recording.

use std::path::PathBuf;

use super::fields::Encoding;
use super::messages::{self, Content};
use super::{Chunk, Container, container};
use crate::dataset::{GrayImage, ImageReader, ImageStore, Layout, Place};
use crate::fault::Fault;

/// The files, and what is said of the images in them.
#[derive(Debug, Clone)]
pub(super) struct Store {
    pub(super) files: Vec<PathBuf>,
    pub(super) layout: Layout,
    pub(super) topic: String,
    pub(super) content: Content,
    pub(super) encoding: Encoding,
}

impl ImageStore for Store {
    fn reader(&self) -> Result<Box<dyn ImageReader>, Fault> {
        Ok(Box::new(Reader { store: self.clone(), open: None }))
    }
}

struct Reader {
    store: Store,
    open: Option<Open>,
}

/// The file read last, and its chunk read last.
struct Open {
    file: u32,
    container: Box<dyn Container + Send>,
    chunk: Option<Chunk>,
}

impl ImageReader for Reader {
    fn read(&mut self, place: Place) -> Result<GrayImage, Fault> {
        let path = usize::try_from(place.file).ok().and_then(|file| self.store.files.get(file)).cloned().unwrap_or_default();
        let mut open = match self.open.take().filter(|open| open.file == place.file) {
            Some(open) => open,
            None => Open { file: place.file, container: container(self.store.layout, &path)?, chunk: None },
        };
        let chunk = match open.chunk.take().filter(|chunk| chunk.position == place.position) {
            Some(chunk) => chunk,
            None => open.container.chunk_at(place.position)?,
        };
        let message = usize::try_from(place.index).ok().and_then(|index| chunk.messages.get(index));
        let bytes = message.and_then(|message| chunk.data.get(message.range.clone())).unwrap_or_default();
        let image = messages::image(self.store.content, self.store.encoding, bytes);
        open.chunk = Some(chunk);
        self.open = Some(open);
        image.map_err(|reason| Fault::malformed(&path, format!("`{}`: image cannot be read ({reason})", self.store.topic), "record again"))
    }
}
